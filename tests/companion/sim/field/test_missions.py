"""The simulated autopilots' missions: what is told of them, and what follows their end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.sim.field import px4
from companion.sim.field.autopilot import SimulatedAutopilot
from companion.sim.field.modes import Mode
from companion.sim.field.router import DatagramParser, Port
from companion.sim.field.rover import Rover
from companion.sim.field.trail import Trail

TRAIL = Trail(1)
NOT_STARTED, ACTIVE, PAUSED, COMPLETE = 2, 3, 4, 5
BOTH = pytest.mark.parametrize("kind", [SimulatedAutopilot, px4.Px4])


class Drive:
    """An armed rover with a mission; `told` has what it said on the companion's port, with the time in s."""

    def __init__(self, kind: type[SimulatedAutopilot], mission: float | None) -> None:
        self.now = 0.0
        self.told: list[tuple[float, Any]] = []
        self.rover = Rover(TRAIL)
        self.autopilot = kind(self.rover, self._send)
        self.autopilot.tour.length = mission
        self.autopilot.arm(on=True)

    def _send(self, port: Port, frame: bytes) -> bool:
        if port is Port.COMPANION:
            self.told += [(self.now, parsed) for parsed in DatagramParser().frames(frame)]
        return True

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        end = self.now + seconds
        while self.now < end and not until():
            self.now += 0.02
            self.rover.step(0.02)
            self.autopilot.poll(self.now)

    def start(self) -> None:
        self.autopilot.set_mode(self.autopilot.mission, "hand")

    def complete(self) -> None:
        """Drives until the mission is complete, and then until the rover stands."""
        self.start()
        self.run(60.0, lambda: self.autopilot.tour.complete)
        assert self.autopilot.tour.complete
        self.run(30.0)
        assert abs(self.rover.speed) < 0.02

    def heard(self, kind: str) -> list[Any]:
        return [message for _, message in self.told if message.get_type() == kind]

    @property
    def state(self) -> int:
        self.told.clear()
        self.run(1.1)
        return int(self.heard("MISSION_CURRENT")[-1].mission_state)


@BOTH
def test_it_is_told_once_a_second_which_item_is_current(kind: type[SimulatedAutopilot]) -> None:
    drive = Drive(kind, 35.0)
    assert drive.state == NOT_STARTED
    drive.start()
    drive.told.clear()
    drive.run(8.0)
    told = drive.heard("MISSION_CURRENT")
    assert 7 <= len(told) <= 9
    assert {one.mission_state for one in told} == {ACTIVE}
    assert {one.total for one in told} == {4}
    first = kind.first_item
    assert [one.seq for one in told] == sorted(one.seq for one in told)
    assert (told[0].seq, told[-1].seq) == (first, first + 1)
    assert [one.seq for one in drive.heard("MISSION_ITEM_REACHED")] == [first]


def test_ardupilot_stays_in_auto_and_stands_when_its_mission_is_complete() -> None:
    drive = Drive(SimulatedAutopilot, 25.0)
    drive.complete()
    assert drive.autopilot.mode is Mode.AUTO
    assert drive.state == COMPLETE
    told = drive.heard("MISSION_CURRENT")[-1]
    assert (told.seq, told.total) == (3, 3)
    drive.autopilot.set_mode(Mode.HOLD, "hand")
    assert drive.state == COMPLETE


def test_every_item_is_told_once_when_it_is_reached() -> None:
    drive = Drive(SimulatedAutopilot, 25.0)
    drive.complete()
    assert [one.seq for one in drive.heard("MISSION_ITEM_REACHED")] == [1, 2, 3]


@pytest.mark.parametrize("restarts", [0, 1])
def test_hold_and_auto_begin_a_complete_mission_anew_whatever_mis_restart_says(restarts: int) -> None:
    drive = Drive(SimulatedAutopilot, 25.0)
    drive.autopilot.set_parameter("MIS_RESTART", restarts)
    drive.complete()
    drive.autopilot.set_mode(Mode.HOLD, "hand")
    drive.run(2.0)
    drive.start()
    drive.run(3.0)
    assert drive.rover.speed > 1.0
    assert drive.state == ACTIVE
    assert drive.heard("MISSION_CURRENT")[-1].seq == 1


def test_a_mission_that_is_held_halfway_goes_on_and_is_called_not_started_meanwhile() -> None:
    drive = Drive(SimulatedAutopilot, 60.0)
    drive.start()
    drive.run(10.0)
    drive.autopilot.set_mode(Mode.HOLD, "hand")
    drive.run(5.0)
    before = drive.rover.progress
    assert drive.state == NOT_STARTED
    item = drive.heard("MISSION_CURRENT")[-1].seq
    assert item > 1
    drive.start()
    drive.told.clear()
    drive.run(1.1)
    assert drive.heard("MISSION_CURRENT")[0].seq == item
    assert drive.rover.progress >= before


def test_a_reboot_forgets_that_the_mission_was_complete() -> None:
    drive = Drive(SimulatedAutopilot, 25.0)
    drive.complete()
    drive.autopilot.reboot(2.0)
    drive.run(3.0)
    assert drive.state == NOT_STARTED


def test_px4_goes_to_loiter_by_itself_and_does_so_again_when_mission_is_set() -> None:
    drive = Drive(px4.Px4, 25.0)
    drive.complete()
    assert drive.autopilot.mode is px4.Px4Mode.LOITER
    assert drive.state == COMPLETE
    assert drive.heard("MISSION_CURRENT")[-1].seq == 2
    drive.start()
    drive.run(1.0)
    assert drive.autopilot.mode is px4.Px4Mode.LOITER
    modes = [(change.mode.name, change.by) for change in drive.autopilot.mode_log]
    assert modes == [("MISSION", "hand"), ("LOITER", "autopilot")] * 2


def test_px4_calls_a_mission_paused_that_it_does_not_drive() -> None:
    drive = Drive(px4.Px4, 60.0)
    drive.start()
    drive.run(6.0)
    drive.autopilot.set_mode(px4.Px4Mode.LOITER, "hand")
    assert drive.state == PAUSED


@pytest.mark.slow
@BOTH
def test_a_mission_without_an_end_goes_round_and_has_a_jump_at_its_end(
    kind: type[SimulatedAutopilot],
) -> None:
    drive = Drive(kind, None)
    drive.start()
    drive.run(70.0)
    assert drive.rover.laps >= 1
    assert drive.rover.speed > 2.0
    told = drive.heard("MISSION_CURRENT")
    assert {one.mission_state for one in told} == {ACTIVE}
    items = [one.seq for one in drive.heard("MISSION_ITEM_REACHED")]
    last = told[0].total - 2 + kind.first_item
    assert items[: last + 2 - kind.first_item] == [*range(kind.first_item, last + 1), kind.first_item]


def test_its_interval_can_be_set() -> None:
    drive = Drive(SimulatedAutopilot, 25.0)
    assert drive.autopilot.streams[Port.COMPANION].set_interval(
        int(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT), 200_000
    )
    drive.run(2.0)
    assert len(drive.heard("MISSION_CURRENT")) >= 9
