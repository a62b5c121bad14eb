"""A tiny CLIPSeg of random weights, exported, checked and run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from anytraverse.bundle.manifest import manifest_digest
from anytraverse.bundle.records import CheckRuntime, read_record
from anytraverse.cli import main
from anytraverse.perception import Prompt, make_perceiver

pytest.importorskip("onnx", reason="exports need onnx")
pytest.importorskip("onnxruntime", reason="bundles need ONNX Runtime")

Out = pytest.CaptureFixture[str]


@pytest.fixture
def clipseg(tmp_path: Path) -> Path:
    """The bundle, with an int8 variant."""
    from anytraverse.export.making import make_bundle
    from anytraverse.export.random_weights import TINY, random_clipseg

    folder = tmp_path / "clipseg"
    make_bundle(folder, random_clipseg(TINY), size=64, precisions=("fp32", "int8"), name="tiny")
    return folder


def test_a_clipseg_bundle_is_checked_from_end_to_end(clipseg: Path, frames: Path, capsys: Out) -> None:
    command = ["bundle", "check", str(clipseg), "--frames", str(frames), "--threads", "1", "--json"]
    code = main([*command, "--repeat", "2"])
    found = json.loads(capsys.readouterr().out)
    record, _ = read_record(clipseg, manifest_digest(clipseg))
    assert record is not None
    assert code == (0 if record.passed else 1)
    assert found["variant"] == ("int8" if record.passed else "fp32")
    assert record.frames == 12
    assert record.cosine > 0.99
    assert record.iou_mean is not None
    assert record.iou_mean > 0.9
    assert set(found["milliseconds"]) == {"fp32", "int8"}
    assert found["milliseconds"]["fp32"]["new_word"] > 0
    assert found["peak_rss_mb"] > 10


def test_both_variants_see_nearly_the_same(clipseg: Path) -> None:
    image = np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    maps = []
    for precision in ("fp32", "int8"):
        eyes = make_perceiver(f"clipseg:{clipseg}", CheckRuntime(precision=precision, threads=1))
        maps.append(eyes.attend(eyes.encode(image), [Prompt("grass"), Prompt("rock")]))
    difference = float(np.abs(maps[0] - maps[1]).max())
    assert 0 < difference < 0.2
