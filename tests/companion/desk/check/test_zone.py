"""`companion check --zone`: a person carries a drum in the simulated field; where is it noticed?"""

from __future__ import annotations

import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Protocol

import pytest

from companion.config import load_config
from companion.config.stopping import ground_region
from companion.desk.check import zone, zone_judge
from companion.desk.check.autopilot import AutopilotReadings
from companion.desk.check.rover import CheckedRover
from companion.desk.check.stopping import check_zone
from companion.desk.check.typed_lines import TypedLines
from companion.desk.check.zone import measure_zone
from companion.desk.check.zone_file import Zone, read_zone_files
from companion.sim.demo.config import write_config
from tests.companion.desk.check.zone_field import Answers, Person, StandingField


@pytest.fixture(scope="module")
def rover() -> Iterator[StandingField]:
    with closing(StandingField()) as made:
        yield made


@pytest.fixture
def field(rover: StandingField) -> StandingField:
    """A rover before which nothing stands."""
    rover.blind = False
    rover.take_away()
    return rover


@pytest.fixture
def config(tmp_path: Path, field: StandingField) -> Path:
    link = "udpout:127.0.0.1:9"
    return write_config(
        tmp_path, camera=field.source, link=link, policy="hold", speed=0.8, guide=True, rate=20.0
    )


class Walk(Protocol):
    def __call__(self, answers: Answers, *, kind: type[Person] = Person, code: int = 0) -> Person: ...


@pytest.fixture
def walk(
    field: StandingField, config: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Walk:
    """Leads a person through the command, who stands at each mark for a moment, and returns them."""
    monkeypatch.setattr(zone_judge, "LASTS", 0.0)
    monkeypatch.setattr(zone_judge, "FRAMES", 4)
    monkeypatch.setattr(zone_judge, "SILENT", 0.5)

    def led(answers: Answers, *, kind: type[Person] = Person, code: int = 0) -> Person:
        person = kind(field, lambda: capsys.readouterr().out, answers)
        assert measure_zone(str(config), person) == code
        person.said += capsys.readouterr().out
        return person

    return led


def kept(folder: Path) -> Zone:
    (found,), _ = read_zone_files(folder / "state")
    return found


def test_a_drum_is_noticed_in_the_region_and_not_beyond_it(walk: Walk, config: Path, tmp_path: Path) -> None:
    ground = ground_region(load_config(config))
    assert ground is not None
    inside, outside = round(ground.far - 0.5, 1), round(ground.far + 0.7, 1)
    person = walk({"Distances": [f"1.5 {inside} {outside}"], "What": ["a drum"]})
    found = kept(tmp_path)
    noticed = {(one.line, one.distance_m): one.noticed for one in found.marks}
    assert len(noticed) == 20, "and at what stopping needs"
    for line in ("left side", "ahead", "right side"):
        assert [noticed[line, at] for at in (1.5, inside, outside)] == [True, True, False], person.said
    for line in ("left edge", "right edge"):
        assert not any(noticed[line, at] for at in (inside, outside)), "beside the region"
    for one in found.marks:
        assert one.in_picture, one
        assert one.ground_m == pytest.approx(one.distance_m, rel=0.18, abs=0.3), "to a cell"
        assert one.ground_deg == pytest.approx(one.bearing_deg, abs=4.0)
        assert one.light is not None
    assert found.thing == "a drum"
    assert found.covers is True, found.verdict
    assert 0.2 < found.arcs[0].share < 0.8, "in the middle"
    assert found.verdict in person.said
    assert "something noticed in 0 of" in person.said
    assert person.said.count("\a") == len(noticed), "a bell at the end of each"
    assert "without the autopilot's own overrun" in found.verdict
    checked = CheckedRover(load_config(str(config)), "", tmp_path / "state")
    checked.__dict__["asked"] = AutopilotReadings()
    (row,) = check_zone(checked)
    assert row.verdict.name == "PASS", row.text


def test_a_thing_that_lies_in_the_way_is_not_noticed_at_the_marks(
    walk: Walk, field: StandingField, tmp_path: Path
) -> None:
    class LeavesIt(Person):
        def line(self, seconds: float) -> str | None:
            answer = super().line(seconds)
            if self.marks:
                field.put(1.8, 0.0)
            return answer

    person = walk({"Last": ["n"], "Distances": ["1.5 4"]}, kind=LeavesIt)
    found = kept(tmp_path)
    marks = {(one.line, one.distance_m): one for one in found.marks}
    assert not marks["ahead", 4.0].noticed
    assert marks["ahead", 4.0].elsewhere
    assert not marks["left edge", 1.5].noticed
    assert "noticed, but not the thing on the mark" in person.said
    assert found.clear is False
    assert found.covers is not True, found.verdict


def test_what_was_measured_is_kept_when_the_person_ends(walk: Walk, tmp_path: Path) -> None:
    for end in ("q", EOFError(), KeyboardInterrupt()):
        walk({"ahead, 2": [end], "Distances": ["2.7"]})
        (*_, found), _ = read_zone_files(tmp_path / "state")
        assert [one.line for one in found.marks] == ["left edge", "left side"]
        assert found.covers is not True, "the rest is not known"


def test_the_data_folder_is_made_with_the_rights_of_who_owns_the_place(
    walk: Walk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    state, entered = tmp_path / "state", list[tuple[Path, bool]]()

    @contextmanager
    def spy(folder: Path) -> Iterator[None]:
        entered.append((folder, state.exists()))
        yield

    monkeypatch.setattr(zone, "as_owner", spy)
    walk({"left side": ["q"], "Distances": ["2.7"]})
    assert entered[:2] == [(state, False)] * 2
    assert state.exists()


def test_keys_go_back_and_to_the_next_line_and_other_keys_are_explained(walk: Walk, tmp_path: Path) -> None:
    person = walk(
        {
            "Distances": ["two", "-1", "2, 2,7"],
            "left edge": ["n"],
            "left side, 2 ": ["b", "x", "0"],
            "ahead, 2.7": ["q"],
        }
    )
    assert person.said.count("give metres between 0.1 and 100") == 2
    assert person.said.count("b: the mark before") == 2, "at first, and after x"
    assert [at for line, at in person.marks if line == "left side"][:3] == [2.7, 2.0, 2.7]
    assert sorted((one.line, one.distance_m) for one in kept(tmp_path).marks) == [
        ("left side", 2.0),
        ("left side", 2.7),
    ]


def test_ground_that_would_stop_the_rover_by_itself_is_not_measured_on(
    walk: Walk, config: Path, tmp_path: Path
) -> None:
    text = config.read_text().replace('"dirt path" = 1.0', '"dirt path" = -1.0')
    config.write_text(text.replace('"grass" = 1.0', '"grass" = -1.0'))
    person = walk({"Go out": ["", "q"]}, code=1)
    assert "the empty ground would stop the rover in" in person.said
    assert "no mark was measured" in person.said
    assert read_zone_files(tmp_path / "state") == ([], [])


def test_a_camera_that_falls_silent_is_said_and_the_mark_is_asked_for_again(
    walk: Walk, field: StandingField, tmp_path: Path
) -> None:
    class Unplugs(Person):
        def line(self, seconds: float) -> str | None:
            answer = super().line(seconds)
            field.blind = len(self.marks) == 2
            return answer

    person = walk({"left side": ["q"], "Distances": ["2 2.7"]}, kind=Unplugs)
    assert "not measured: the camera is silent" in person.said
    assert person.marks[1] == person.marks[2]
    assert len(kept(tmp_path).marks) == 2


def test_a_frozen_camera_measures_no_mark(
    walk: Walk, field: StandingField, config: Path, tmp_path: Path
) -> None:
    (tmp_path / "frames").mkdir()
    (tmp_path / "frames" / "0.png").write_bytes(field.png())
    still = config.read_text().replace(field.source, f"folder:{tmp_path}/frames")
    config.write_text(still.replace("[camera]", "[camera]\nloop = true"))
    person = walk({"left edge": ["", "q"]}, code=1)
    assert "the camera is frozen" in person.said


def test_a_companion_that_runs_keeps_its_camera(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = write_config(tmp_path, camera="field:127.0.0.1:9", link="udpout:127.0.0.1:9", policy="report")
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / "status.json").write_text(json.dumps({"pid": os.getpid()}))
    assert measure_zone(str(config)) == 1
    assert "sudo systemctl stop companion" in capsys.readouterr().out


def test_a_line_is_waited_for_no_longer_than_asked() -> None:
    reads, writes = os.pipe()
    keys = TypedLines(reads)
    assert keys.line(0.01) is None
    os.write(writes, b" two\r\nli")
    assert keys.line(1.0) == "two"
    assert keys.line(0.01) is None
    os.write(writes, b"nes\n" + b"x" * 5000 + b"\n")
    assert keys.line(1.0) == "lines"
    assert set(keys.line(1.0) or "") == {"x"}
    os.close(writes)
    with pytest.raises(EOFError):
        keys.line(1.0)
    os.close(reads)


class Terminal:
    """`companion check --zone` as it is typed, in a terminal of its own."""

    def __init__(self, config: Path) -> None:
        self._ours, theirs = pty.openpty()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "companion", "check", "--zone", "--config", str(config)],
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            start_new_session=True,
        )
        os.close(theirs)
        self.said = ""

    def until(self, question: str, seconds: float = 40.0) -> re.Match[str]:
        """Wait until the program asks that: a regular expression at the end of what it said."""
        deadline = time.monotonic() + seconds
        while not (found := re.search(question + r" $", self.said)):
            assert time.monotonic() < deadline, self.said
            if select.select([self._ours], [], [], 0.2)[0]:
                self.said += os.read(self._ours, 4096).decode()
        return found

    def type(self, text: str) -> None:
        os.write(self._ours, text.encode())
        self.said += "\n"

    def end(self) -> int:
        """Read to the end, and return the exit code."""
        deadline = time.monotonic() + 20.0
        with suppress(OSError):  # the other end is closed
            while time.monotonic() < deadline:
                if select.select([self._ours], [], [], 0.2)[0]:
                    self.said += os.read(self._ours, 4096).decode()
        os.close(self._ours)
        assert time.monotonic() < deadline, self.said
        return self.process.wait(20.0)


@pytest.mark.slow
def test_the_command_in_a_terminal_is_led_through_marks_and_ended_by_ctrl_c(
    field: StandingField, config: Path, tmp_path: Path
) -> None:
    terminal = Terminal(config)
    try:
        terminal.until(r"Distances in m \(Enter takes [^)]*\):")
        terminal.type("2 4\n")
        terminal.until(r"Distances in m \(Enter takes 2 2.7 4\):")
        terminal.type("\n")
        terminal.until(r"carried[^:]*\?")
        terminal.type("a drum\n")
        terminal.until(r"Enter:")
        terminal.type("\n\n\n")  # typed twice too often: no mark is measured by it
        walked = [f"{line}, {at}" for line in ("left edge", "left side") for at in ("4", "2.7", "2")]
        for place in (*walked, "ahead, 4"):
            asked = terminal.until(rf"{place} m \(([\d.]+) ahead(?:, ([\d.]+) left)?\):")
            field.put(float(asked[1]), -float(asked[2] or 0))
            terminal.type("\n")
        terminal.until(r"ahead, 2.7 m [^:]*:")
        terminal.process.send_signal(signal.SIGINT)
        assert terminal.end() == 0, terminal.said
    finally:
        terminal.process.kill()
    found = kept(tmp_path)
    assert [(one.line, one.noticed) for one in found.marks] == [
        ("left edge", False),
        ("left edge", False),
        ("left edge", False),
        ("left side", False),
        ("left side", True),
        ("left side", True),
        ("ahead", False),
    ]
    assert all(one.frames >= zone_judge.FRAMES for one in found.marks)
    assert "Traceback" not in terminal.said
    assert found.verdict in " ".join(terminal.said.split())
