"""Floating-point work of the published models."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from bench.clipseg.checkpoints import PUBLISHED
from bench.clipseg.frames import COUNTS
from bench.clipseg.report import count_work
from bench.clipseg.results import OURS, REFERENCE
from bench.clipseg.work import read_clip, read_clipseg


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


def test_a_last_layer_for_one_token_is_less_work_than_for_all(published: Path) -> None:
    scene = read_clip(published / "clip")
    whole = scene.tower(12) + scene.tail(12)
    assert 0.9 * whole < scene.tower(11) + scene.tail(11) < whole


def test_the_decoder_grows_with_the_prompts_and_the_tower_does_not(published: Path) -> None:
    works = [count_work(published / "clipseg", published / "clip", count) for count in COUNTS]
    for name in (REFERENCE, *OURS):
        assert works[0][name]["tower"] == works[2][name]["tower"]
        assert works[2][name]["decoder"] == 8 * works[0][name]["decoder"]
    assert works[0]["fp32"]["decoder"] < works[0][REFERENCE]["decoder"]
