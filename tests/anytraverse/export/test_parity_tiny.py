"""What a bundle makes of words and pictures is what transformers makes of them, whatever the architecture."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anytraverse.perception import Example, Prompt
from anytraverse.perception.tokenizer import Tokenizer
from anytraverse.regions import Box
from tests.anytraverse.clipseg.pictures import picture
from tests.anytraverse.export.checkpoints import write_clip, write_clipseg
from tests.anytraverse.export.parity import Parity, cosine, mask_iou, scene_embedding

pytestmark = pytest.mark.needs_export

FRAMES = Path(__file__).resolve().parents[4] / "shared/data/frames"
WORDS = [
    *(
        "grass",
        "Dirt  PATH",
        "rock-strewn, 50 m!",
        "don't",
        "草地",
        "straße",
        "🏜\ufe0f",
        "q\u0327\u0301",
        "_",
    ),
    *("mud<|endoftext|>grass", "<|startoftext|>", "a" * 40, "it's a long way", "1234", "½", "\u200b"),
]


@dataclass(frozen=True)
class Case:
    """changes: of the tiny config. size: of the picture. images: changes of preprocessor_config.json."""

    changes: dict[str, Any] = field(default_factory=dict)
    size: int = 96
    seed: int = 0
    images: dict[str, Any] = field(default_factory=dict)


CASES = {
    "as published": Case(),
    "another seed": Case(seed=1),
    "and another": Case(seed=2),
    "a grid of the table's size": Case(size=64),
    "a grid smaller than the table": Case(size=48),
    "twice the table": Case(size=128),
    "patches of 8": Case({"vision_config": {"patch_size": 8}}),
    "patches of 32": Case({"vision_config": {"patch_size": 32}}, size=128),
    "the last layer is read": Case({"extract_layers": [1, 3]}),
    "layers read out of order": Case({"extract_layers": [2, 0, 1]}),
    "one layer": Case({"extract_layers": [0], "vision_config": {"num_hidden_layers": 1}}),
    "words at step 1": Case({"conditional_layer": 1}),
    "words at the last step": Case({"conditional_layer": 2}),
    "one convolution": Case({"use_complex_transposed_convolution": False}),
    "gelu": Case({"vision_config": {"hidden_act": "gelu"}, "text_config": {"hidden_act": "gelu"}}),
    "ids as written today": Case({"text_config": {"bos_token_id": 1022, "eos_token_id": 1023}}),
    "other epsilons": Case(
        {"vision_config": {"layer_norm_eps": 0.01}, "text_config": {"layer_norm_eps": 0.02}}
    ),
    "one text layer": Case({"text_config": {"num_hidden_layers": 1}}),
    "seven text layers": Case({"text_config": {"num_hidden_layers": 7}}),
    "pixels of old forks": Case(images={"image_mean": [0.5] * 3, "image_std": [0.5] * 3, "resample": 3}),
}


@pytest.fixture(scope="module", params=list(CASES.values()), ids=list(CASES))
def pair(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Parity:
    case: Case = request.param
    folder = tmp_path_factory.mktemp("parity")
    checkpoint = write_clipseg(folder / "clipseg", case.changes, case.size, case.seed, case.images)
    return Parity(checkpoint, folder / "bundle", case.size)


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> Parity:
    """Of the first case, with the scene embedding of a CLIP."""
    folder = tmp_path_factory.mktemp("published")
    checkpoint, clip = write_clipseg(folder / "clipseg", {}), write_clip(folder / "clip", {})
    return Parity(checkpoint, folder / "bundle", 96, scene="clip-b32", clip=str(clip))


def test_probabilities_are_those_of_transformers(pair: Parity) -> None:
    ours, theirs = pair.maps(pair.identical(1), WORDS)
    assert theirs.std() > 0.1
    assert theirs.std(axis=0).mean() > 0.03  # the words matter
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-4)


def test_embeddings_of_pictures_are_those_of_transformers(pair: Parity) -> None:
    frame = pair.identical(2)
    theirs = pair.theirs.image_embedding(pair.theirs.pixels(frame))
    assert cosine(pair.ours.embed(pair.ours.encode(frame)), theirs) >= 0.9999


def test_masks_of_a_camera_frame_are_those_of_transformers_own_preprocessing(pair: Parity) -> None:
    ours, theirs = pair.maps(picture(640, 480, 3), WORDS[:4])
    assert mask_iou(ours, theirs) >= 0.998


@pytest.mark.parametrize("size", [(640, 480), (1280, 720), (375, 500), (96, 60), (50, 40)])
def test_frames_of_any_size_look_the_same_to_both(published: Parity, size: tuple[int, int]) -> None:
    ours, theirs = published.maps(picture(*size, 4), WORDS[:4])
    assert mask_iou(ours, theirs) >= 0.998


@pytest.mark.skipif(not FRAMES.is_dir(), reason="the recorded frames are not here")
def test_recorded_frames_look_the_same_to_both(published: Parity) -> None:
    import cv2

    for path in sorted(FRAMES.glob("*.jpg"))[:3]:
        frame = np.asarray(cv2.cvtColor(np.asarray(cv2.imread(str(path))), cv2.COLOR_BGR2RGB), dtype=np.uint8)
        ours, theirs = published.maps(frame, WORDS[:4])
        assert mask_iou(ours, theirs) >= 0.998


def test_any_number_of_words_gives_the_same_maps(published: Parity) -> None:
    frame = published.identical(1)
    theirs = published.theirs.probabilities(published.theirs.pixels(frame), WORDS)
    features = published.ours.encode(frame)
    for count in range(1, len(WORDS) + 1):
        ours = published.ours.attend(features, [Prompt(word) for word in WORDS[:count]])
        np.testing.assert_allclose(ours, theirs[:count], rtol=0, atol=1e-4)


def test_words_and_texts_that_are_too_long_have_their_conditions(pair: Parity) -> None:
    texts = [*WORDS, "草" * 500, "muddy path " * 60]
    ours = np.stack(pair.prompts.conditions(texts))
    np.testing.assert_allclose(ours, pair.theirs.conditions(texts), rtol=0, atol=1e-4)


def test_words_have_their_tokens(published: Parity) -> None:
    tokenizer = Tokenizer.load(published.bundle / "tokenizer.json")
    assert [tokenizer.encode(word) for word in WORDS] == published.theirs.tokens(WORDS)


@pytest.mark.parametrize("size", [(640, 480), (300, 400), (96, 96)])
def test_the_papers_scene_embedding_is_that_of_transformers(published: Parity, size: tuple[int, int]) -> None:
    frame = picture(*size, 5)
    theirs = scene_embedding(published.checkpoint.with_name("clip"), frame)
    assert cosine(published.ours.embed(published.ours.encode(frame)), theirs) >= 0.9999


def test_a_tapped_thing_is_the_condition_that_transformers_makes_of_the_crop(pair: Parity) -> None:
    frame, box = picture(200, 150, 6), Box(0.25, 0.4, 0.6, 0.8)
    features = pair.ours.encode(frame)
    tapped = pair.ours.example(features, box)
    crop = np.ascontiguousarray(frame[box.grown(1.2).slices(150, 200)])
    condition = pair.theirs.image_embedding(pair.theirs.pixels(crop))
    assert cosine(tapped.vector, condition) >= 0.9999
    exact = Example(pair.ours.model_id, condition)
    ours = pair.ours.attend(features, [Prompt("mud", (exact,))])
    word = pair.ours.attend(features, [Prompt("mud")])
    theirs = pair.theirs.probabilities_of(pair.theirs.pixels(frame), condition)
    np.testing.assert_allclose(ours, np.maximum(word, theirs), rtol=0, atol=1e-4)
