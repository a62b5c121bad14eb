"""`companion check --measure`: what is recorded of a person's HOLDs, in virtual time and as a process."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from bench.stopping.ground import SecondPort
from companion.desk.check.measure import ENOUGH, StopRecorder, _conclude, too_seldom
from companion.desk.check.stop_file import read_stops
from companion.sim.demo.child import LoggedProcess
from companion.sim.field.control import FieldControl
from companion.sim.field.modes import Mode
from companion.sim.field.rover import MotorDrive, Rover
from companion.sim.field.telemetry import heartbeat, position
from companion.sim.field.things import World
from companion.vehicle.brakes import Brakes, Measured, fit
from tests.waiting import wait_for

WORLD = World(1, ())
PERIOD = 0.2
PATIENCE = 30.0


class Drives:
    """A person with a simulated rover, a recorder beside it, in virtual time."""

    def __init__(self, late: float = 0.0, period: float = PERIOD) -> None:
        """late: s by which heartbeats tell a mode later than it is taken. period: s between two speeds."""
        self.rover = Rover(WORLD.trail, cruise_speed=1.0)
        self.recorder = StopRecorder(hold=int(Mode.HOLD))
        self.lines: list[str] = []
        self.mode = self.told = Mode.AUTO
        self.armed = True
        self.silent = False
        self._late, self._period = late, period
        self._tell_at = 0.0

    def set(self, mode: Mode) -> None:
        self.mode, self._tell_at = mode, self.rover.time + self._late
        self.rover.drive = MotorDrive.FOLLOW if mode is Mode.AUTO else MotorDrive.HOLD

    def go(self, seconds: float) -> None:
        until, beat = self.rover.time + seconds, self.rover.time
        while self.rover.time < until:
            if self.rover.time >= self._tell_at and (self.told is not self.mode or self.rover.time >= beat):
                self.told, beat = self.mode, self.rover.time + 1.0
                self._hear(heartbeat(self.told, armed=self.armed))
            if not self.silent:
                self._hear(position(self.rover))
            self.rover.step(self._period)

    def stop_from(self, speed: float, mode: Mode = Mode.HOLD) -> float:
        """Drive at `speed` m/s, HOLD, and wait until it stands; the true way from there."""
        self.rover.cruise_speed = speed
        self.set(Mode.AUTO)
        self.go(10.0)
        before = self.rover.distance
        self.set(mode)
        self.go(12.0)
        return self.rover.distance - before

    def _hear(self, message: Any) -> None:
        if line := self.recorder.hear(message, 5000.0 + self.rover.time):
            self.lines.append(line)


def test_each_hold_is_recorded_with_its_speed_and_way() -> None:
    person = Drives()
    true = [(speed, person.stop_from(speed)) for speed in (0.6, 1.2, 2.4)]
    assert len(person.recorder.stops) == 3, person.lines
    for (speed, way), stop in zip(true, person.recorder.stops, strict=True):
        assert stop.speed == pytest.approx(speed, rel=0.05)
        assert stop.way == pytest.approx(way, rel=0.03, abs=0.03)
    found = fit(person.recorder.stops)
    brakes = Brakes.of(found.braking, found.time_constant)
    assert all(brakes.way(speed) >= 0.97 * way for speed, way in true)


def test_guided_in_which_the_script_brakes_is_measured_as_hold_is() -> None:
    person = Drives()
    person.recorder = StopRecorder(hold=int(Mode.GUIDED), name="GUIDED")
    true = [person.stop_from(speed, Mode.GUIDED) for speed in (0.6, 1.2, 2.4)]
    for way, stop in zip(true, person.recorder.stops, strict=True):
        assert stop.way == pytest.approx(way, rel=0.05, abs=0.03)
    assert person.lines[0].startswith("GUIDED 1 at 0.6")
    person.stop_from(1.0)
    assert len(person.recorder.stops) == 3


def test_the_lines_for_both_ways_to_stop(capsys: pytest.CaptureFixture[str]) -> None:
    holds, brakes = ([Measured(0.9, way), Measured(1.8, 2.1 * way)] for way in (1.9, 0.9))
    assert _conclude(holds, brakes) == 0
    names = [line.split(" = ")[0] for line in capsys.readouterr().out.splitlines()[-5:]]
    assert names == ["[stopping]", "time_constant", "braking", "brake_time_constant", "brake_braking"]
    assert _conclude([], brakes) == 0
    assert "\nbraking" not in capsys.readouterr().out
    assert _conclude([], []) == 1


def test_a_stop_too_few_of_one_way_does_not_lose_the_other(capsys: pytest.CaptureFixture[str]) -> None:
    holds, brakes = ([Measured(0.9, way), Measured(1.8, 2.1 * way)] for way in (1.9, 0.9))
    assert _conclude(holds[:1], brakes) == 0
    told = capsys.readouterr().out
    assert "nothing fitted: 1 HOLDs measured" in told
    assert "[stopping]\nbrake_time_constant = " in told
    assert _conclude(holds[:1], brakes[:1]) == 1


def test_a_hold_whose_heartbeat_was_lost_is_not_measured_too_short() -> None:
    person = Drives(late=0.9)
    person.stop_from(1.6)
    assert person.recorder.stops == []
    assert person.lines == ["not counted: it was not driving steadily at 1.6 m/s when its HOLD was heard"]


def test_a_hold_that_is_left_again_or_not_told_of_counts_for_nothing_and_says_why() -> None:
    person = Drives()
    person.set(Mode.AUTO)
    person.go(6.0)
    person.set(Mode.HOLD)
    person.go(1.0)
    person.set(Mode.AUTO)
    person.go(6.0)
    assert person.lines == ["not counted: it did not stay in HOLD, armed and heard"]
    person.set(Mode.HOLD)
    person.silent = True
    person.go(3.0)
    person.silent = False
    person.go(9.0)
    assert person.lines[1:] == ["not counted: speeds came too seldom"]
    assert person.recorder.stops == []


def test_a_rover_that_was_slowing_down_before_its_hold_is_not_measured() -> None:
    person = Drives()
    person.rover.cruise_speed = 2.5
    person.set(Mode.AUTO)
    person.go(8.0)
    person.rover.cruise_speed = 0.8
    person.go(1.0)
    person.set(Mode.HOLD)
    person.go(10.0)
    assert person.recorder.stops == []
    assert "not driving steadily" in person.lines[0]


def test_a_rover_that_stands_or_is_disarmed_is_not_measured() -> None:
    person = Drives()
    person.set(Mode.HOLD)
    person.go(3.0)
    person.armed = False
    person.stop_from(1.0)
    assert person.recorder.stops == []


@pytest.mark.parametrize(("period", "rate"), [(0.1, 10.0), (0.26, 3.8), (0.5, 2.0), (1.0, 1.0), (5.0, 0.2)])
def test_how_often_speeds_come_is_known_after_three_seconds(period: float, rate: float) -> None:
    person = Drives(period=period)
    person.go(2.5)
    assert person.recorder.rate is None
    person.go(10.0)
    assert person.recorder.rate == pytest.approx(rate, rel=0.05)


def test_two_speeds_a_second_are_enough() -> None:
    person = Drives(period=0.5)
    true = [person.stop_from(speed) for speed in (0.6, 1.2, 2.4)]
    assert person.recorder.rate is not None
    assert person.recorder.rate > ENOUGH
    for way, stop in zip(true, person.recorder.stops, strict=True):
        assert stop.way == pytest.approx(way, rel=0.02)


def test_speeds_that_were_lost_or_a_reboot_are_counted_as_they_come() -> None:
    person = Drives()
    person.go(4.0)
    person.silent = True
    person.go(12.0)
    person.silent = False
    person.go(0.3)
    assert person.recorder.rate is not None
    assert person.recorder.rate < ENOUGH
    person.rover.booted_at = person.rover.time
    person.go(4.5)
    assert person.recorder.rate == pytest.approx(5.0, rel=0.05)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        (
            {"MAV1_POSITION": 4.0, "MAV2_POSITION": 1.0, "MAV3_POSITION": 0.0},
            "set MAV2_POSITION to 4, reboot",
        ),
        (
            {"MAV1_POSITION": 1.0, "MAV2_POSITION": 1.0, "MAV3_POSITION": 2.0},
            "set MAV1_POSITION or MAV2_POSITION, that of this port, to 4",
        ),
        ({"SR0_POSITION": 4.0, "SR2_POSITION": 1.0}, "set SR2_POSITION to 4"),
        ({"SR0_POSITION": 4.0, "SR1_POSITION": 3.0}, "set SR1_POSITION to 4"),
        ({}, "set MAVn_POSITION (SRn_POSITION up to 4.6), that of this port, to 4"),
    ],
)
def test_the_parameter_to_set_for_more_speeds_is_named(values: dict[str, float], told: str) -> None:
    assert told in too_seldom(1.0, values)
    assert "1.0 times a second" in too_seldom(1.0, values)


def test_without_a_speed_it_says_what_to_set() -> None:
    person = Drives()
    person.silent = True
    person.stop_from(1.0)
    assert "stream GLOBAL_POSITION_INT here" in person.lines[0]


MESSAGES = st.one_of(
    st.builds(
        lambda mode, armed: heartbeat(mode, armed=armed),
        st.sampled_from([Mode.AUTO, Mode.HOLD]),
        st.booleans(),
    ),
    st.builds(
        mavlink.MAVLink_global_position_int_message,
        st.integers(0, 2**32 - 1),
        *[st.just(0)] * 4,
        st.integers(-32768, 32767),
        st.integers(-32768, 32767),
        st.just(0),
        st.just(0),
    ),
)


@given(st.lists(st.tuples(MESSAGES, st.floats(0, 5)), max_size=60))
@settings(max_examples=100)
def test_whatever_an_autopilot_says_a_stop_has_a_speed_and_a_way(said: list[tuple[Any, float]]) -> None:
    recorder, now = StopRecorder(hold=int(Mode.HOLD)), 0.0
    for message, pause in said:
        now += pause
        recorder.hear(message, now)
    assert all(stop.speed > 0.0 and stop.way > 0.0 for stop in recorder.stops)


@pytest.fixture
def children(tmp_path: Path) -> Iterator[Callable[[str, list[str]], LoggedProcess]]:
    """Processes that end with the test."""
    started: list[LoggedProcess] = []

    def start(name: str, arguments: list[str]) -> LoggedProcess:
        started.append(LoggedProcess(name, arguments, tmp_path / f"{name}.log"))
        return started[-1]

    yield start
    for child in started:
        child.stop()


@pytest.mark.slow
def test_where_speeds_come_too_seldom_it_says_what_to_set_before_anybody_drives(
    children: Callable[[str, list[str]], LoggedProcess], tmp_path: Path
) -> None:
    field = children("field", ["companion.sim.field", "--fps", "1"])
    ports = json.loads(field.first_line(PATIENCE))
    config = tmp_path / "companion.toml"
    config.write_text(
        f'[web]\nlisten = ""\n[vehicle]\nfile = ""\n[journal]\nfolder = "{tmp_path / "state"}"\n'
    )
    host, _, port = ports["control"].rpartition(":")
    with closing(SecondPort(ports["gcs"])) as ground, FieldControl(host, int(port)) as control:
        ground.set_of_autopilot("MAV2_POSITION", 1.0)
        time.sleep(0.5)
        control.ask("reboot", seconds=0.5)
    check = children("check", ["companion", "check", "--measure", "--link", ports["companion"], str(config)])
    assert "Do not drive yet" in check.first_line(PATIENCE)
    wait_for(lambda: not check.running)
    assert check.process.returncode == 1
    told = [line for _, line in check.lines()]
    assert told[-1].startswith("speeds come 1.")
    assert "set MAV2_POSITION to 4, reboot the autopilot" in told[-1]
    assert not any("drive steadily" in line for line in told)


@pytest.mark.slow
def test_a_person_s_holds_on_the_field_become_lines_for_the_configuration(
    children: Callable[[str, list[str]], LoggedProcess], tmp_path: Path
) -> None:
    field = children("field", ["companion.sim.field", "--speed", "1.4", "--fps", "1"])
    ports = json.loads(field.first_line(PATIENCE))
    config = tmp_path / "companion.toml"
    config.write_text(
        f'[web]\nlisten = ""\n[vehicle]\nfile = ""\n[journal]\nfolder = "{tmp_path / "state"}"\n'
    )
    check = children("check", ["companion", "check", "--measure", "--link", ports["companion"], str(config)])
    assert "Nothing is commanded" in check.first_line(PATIENCE)
    host, _, port = ports["control"].rpartition(":")
    with closing(SecondPort(ports["gcs"])) as ground, FieldControl(host, int(port)) as control:
        for number, speed in enumerate((1.4, 0.7), start=1):
            ground.set_speed(speed)
            control.start()
            wait_for(lambda: control.status()["speed"] > 0.97 * speed)  # noqa: B023
            time.sleep(2.5)
            before = control.status()
            control.mode("HOLD")
            line = wait_for(lambda: next((told for _, told in check.lines() if "HOLD " in told), ""))
            metres = control.status()["distance"] - before["distance"]
            assert line.startswith(f"HOLD {number} at "), line
            assert float(line.split()[3]) == pytest.approx(speed, abs=0.05)
            assert float(line.split()[5]) == pytest.approx(metres, rel=0.1, abs=0.15)
    check.process.send_signal(signal.SIGINT)
    wait_for(lambda: not check.running)
    assert check.process.returncode == 0
    told = [line for _, line in check.lines()]
    assert told[-3] == "[stopping]"
    assert [line.split(" = ")[0] for line in told[-2:]] == ["time_constant", "braking"]
    ((_, mode, stops),), unread = read_stops(tmp_path / "state")
    assert (mode, len(stops), unread) == ("HOLD", 2, [])
