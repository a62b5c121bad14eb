"""What a dense bundle makes of words and pictures is what transformers makes of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from tests.anytraverse.dense.checkpoints import write_siglip, write_tipsv2
from tests.anytraverse.dense.parity import DenseParity

pytestmark = pytest.mark.needs_export

WORDS = ["grass", "dirt path", "rock-strewn, 50 m!", "don't", "a" * 48, "the photo of a grass", "x"]
UNICODE = ["straße", "草地", "q\u0327\u0301", "🏜"]


@dataclass(frozen=True)
class Case:
    """family: the model. changes: of the tiny config. size: of the picture. more: of the writer."""

    family: str
    changes: dict[str, Any] = field(default_factory=dict)
    size: int = 64
    more: dict[str, Any] = field(default_factory=dict)


CASES = {
    "SigLIP 2": Case("siglip"),
    "SigLIP 2 with the tokenizer of the hub": Case("siglip", more={"tokenizer": "GemmaTokenizer"}),
    "SigLIP 2, another seed": Case("siglip", more={"seed": 1}),
    "SigLIP 2, larger pictures": Case("siglip", size=96),
    "SigLIP 2, smaller pictures": Case("siglip", size=40),
    "SigLIP 2, patches of 16": Case("siglip", {"vision_config": {"patch_size": 16}}),
    "SigLIP 2, other epsilons": Case(
        "siglip", {"vision_config": {"layer_norm_eps": 0.01}, "text_config": {"layer_norm_eps": 0.02}}
    ),
    "SigLIP 2, seven text layers": Case("siglip", {"text_config": {"num_hidden_layers": 7}}),
    "TIPSv2": Case("tipsv2"),
    "TIPSv2, another seed": Case("tipsv2", more={"seed": 1}),
    "TIPSv2, larger pictures": Case("tipsv2", size=96),
    "TIPSv2, smaller pictures": Case("tipsv2", size=40),
    "TIPSv2, three registers": Case("tipsv2", {"vision_config": {"num_register_tokens": 3}}),
    "TIPSv2, no biases": Case("tipsv2", {"vision_config": {"qkv_bias": False}}),
    "TIPSv2, tokens unscaled": Case("tipsv2", {"text_config": {"scale_sqrt_depth": False}}),
}


@pytest.fixture(scope="module", params=list(CASES.values()), ids=list(CASES))
def pair(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> DenseParity:
    case: Case = request.param
    folder = tmp_path_factory.mktemp("dense")
    if case.family == "tipsv2":
        pytest.importorskip("transformers.models.tipsv2", reason="this transformers has no TIPSv2")
    write = write_siglip if case.family == "siglip" else write_tipsv2
    checkpoint = write(folder / "checkpoint", case.changes, **case.more)
    return DenseParity(checkpoint, folder / "bundle", case.size)


def test_features_of_patches_and_scenes_are_those_of_transformers(pair: DenseParity) -> None:
    frame = pair.frame(1)
    patches, scene = pair.seen(frame)
    ours = pair.ours.encode(frame)
    np.testing.assert_allclose(ours.directions.reshape(len(scene), -1).T, patches, rtol=0, atol=1e-5)
    np.testing.assert_allclose(pair.ours.embed(ours), scene, rtol=0, atol=1e-5)


def test_probabilities_are_those_of_transformers(pair: DenseParity) -> None:
    ours, theirs = pair.maps(pair.frame(2), WORDS)
    assert theirs.std() > 0.1
    assert theirs.std(axis=0).mean() > 0.03  # the words matter
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-4)


def test_texts_have_their_tokens(pair: DenseParity) -> None:
    texts = [*WORDS, *UNICODE, "a photo of a Muddy  Path.", "mud " * 80]
    given = pair.tokens(texts)
    for text, ids, mask in zip(texts, given.input_ids, given.attention_mask, strict=True):
        expected = ids if pair.ours.details.family == "siglip" else ids[mask.bool()]
        assert pair.tokenizer.encode(text) == expected.tolist(), text
