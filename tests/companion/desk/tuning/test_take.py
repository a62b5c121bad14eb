"""A chosen setting is written into the configuration, whose comments stay."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import tomllib

from companion.cli import main as companion
from companion.config import load_config
from companion.vision.warm_up import load_engine
from tests.companion.desk.drives.filmed import CONFIG

Out = pytest.CaptureFixture[str]
OTHER = {"scene": 0.91, "roi": 0.25, "tile": None, "region": [0.3, 0.5, 0.7, 0.95]}

STOPS = ("mount.height=0.6", "mount.tilt=10", "stopping.speed=1.2")


@pytest.fixture
def rover(tmp_path: Path) -> Path:
    """A configuration with comments, and what `companion tune` found for it."""
    file = tmp_path / "companion.toml"
    text = CONFIG.replace("left = 0.35", "left = 0.35  # measured on Monday").replace(
        "source =", "# mine\nsource ="
    )
    file.write_text(text)
    (tmp_path / "pictures").mkdir()
    config = load_config(file)
    engine, _ = load_engine(config, None)
    limits = engine.settings.thresholds
    same = {
        "scene": limits.scene,
        "roi": limits.roi,
        "tile": limits.tile,
        "region": [0.35, 0.46, 0.65, 0.95],
    }
    late = {**OTHER, "too_late": True}
    told = {
        "model": engine.perceiver.model_id,
        "prompts": config.preferences.format(),
        "each": [same, {**OTHER, "warnings": ["WARNING: it may be blind"]}, late, {"roi": 7}],
    }
    (tmp_path / "tuning.json").write_text(json.dumps(told))
    return file


def take(rover: Path, number: int, *more: str) -> int:
    source = str(rover.with_name("tuning.json"))
    return companion(["tune", "--take", str(number), "--from", source, *more])


def test_it_is_written_and_the_comments_stay(rover: Path, capsys: Out) -> None:
    assert take(rover, 1, "--write", str(rover)) == 0
    said = capsys.readouterr().out
    assert "WARNING: it may be blind" in said
    assert "+left = 0.3" in said
    text = rover.read_text()
    assert "left = 0.3  # measured on Monday" in text
    assert "# mine\n" in text
    found = tomllib.loads(text)
    assert found["thresholds"] == {"roi": 0.25, "scene": 0.91, "tile": "off"}
    assert load_config(rover).roi.right == 0.7
    assert rover.with_name("companion.toml.1").read_text().count("left = 0.35") == 1
    assert take(rover, 1, "--write", str(rover)) == 0
    assert "in force" in capsys.readouterr().out


def test_without_write_it_is_only_shown(rover: Path, capsys: Out) -> None:
    before = rover.read_text()
    assert take(rover, 1, "--config", str(rover)) == 0
    said = capsys.readouterr()
    assert 'tile = "off"' in said.out
    assert "None" not in said.err
    assert rover.read_text() == before


def test_a_region_in_metres_is_not_replaced_by_sides_that_would_not_be_in_force(
    rover: Path, capsys: Out
) -> None:
    brakes = ("stopping.speed=0.5", "stopping.braking=2", "stopping.time_constant=0.3")
    mount = ("mount.height=0.8", "mount.tilt=10", "mount.width=0.3")
    assert companion(["config", "set", "--yes", str(rover), *mount, *brakes]) == 0
    config = load_config(rover)
    engine, _ = load_engine(config, None)
    assert engine.settings.metres is not None
    bounds = engine.settings.region.bounds
    own = [bounds.left, bounds.top, bounds.right, bounds.bottom]
    wider = [bounds.left - 0.05, *own[1:]]
    changed(rover, each=[{**OTHER, "region": wider}, {**OTHER, "region": own}])
    before = rover.read_text()
    assert take(rover, 0, "--write", str(rover)) == 2
    assert "is in metres, and setting 0 has another: set [roi] near, far and" in capsys.readouterr().err
    assert rover.read_text() == before
    assert take(rover, 1, "--write", str(rover)) == 0
    assert load_config(rover).thresholds.roi == 0.25


def changed(rover: Path, **more: Any) -> None:
    source = rover.with_name("tuning.json")
    source.write_text(json.dumps(json.loads(source.read_text()) | more))


def test_words_that_changed_meanwhile_are_told(rover: Path, capsys: Out) -> None:
    changed(rover, prompts="rock: -1")
    assert take(rover, 1, "--config", str(rover)) == 0
    assert "WARNING: it was judged with the words rock: -1" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "change", "why"),
    [
        (2, {}, "too late to stop"),
        (3, {}, "no setting that can be used"),
        (4, {}, "it has 0 to 3"),
        (-1, {}, "it has 0 to 3"),
        (1, {"model": "another-net"}, "run the command anew"),
        (1, {"each": 5}, "tuning.json or calls.json"),
        (0, {"each": ["x"]}, "tuning.json or calls.json"),
        (0, {"each": [{**OTHER, "region": [0.45, 0.5, 0.5, 0.95]}]}, "cannot take setting 0"),
    ],
)
def test_what_cannot_be_taken_is_refused_and_the_file_stays(
    rover: Path, capsys: Out, number: int, change: dict[str, Any], why: str
) -> None:
    changed(rover, **change)
    before = rover.read_text()
    assert take(rover, number, "--write", str(rover)) == 2
    error = capsys.readouterr().err
    assert why in error
    assert "Traceback" not in error
    assert rover.read_text() == before


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tuning.json", "calls.json"])
def test_what_is_seen_too_late_by_the_configuration_of_now_is_refused(
    rover: Path, capsys: Out, name: str
) -> None:
    assert companion(["config", "set", str(rover), "--yes", *STOPS]) == 0
    row = {**OTHER, "region": [0.35, 0.9, 0.65, 0.95]}
    changed(rover, each=[row])
    source = rover.with_name(name)
    rover.with_name("tuning.json").rename(source)
    before = rover.read_text()
    assert companion(["tune", "--take", "0", "--from", str(source), "--write", str(rover)]) == 2
    assert "too late to stop" in capsys.readouterr().err
    assert rover.read_text() == before


def test_a_file_of_something_else_is_refused(rover: Path, capsys: Out) -> None:
    rover.with_name("tuning.json").write_bytes(b"\x00[[[")
    assert take(rover, 0, "--write", str(rover)) == 2
    assert "tuning.json or calls.json" in capsys.readouterr().err


def test_take_needs_no_drive_and_a_drive_needs_no_take(rover: Path, capsys: Out) -> None:
    assert companion(["tune", "--write", str(rover)]) == 2
    assert "--take N" in capsys.readouterr().err
