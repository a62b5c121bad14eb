"""A whole daemon and the simulated autopilot and rover, in virtual time: the mission is reversed."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.sim.field.modes import Mode
from companion.sim.field.router import DatagramParser, Port
from companion.sim.field.simulation import Simulation
from companion.sim.field.things import World
from companion.wire.ids import Motion
from tests.companion.daemon.rig import Rig

TICK = 0.02


class Field:
    """The field in place of the rig's own autopilot."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        rig.stage.vehicle = None
        self._taken = len(rig.stage.frames)
        self.simulation = Simulation(World(1, ()), self._send, cruise_speed=2.0)
        self.autopilot, self.rover = self.simulation.autopilot, self.simulation.rover
        self.ground = mavlink.MAVLink(None, 255, 190)
        self.autopilot.arm(on=True)
        self.autopilot.set_mode(Mode.AUTO, "hand")

    def drive(self, seconds: float) -> None:
        """Lets time pass; the view is fine."""
        for _ in range(round(seconds / 0.1)):
            for _ in range(5):
                self.simulation.advance(TICK)
            frames = self.rig.stage.frames
            for frame in frames[self._taken :]:
                self.autopilot.receive(Port.COMPANION, frame.message)
            self._taken = len(frames)
            self.autopilot.poll(self.rig.clock.now)
            self.rig.see(0.1)

    @property
    def mode(self) -> str:
        """The autopilot's."""
        return self.autopilot.mode.name

    def reverse(self, *, on: bool) -> None:
        """As a ground station commands it."""
        command = mavlink.MAVLink_command_long_message(
            1, 1, mavlink.MAV_CMD_DO_SET_REVERSE, 0, float(on), 0, 0, 0, 0, 0, 0
        )
        for frame in DatagramParser().frames(bytes(command.pack(self.ground))):
            self.autopilot.receive(Port.GCS, frame)

    def _send(self, port: Port, frame: bytes) -> bool:
        if port is Port.COMPANION:
            self.rig.stage.far.write(frame)
        return True


@pytest.mark.slow
def test_a_reversed_mission_is_held_before_it_has_backed_a_few_metres(rig: Rig) -> None:
    field = Field(rig)
    field.drive(6.0)
    assert field.mode == "AUTO"
    assert rig.state == ("OK", 0)
    field.reverse(on=True)
    backs_since = None
    while field.mode == "AUTO":
        field.drive(0.1)
        if backs_since is None and field.rover.speed < -0.3:
            backs_since = field.rover.time
    assert backs_since is not None
    assert field.rover.time - backs_since < 1.6
    field.drive(8.0)
    assert field.rover.speed == 0.0
    assert rig.state == ("FAULT", 1)
    assert "H1 FAULT drives backwards" in rig.texts
    field.reverse(on=False)
    rig.answer(1, Motion.GO)
    field.drive(5.0)
    assert field.mode == "AUTO"
    assert field.rover.speed > 1.9
    assert rig.state == ("OK", 0)
