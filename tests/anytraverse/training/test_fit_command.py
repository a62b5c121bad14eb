"""`anytraverse fit`: from a labelled folder to files by one command, and what it refuses."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from anytraverse.cli import main
from anytraverse.errors import TrainingError
from anytraverse.perception import Prompt, make_perceiver
from anytraverse.perception.builtin.calibration import Calibration
from anytraverse.perception.builtin.perceiver import SHIPPED
from anytraverse.training.calibration import FEWEST_FRAMES
from anytraverse.training.folders import read_folder

pytestmark = pytest.mark.needs_export

Out = pytest.CaptureFixture[str]


def last_line(told: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(told.splitlines()[-1])
    return found


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer things and views, so that the tests are fast."""
    monkeypatch.setattr("anytraverse.training.things.THINGS", 24)
    monkeypatch.setattr("anytraverse.training.calibration.VIEWS", {"as filmed": (1.0, 1.0, 1.0)})


def by_false_alarms(start: Path, *_: object, **__: object) -> Any:
    """Fit by false alarms alone, as it once was: the limits are so high that nothing is strange."""
    from anytraverse.training.fit import Fitted

    numbers = Calibration.load(start.with_suffix(".npz"))
    return Fitted(start, replace(numbers, limits=np.full(2, 1e6, np.float32)))


def test_few_frames_refit_the_shipped_network_and_a_worse_fit_does_not_replace_it(
    tiny_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Out
) -> None:
    from anytraverse.training.fitting import FitOptions

    monkeypatch.setattr("anytraverse.training.running.REFIT", FitOptions(steps=40, batch=4, rate=2e-4))
    out = tmp_path / "mine.onnx"
    words = ["fit", str(tiny_folder), "--out", str(out), "--validation", "1", "2", "--test", "3"]
    assert main(words) == 0
    told, progress = capsys.readouterr()
    assert "40/40 steps" in progress
    table = [
        line.split() for line in told.splitlines() if line.split()[0] in {"0100-0199", "0200-0299", "all"}
    ]
    assert [row[:2] for row in table] == [["0100-0199", "6"], ["0200-0299", "6"], ["all", "12"], ["all", "6"]]
    assert f'name = "builtin:{out}"' in told
    figures = last_line(told)
    assert figures["written"]
    assert figures["iou_pooled"] >= figures["iou_replaced_recalibrated"] >= figures["iou_replaced"]
    assert figures["iou_pooled"] > figures["iou_replaced"]
    assert figures["things_pasted"] > 20
    assert figures["things_noticed"] >= min(0.9, figures["things_noticed_replaced"]) - 0.03
    assert float(table[2][2]) == pytest.approx(figures["iou_pooled"], abs=6e-4)
    assert [drive["drive"] for drive in figures["test"]["drives"]] == ["0300-0399"]
    eyes = make_perceiver(f"builtin:{out}")
    seen = eyes.encode(read_folder(tiny_folder).frames[0].image)
    assert eyes.attend(seen, [Prompt("grass"), Prompt("sky")]).max() > 0.5, "a word explains some of it"

    written = out.read_bytes(), out.with_suffix(".npz").read_bytes()
    monkeypatch.setattr("anytraverse.training.running.fit_on", by_false_alarms)
    assert main([*words, "--json"]) == 1
    told, said = capsys.readouterr()
    refused = last_line(told)
    assert told.count("\n") == 1
    assert not refused["written"]
    assert refused["replaces"] == str(out)
    assert re.search(r"refused, worse than what it would replace: .* 0\.\d+ .*, before [01]\.\d+", said)
    assert (out.read_bytes(), out.with_suffix(".npz").read_bytes()) == written
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.npz", "mine.onnx"]


def test_a_calibration_that_hides_things_is_refused_and_is_not_advised_again(
    tiny_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Out
) -> None:
    monkeypatch.setattr("anytraverse.training.running.fit_on", by_false_alarms)
    out = tmp_path / "mine.onnx"
    words = ["fit", str(tiny_folder), "--out", str(out), "--validation", "1", "2", "--json"]
    assert main([*words, "--steps", "0"]) == 1
    told, said = capsys.readouterr()
    refused = last_line(told)
    assert refused["things_noticed"] < refused["things_noticed_replaced"] - 0.03
    assert "of 24 pasted things, before" in said
    assert "--steps 0" not in said
    assert "keep the network as it is" in said
    assert list(tmp_path.iterdir()) == []


def test_a_calibration_alone_keeps_the_weights_and_loses_no_things(
    tiny_folder: Path, tmp_path: Path, capsys: Out
) -> None:
    out = tmp_path / "mine.onnx"
    words = ["fit", str(tiny_folder), "--out", str(out), "--validation", "1", "2", "--steps", "0", "--json"]
    code = main(words)
    figures = last_line(capsys.readouterr().out)
    assert figures["written"] == (code == 0) == out.exists()
    if code == 0:
        assert out.read_bytes() == SHIPPED.read_bytes()
        assert figures["things_noticed"] >= min(0.9, figures["things_noticed_replaced"]) - 0.03


def test_a_calibration_that_changes_nothing_is_not_written(
    tiny_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Out
) -> None:
    from anytraverse.training.fit import Fitted

    monkeypatch.setattr(
        "anytraverse.training.running.fit_on",
        lambda start, *_: Fitted(start, Calibration.load(start.with_suffix(".npz"))),
    )
    out = tmp_path / "mine.onnx"
    words = ["fit", str(tiny_folder), "--out", str(out), "--validation", "1", "2", "--steps", "0", "--json"]
    assert main(words) == 1
    told, said = capsys.readouterr()
    figures = last_line(told)
    assert not figures["written"]
    assert figures["things_noticed"] == figures["things_noticed_replaced"]
    assert "no other calibration is better" in said or "refused" in said
    assert "--steps 0" not in said
    assert list(tmp_path.iterdir()) == []


def test_too_few_frames_choose_no_calibration(tiny_folder: Path, tmp_path: Path, capsys: Out) -> None:
    out = tmp_path / "mine.onnx"
    assert main(["fit", str(tiny_folder), "--out", str(out), "--validation", "1", "--steps", "0"]) == 2
    said = capsys.readouterr().err
    assert f"have 6 frames, and at least {FEWEST_FRAMES} must choose the calibration" in said
    assert not out.exists()


def test_photographs_of_things_are_split_between_the_training_and_the_check(
    tiny_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Out
) -> None:
    given: list[Any] = []

    def stopped(work: Any, _: Path) -> None:
        given.append(work.material)
        raise KeyboardInterrupt

    things = tmp_path / "things"
    (things / "more").mkdir(parents=True)
    for number in range(7):
        picture = np.full((300, 20, 4), 30 * number, np.uint8)
        cv2.imwrite(str(things / "more" / f"{number}.png"), picture)
    cv2.imwrite(str(things / "flat.png"), np.zeros((9, 9, 3), np.uint8))
    monkeypatch.setattr("anytraverse.training.running.trained", stopped)
    words = ["fit", str(tiny_folder), "--out", str(tmp_path / "mine.onnx"), "--validation", "1", "2"]
    assert main([*words, "--cutouts", str(things)]) == 130
    material = given[0]
    assert [int(one[0, 0, 0]) for one in material.kept_cutouts] == [0, 150]
    assert [int(one[0, 0, 0]) for one in material.cutouts] == [30, 60, 90, 120, 180]
    assert all(one.shape == (256, 17, 4) for one in material.cutouts)
    capsys.readouterr()


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_photographs_are_refused_before_the_training(
    tiny_folder: Path, tmp_path: Path, capsys: Out, count: int
) -> None:
    things = tmp_path / "things"
    things.mkdir()
    cv2.imwrite(str(things / "flat.png"), np.zeros((9, 9, 3), np.uint8))
    (things / "torn.png").write_bytes(b"torn")
    for number in range(count):
        cv2.imwrite(str(things / f"{number}.png"), np.zeros((9, 9, 4), np.uint8))
    words = ["fit", str(tiny_folder), "--out", str(tmp_path / "mine.onnx"), "--validation", "1", "2"]
    assert main([*words, "--cutouts", str(things)]) == 2
    assert f"holds {count} PNG pictures with an opacity channel" in capsys.readouterr().err
    assert main([*words, "--cutouts", str(tmp_path / "nowhere")]) == 2
    assert "give another --cutouts" in capsys.readouterr().err


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
    assert main(["fit", str(tiny_folder), "--validation", "1", "2"]) == 130
    assert capsys.readouterr().err == "stopped: nothing was written\n"
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_both_old_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from anytraverse.training.calibration import plain
    from anytraverse.training.fit import Fitted, write

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    out = tmp_path / "mine.onnx"
    write(Fitted(SHIPPED, plain()), out)
    written = [(path.name, path.read_bytes()) for path in sorted(tmp_path.iterdir())]
    monkeypatch.setattr(Calibration, "save", full)
    with pytest.raises(TrainingError, match=r"no space left.*make room .*Nothing was written"):
        write(Fitted(SHIPPED, replace(plain(), slope=1.0)), out)
    assert [(path.name, path.read_bytes()) for path in sorted(tmp_path.iterdir())] == written
    assert Calibration.load(out.with_suffix(".npz")).slope == plain().slope
