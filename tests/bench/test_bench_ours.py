"""This project's step, as the benchmark runs it, does what the authors' does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench.clipseg.frames import make_frame

for _package in ("torch", "transformers", "onnx", "onnxruntime"):
    pytest.importorskip(_package, reason="the extra `export` is not installed")


@pytest.mark.parametrize(
    ("scene", "part", "precision"), [("shared", "tail", "int8"), ("clip-b32", "scene", "fp32")]
)
def test_it_finds_what_the_authors_step_finds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, scene: str, part: str, precision: str
) -> None:
    from bench.clipseg import ours, reference
    from bench.clipseg.checkpoints import TINY, make_checkpoints

    made = make_checkpoints(tmp_path, TINY)
    command = ["ours", str(made.clipseg), str(made.clip), str(tmp_path / "bundle"), scene, "fp32", "int8"]
    monkeypatch.setattr("sys.argv", command)
    ours.main()
    theirs = reference.make(str(made.clipseg), str(made.clip), threads=1)
    contestant = ours.Ours(str(tmp_path / "bundle"), precision, threads=1)
    for each in (contestant, theirs):
        each.set_prompts(["grass", "tree"], [1.0, -1.0])
    frame = make_frame(128, 96, 1)
    found, expected = contestant.figures(frame), theirs.figures(frame)
    assert found.roi_uncertainty == pytest.approx(expected.roi_uncertainty, abs=0.05)
    assert found.roi_traversability == pytest.approx(expected.roi_traversability, abs=0.05)
    assert np.linalg.norm(found.embedding) == pytest.approx(1.0, abs=1e-5)
    assert set(contestant.parts.take()) == {"resize", "tower", part, "decoder", "pooling"}
    if scene == "clip-b32":
        assert np.dot(found.embedding, expected.embedding) > 0.999
