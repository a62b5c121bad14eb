"""The yardstick and what it is fed: that it computes what it claims to."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.clipseg.frames import make_frame

if TYPE_CHECKING:
    from bench.clipseg.checkpoints import Checkpoints
    from bench.clipseg.reference import Reference

pytestmark = pytest.mark.needs_export

WORDS = {"grass": 1.0, "dirt path": 0.5, "tree": -1.0}


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Checkpoints:
    from bench.clipseg.checkpoints import TINY, make_checkpoints

    return make_checkpoints(tmp_path_factory.mktemp("tiny"), TINY)


@pytest.fixture(scope="module")
def reference(tiny: Checkpoints) -> Reference:
    from bench.clipseg.reference import Reference

    made = Reference(tiny.clipseg, tiny.clip)
    made.set_prompts(list(WORDS), list(WORDS.values()))
    return made


def test_maps_are_those_of_the_whole_model_with_every_prompt(tiny: Checkpoints, reference: Reference) -> None:
    import torch
    from transformers import AutoTokenizer, CLIPSegForImageSegmentation

    from bench.clipseg.pixels import Pixels

    frame = make_frame(80, 60, 1)
    model: Any = CLIPSegForImageSegmentation.from_pretrained(tiny.clipseg).eval()
    tokens = AutoTokenizer.from_pretrained(tiny.clipseg)(list(WORDS), padding=True, return_tensors="pt")
    with torch.no_grad():
        pixels = Pixels.read(tiny.clipseg).of(frame).repeat(len(WORDS), 1, 1, 1)
        probabilities = torch.sigmoid(model(pixel_values=pixels, **tokens).logits)[:, None]
        expected = torch.nn.functional.interpolate(probabilities, size=(60, 80), mode="bilinear")[:, 0]
    np.testing.assert_allclose(reference.step(frame).maps, expected.numpy(), atol=1e-5)


def test_pooling_is_the_papers_at_the_frames_size(reference: Reference) -> None:
    step = reference.step(make_frame(80, 60, 2))
    weighted = step.maps * np.array(list(WORDS.values()))[:, None, None]
    winner = np.abs(weighted).argmax(axis=0)[None]
    traversability = np.take_along_axis(weighted, winner, axis=0)[0].clip(0, 1)
    np.testing.assert_allclose(step.traversability, traversability, atol=1e-6)
    np.testing.assert_allclose(step.uncertainty, 1 - step.maps.max(axis=0), atol=1e-6)
    roi = np.s_[36:58, 26:54]  # from int(60 * 0.6) to int(60 * 0.95), from int(80 * 0.333) to int(80 * 0.667)
    assert step.roi_uncertainty == pytest.approx(float(step.uncertainty[roi].mean()), abs=1e-6)
    assert step.roi_traversability == pytest.approx(float(step.traversability[roi].mean()), abs=1e-6)


def test_the_embedding_has_unit_length_and_words_are_embedded_once(reference: Reference) -> None:
    reference.step(make_frame(80, 60, 4))
    reference.parts.take()
    step = reference.step(make_frame(80, 60, 5))
    assert float(np.linalg.norm(step.embedding)) == pytest.approx(1.0, abs=1e-5)
    taken = reference.parts.take()
    assert {"scene", "resize", "tower", "decoder", "maps", "pooling"} <= set(taken)
    assert len(reference._cache) == 1


@pytest.mark.parametrize("size", [(640, 480), (480, 640), (96, 96), (41, 97)])
def test_pixel_values_are_those_of_transformers_own_processors(
    tiny: Checkpoints, size: tuple[int, int]
) -> None:
    pillow = pytest.importorskip("PIL.Image", reason="the extra `export` is not installed")
    clip = pytest.importorskip(
        "transformers.models.clip.image_processing_pil_clip", reason="this transformers has no Pillow backend"
    )
    vit = pytest.importorskip("transformers.models.vit.image_processing_pil_vit")
    from bench.clipseg.pixels import Pixels

    frame = make_frame(*size, 1)
    for folder, processor in (
        (tiny.clipseg, vit.ViTImageProcessorPil),
        (tiny.clip, clip.CLIPImageProcessorPil),
    ):
        made = processor.from_pretrained(folder)(images=pillow.fromarray(frame), return_tensors="pt")
        one_level = 1 / (255 * min(Pixels.read(folder).deviation))
        found = Pixels.read(folder).of(frame)
        assert found.shape == made["pixel_values"].shape
        np.testing.assert_allclose(found.numpy(), made["pixel_values"].numpy(), atol=1.01 * one_level)


def test_the_same_checkpoint_is_made_once_and_another_seed_anew(tmp_path: Path) -> None:
    from bench.clipseg.checkpoints import TINY, make_checkpoints

    def weights() -> bytes:
        return (make_checkpoints(tmp_path, TINY, seed).clipseg / "model.safetensors").read_bytes()

    seed = 1
    first = weights()
    (tmp_path / "clipseg/kept").touch()
    assert weights() == first
    assert (tmp_path / "clipseg/kept").exists()
    seed = 2
    assert weights() != first
    assert not (tmp_path / "clipseg/kept").exists()
    seed = 1
    assert weights() == first
