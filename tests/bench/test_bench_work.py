"""Floating-point work of the published models."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from bench.clipseg.checkpoints import PUBLISHED
from bench.clipseg.frames import COUNTS
from bench.clipseg.lineup import OURS, REFERENCE
from bench.clipseg.report import count_work
from bench.clipseg.work import clipseg_work, dense_image, dense_scores, read_clip, read_clipseg


@pytest.fixture
def published(tmp_path: Path) -> Path:
    """A folder with the configurations alone: nothing here needs the weights."""

    def write(name: str, config: dict[str, Any], image: int) -> None:
        (tmp_path / name).mkdir()
        (tmp_path / name / "config.json").write_text(json.dumps(config))
        size = {"size": {"height": image, "width": image}}
        (tmp_path / name / "preprocessor_config.json").write_text(json.dumps(size))

    write("clipseg", PUBLISHED.clipseg, PUBLISHED.clipseg_image)
    write("clip", PUBLISHED.clip, PUBLISHED.clip_image)
    return tmp_path


def test_clipsegs_work_is_that_of_22_by_22_patches_and_12_layers(published: Path) -> None:
    net = read_clipseg(published / "clipseg")
    assert (net.vision.tokens, net.needed) == (485, 10)
    assert net.tower_whole() / 1e9 == pytest.approx(91.6, abs=0.05)
    assert net.tower_needed() / 1e9 == pytest.approx(76.5, abs=0.05)
    assert net.tail() / 1e9 == pytest.approx(8.75, abs=0.01)
    assert net.decoder() / 1e9 == pytest.approx(1.07, abs=0.01)


def test_the_scene_encoders_work_is_that_of_50_tokens(published: Path) -> None:
    scene = read_clip(published / "clip")
    assert scene.tokens == 50
    assert scene.tower(12) / 1e9 == pytest.approx(8.8, abs=0.05)


def test_a_smaller_size_is_less_work_by_its_patches(published: Path) -> None:
    whole, small = (read_clipseg(published / "clipseg", size) for size in (None, 224))
    assert small == clipseg_work(PUBLISHED.clipseg, 224)
    assert small.vision.tokens == 197
    assert small.tower_needed() / whole.tower_needed() == pytest.approx(0.38, abs=0.01)


def test_a_dense_models_work_is_that_of_its_patches_and_of_siglips_head() -> None:
    pytest.importorskip("onnx", reason="the random models need it")
    layers = 12 * 2.0 * 256 * (12 * 768**2 + 2 * 256 * 768)
    head = 2.0 * 256 * 11 * 768**2
    assert dense_image("siglip", 256) == pytest.approx(layers + head, rel=0.01)
    assert dense_image("tipsv2", 448) / 1e9 == pytest.approx(214, abs=1)
    assert dense_scores("tipsv2", 448) == 2.0 * 32 * 32 * 768


def test_the_decoder_grows_with_the_prompts_and_the_tower_does_not(published: Path) -> None:
    pytest.importorskip("onnx", reason="the random models need it")
    works = [count_work(published, count) for count in COUNTS]
    assert set(works[0]) == {REFERENCE, *OURS}
    for name in works[0]:
        maps = "scores" if "scores" in works[0][name] else "decoder"
        assert works[0][name]["tower"] == works[2][name]["tower"]
        assert works[2][name][maps] == 8 * works[0][name][maps]
    assert works[0]["fp32"]["decoder"] < works[0][REFERENCE]["decoder"]
