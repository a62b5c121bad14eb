"""The published size of the image towers, of random weights, and the depth of a tiny text tower."""

from __future__ import annotations

import shutil
from collections.abc import Iterator

import numpy as np
import pytest

from tests.anytraverse.dense.checkpoints import write_siglip, write_tipsv2
from tests.anytraverse.dense.parity import DenseParity

pytestmark = pytest.mark.needs_export

TEXT = {"hidden_size": 768, "intermediate_size": 3072, "num_hidden_layers": 1, "num_attention_heads": 12}
VISION = {"hidden_size": 768, "num_hidden_layers": 12, "num_attention_heads": 12}
SIGLIP = {
    "text_config": TEXT,
    "vision_config": {**VISION, "intermediate_size": 3072, "image_size": 224, "patch_size": 16},
}
TIPSV2 = {
    "text_config": TEXT,
    "vision_config": {**VISION, "mlp_ratio": 4, "image_size": 448, "patch_size": 14},
}


@pytest.fixture(params=["siglip", "tipsv2"])
def published(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[DenseParity]:
    """SigLIP2-B/16 at 256 pixels, whose positions are of 224; TIPSv2-B/14 at 252, whose are of 448."""
    folder = tmp_path_factory.mktemp("published")
    if request.param == "siglip":
        yield DenseParity(write_siglip(folder / "checkpoint", SIGLIP), folder / "bundle", 256)
    else:
        pytest.importorskip("transformers.models.tipsv2", reason="this transformers has no TIPSv2")
        yield DenseParity(write_tipsv2(folder / "checkpoint", TIPSV2), folder / "bundle", 252)
    shutil.rmtree(folder)


def test_attention_and_scene_are_those_of_transformers(published: DenseParity) -> None:
    frame = published.frame(1)
    ours, theirs = published.maps(frame, ["grass", "a muddy path"])
    assert theirs.std() > 0.1
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-4)
    _, scene = published.seen(frame)
    assert float(published.ours.embed(published.ours.encode(frame)) @ scene) >= 0.9999
