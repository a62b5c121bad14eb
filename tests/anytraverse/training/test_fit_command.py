"""`anytraverse fit`: from a labelled folder to files by one command, and what it refuses."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anytraverse.cli import main
from anytraverse.errors import TrainingError
from anytraverse.perception import Prompt, make_perceiver
from anytraverse.training.folders import read_folder

pytestmark = pytest.mark.needs_export

Out = pytest.CaptureFixture[str]


def last_line(told: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(told.splitlines()[-1])
    return found


def test_few_frames_refit_the_shipped_network_and_a_worse_fit_does_not_replace_it(
    tiny_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Out
) -> None:
    from anytraverse.training.fitting import Options

    monkeypatch.setattr("anytraverse.training.running.REFIT", Options(steps=12, batch=4, rate=2e-3))
    out = tmp_path / "mine.onnx"
    words = ["fit", str(tiny_folder), "--out", str(out), "--validation", "1", "2", "--test", "3"]
    assert main(words) == 0
    told, progress = capsys.readouterr()
    assert "12/12 steps" in progress
    table = [
        line.split() for line in told.splitlines() if line.split()[0] in {"0100-0199", "0200-0299", "all"}
    ]
    assert [row[:2] for row in table] == [["0100-0199", "6"], ["0200-0299", "6"], ["all", "12"], ["all", "6"]]
    assert f'name = "builtin:{out}"' in told
    figures = last_line(told)
    assert figures["written"]
    assert figures["iou_pooled"] > figures["iou_replaced_recalibrated"] > figures["iou_replaced"]
    assert float(table[2][2]) == pytest.approx(figures["iou_pooled"], abs=6e-4)
    assert [drive["drive"] for drive in figures["test"]["drives"]] == ["0300-0399"]
    eyes = make_perceiver(f"builtin:{out}")
    seen = eyes.encode(read_folder(tiny_folder).frames[0].image)
    assert eyes.attend(seen, [Prompt("grass")]).max() > 0.9

    written = out.read_bytes(), out.with_suffix(".npz").read_bytes()
    assert main([*words, "--from", "scratch", "--steps", "2", "--json"]) == 1
    told, said = capsys.readouterr()
    refused = last_line(told)
    assert told.count("\n") == 1
    assert not refused["written"]
    assert refused["replaces"] == str(out)
    assert refused["iou_pooled"] < refused["iou_replaced"]
    both = re.search(r"drivable IoU (0\.\d+), before (0\.\d+)", said)
    assert both
    assert float(both[1]) == pytest.approx(refused["iou_pooled"], abs=6e-4)
    assert float(both[2]) >= refused["iou_replaced"] - 6e-4
    assert (out.read_bytes(), out.with_suffix(".npz").read_bytes()) == written
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.npz", "mine.onnx"]


def without_first_drive(folder: Path) -> None:
    for path in [path for path in folder.glob("0*.*") if path.name[1] != "0"]:
        path.unlink()


def without_names(folder: Path) -> None:
    (folder / "classes.json").unlink()


def without_ground(folder: Path) -> None:
    (folder / "classes.json").write_text(json.dumps({"classes": ["sky", "bush", "tree"], "ignore": 3}))


def without_known_names(folder: Path) -> None:
    (folder / "classes.json").write_text(json.dumps({"classes": ["gnome", "elf", "troll"], "ignore": 3}))


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (without_first_drive, "a hundred of its own"),
        (without_names, "classes.json is missing: write"),
        (without_ground, "label the ground that may be driven"),
        (without_known_names, "no label of"),
        (shutil.rmtree, "is not a folder"),
    ],
)
def test_a_folder_that_teaches_nothing_is_refused_before_the_training(
    tiny_folder: Path, tmp_path: Path, capsys: Out, spoil: Any, told: str
) -> None:
    folder = Path(shutil.copytree(tiny_folder, tmp_path / "copy"))
    spoil(folder)
    assert main(["fit", str(folder), "--out", str(tmp_path / "out" / "mine.onnx")]) == 2
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--out", "mine.pt"], "ends in .onnx"),
        (["--validation", "9"], "has no drive 9: its blocks of a hundred numbers are 0, 1, 2, 3"),
        (["--validation", "2", "--test", "2"], "choose one of them"),
        (["--from", "scratch", "--steps", "0"], "--steps 0 needs a network to begin from"),
        (["--from", "nowhere.onnx"], "nowhere.onnx"),
        (["--threads", "0"], "--threads"),
        (["--out", "classes.json/mine.onnx"], "classes.json/mine.onnx cannot be written"),
        (["--out", "torn.onnx"], "remove it or give another --out"),
    ],
)
def test_options_that_cannot_be_used_are_refused_before_the_training(
    tiny_folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: Out,
    words: list[str],
    told: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "classes.json").touch()
    (tmp_path / "torn.onnx").write_bytes(b"torn")
    assert main(["fit", str(tiny_folder), *words]) == 2
    assert told in capsys.readouterr().err


def test_ctrl_c_writes_nothing(
    tiny_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Out
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("anytraverse.training.running.fit_on", interrupted)
    monkeypatch.chdir(tmp_path)
    assert main(["fit", str(tiny_folder)]) == 130
    assert capsys.readouterr().err == "stopped: nothing was written\n"
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_both_old_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import torch

    from anytraverse.perception.builtin.network import Calibration
    from anytraverse.training.calibration import plain
    from anytraverse.training.fit import Fitted, write
    from anytraverse.training.net import GroundNet

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    torch.manual_seed(0)
    out = tmp_path / "mine.onnx"
    write(Fitted(GroundNet(wide=0.5), plain()), out)
    written = [(path.name, path.read_bytes()) for path in sorted(tmp_path.iterdir())]
    monkeypatch.setattr(Calibration, "save", full)
    with pytest.raises(TrainingError, match=r"no space left.*make room .*Nothing was written"):
        write(Fitted(GroundNet(wide=0.5), plain()), out)
    assert [(path.name, path.read_bytes()) for path in sorted(tmp_path.iterdir())] == written
    assert np.isfinite(Calibration.load(out.with_suffix(".npz")).gamma)
