"""From a labelled folder to files by one command, and what it refuses."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from anytraverse.perception.ground_net import Calibration

pytestmark = pytest.mark.needs_export


def run(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    from anytraverse.training import __main__ as command

    monkeypatch.setattr(sys, "argv", ["training", *words])
    return command.main()


def test_a_folder_becomes_a_network_that_a_worse_one_does_not_replace(
    tiny_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from anytraverse.training.fit import stored

    out = tmp_path / "net.onnx"
    words = (str(tiny_folder), "--out", str(out), "--validation", "2", "--test", "3", "--seed", "1")
    assert run(monkeypatch, *words, "--steps", "30") == 0
    told = capsys.readouterr().out
    assert "validation, blocks 2" in told
    assert "test, blocks 3" in told
    network, calibration = stored(out)
    assert isinstance(calibration, Calibration)
    assert network(np.zeros((480, 640, 3), np.uint8))[0].shape == (8, 48, 64)
    written = out.read_bytes()
    assert run(monkeypatch, *words, "--steps", "2") == 1
    assert "worse than what it would replace" in capsys.readouterr().err
    assert out.read_bytes() == written


def test_a_folder_of_one_drive_is_refused(
    tmp_path: Path, tiny_folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for path in tiny_folder.iterdir():
        if path.name.startswith(("00", "classes")):
            (tmp_path / path.name).write_bytes(path.read_bytes())
    assert run(monkeypatch, str(tmp_path), "--out", str(tmp_path / "net.onnx")) == 1
    assert "a hundred of its own" in capsys.readouterr().err
