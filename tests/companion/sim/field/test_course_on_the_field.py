"""What the simulated autopilot tells of its course, as the companion judges it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.link.vehicle import VehicleTracker
from companion.sim.field.autopilot import SimulatedAutopilot
from companion.sim.field.modes import Mode
from companion.sim.field.router import DatagramParser, Port
from companion.sim.field.rover import Rover
from companion.sim.field.trail import Trail
from companion.vehicle.course import CourseJudge

TICK = 0.1


class Drive:
    """A mission, and what the companion makes of what it hears."""

    def __init__(self, seed: int) -> None:
        self.trail = Trail(seed)
        self.rover = Rover(self.trail, cruise_speed=2.0)
        self.autopilot = SimulatedAutopilot(self.rover, self._send)
        self.autopilot.streams[Port.COMPANION].set_interval(
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 500_000
        )
        self.tracker, self.judge = VehicleTracker(1), CourseJudge(0.0, 60.0)
        self.now = 0.0
        self.autopilot.arm(on=True)
        self.autopilot.set_mode(Mode.AUTO, "hand")

    def _send(self, port: Port, frame: bytes) -> bool:
        for message in DatagramParser().frames(frame) if port is Port.COMPANION else ():
            if message.get_type() == "HEARTBEAT":
                self.tracker.heartbeat(1, message, self.now)
            elif message.get_type() == "GLOBAL_POSITION_INT":
                self.tracker.position(1, message, self.now)
        return True

    def told(self, seconds: float) -> Iterator[str]:
        """What stands, ten times a second."""
        for _ in range(round(seconds / TICK)):
            self.rover.step(TICK)
            self.autopilot.poll(self.now)
            yield self.judge.judge(self.tracker.vehicle, self.now, drives=True, held=False)
            self.now += TICK


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_whole_lap_forward_is_no_fault_and_a_whole_lap_backwards_is_one_fault(seed: int) -> None:
    drive = Drive(seed)
    lap = drive.trail.length / 2.0 + 5.0
    assert set(drive.told(lap)) == {""}
    drive.rover.reversed = True
    told = list(drive.told(lap))
    began = told.index("drives backwards")
    assert began * TICK < 4.0, "2 s to turn the speed round, and 1.5 s to see that"
    assert set(told[began:]) == {"drives backwards"}
