"""The published architecture but for the depth of its text, of random weights: 1 GB while this runs."""

from __future__ import annotations

import shutil
from collections.abc import Iterator

import numpy as np
import pytest

from anytraverse.regions import Box
from bench.clipseg.checkpoints import PUBLISHED
from tests.anytraverse.clipseg.pictures import picture
from tests.anytraverse.export.checkpoints import write_clip, write_clipseg
from tests.anytraverse.export.parity import Parity, cosine, mask_iou, scene_embedding

pytestmark = pytest.mark.needs_export

WORDS = ["grass", "a muddy path, 50 m ahead"]
FEW_WORDS = {"text_config": {"num_hidden_layers": 2, "vocab_size": 1024}}
"""One layer is as another, and a token as another: of all the words there are bundles of a tiny network."""
SHALLOW = {**FEW_WORDS, "vision_config": {"num_hidden_layers": 2}}
"""The words that CLIP knows are never read."""


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Parity]:
    """CLIPSeg rd64 at 352 pixels, whose position table is of 224, and two layers of CLIP ViT-B/32."""
    folder = tmp_path_factory.mktemp("published")
    checkpoint = write_clipseg(folder / "clipseg", FEW_WORDS, 352, base=PUBLISHED.clipseg)
    clip = write_clip(folder / "clip", SHALLOW, base=PUBLISHED.clip)
    yield Parity(checkpoint, folder / "bundle", 352, scene="clip-b32", clip=str(clip))
    shutil.rmtree(folder)


def test_clipsegs_maps_are_those_of_transformers_from_a_camera_frame_on(published: Parity) -> None:
    ours, theirs = published.maps(picture(640, 480, 1), WORDS)
    assert theirs.std() > 0.1
    assert mask_iou(ours, theirs) >= 0.998
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-4)


def test_a_tapped_whole_frame_is_the_embedding_that_transformers_makes_of_it(published: Parity) -> None:
    frame = picture(640, 480, 2)
    tapped = published.ours.example(published.ours.encode(frame), Box(0.0, 0.0, 1.0, 1.0))
    theirs = published.theirs.image_embedding(published.theirs.pixels(frame))
    assert cosine(tapped.vector, theirs) >= 0.9999


def test_the_papers_scene_embedding_is_nearly_that_of_transformers_from_weights_in_8_bits(
    published: Parity,
) -> None:
    frame = picture(640, 480, 2)
    checkpoint = published.checkpoint.with_name("clip")
    theirs = scene_embedding(checkpoint, frame)
    assert cosine(published.ours.embed(published.ours.encode(frame)), theirs) >= 0.9995
    stored = (published.bundle / "scene.weights").stat().st_size
    assert stored < 0.35 * (checkpoint / "model.safetensors").stat().st_size
