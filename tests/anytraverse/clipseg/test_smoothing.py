"""int8 stands a few large channels better when their size has moved into the weights."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from anytraverse.bundle.records import CheckRuntime
from anytraverse.export import making
from anytraverse.export.making import ClipSegCheckpoint, make_bundle
from anytraverse.export.random_weights import TINY, random_clipseg
from anytraverse.export.smoothing import smoothed
from anytraverse.perception import Prompt
from anytraverse.perception.clipseg.perceiver import ClipSeg

FRAME = np.random.default_rng(5).integers(0, 256, (64, 64, 3), dtype=np.uint8)
PROMPTS = [Prompt("grass"), Prompt("rock")]


@pytest.fixture
def lopsided() -> ClipSegCheckpoint:
    """A checkpoint whose normed activations have two channels twenty times as large as the rest."""
    checkpoint = random_clipseg(TINY)
    weights = dict(checkpoint.weights)
    for name, value in checkpoint.weights.items():
        if "vision_model.encoder" in name and "layer_norm" in name and name.endswith("weight"):
            weights[name] = value.copy()
            weights[name][[7, 30]] *= 20
    return ClipSegCheckpoint(
        checkpoint.architecture, weights, checkpoint.filter, checkpoint.tokenizer, checkpoint.source
    )


def test_smoothing_changes_nothing_in_full_precision(lopsided: ClipSegCheckpoint, tmp_path: Path) -> None:
    """Only rounding tells the two apart."""
    moved = smoothed(lopsided.weights, "clip.vision_model.encoder", TINY.vision.tower.layers)
    changed = ClipSegCheckpoint(TINY, moved, lopsided.filter, lopsided.tokenizer, lopsided.source)
    before, after = (_maps(one, tmp_path / name, "fp32") for one, name in ((lopsided, "a"), (changed, "b")))
    assert np.abs(before - after).max() < 1e-4
    assert not np.array_equal(
        moved["clip.vision_model.encoder.layers.0.mlp.fc1.weight"],
        lopsided.weights["clip.vision_model.encoder.layers.0.mlp.fc1.weight"],
    )


def test_int8_with_large_channels_is_nearer_to_fp32_when_smoothed(
    lopsided: ClipSegCheckpoint, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a third at least, here."""
    exact = _maps(lopsided, tmp_path / "smooth", "fp32")
    smooth = np.abs(_maps(lopsided, tmp_path / "smooth", "int8") - exact).mean()
    monkeypatch.setattr(making, "smoothed", lambda weights, *_: weights)
    rough = np.abs(_maps(lopsided, tmp_path / "rough", "int8") - exact).mean()
    assert smooth < 0.67 * rough


def test_smoothing_leaves_the_weights_it_was_given_alone(lopsided: ClipSegCheckpoint) -> None:
    """fp32 is made of the same ones."""
    kept = {name: array.copy() for name, array in lopsided.weights.items()}
    smoothed(lopsided.weights, "clip.vision_model.encoder", TINY.vision.tower.layers)
    assert all(np.array_equal(kept[name], lopsided.weights[name]) for name in kept)


def _maps(checkpoint: ClipSegCheckpoint, out: Path, precision: str) -> np.ndarray:
    if not out.exists():
        make_bundle(out, checkpoint, size=64, precisions=("fp32", "int8"), name="lopsided")
    perceiver = ClipSeg(str(out), CheckRuntime(precision=precision, threads=1))
    return perceiver.attend(perceiver.encode(FRAME), PROMPTS)
