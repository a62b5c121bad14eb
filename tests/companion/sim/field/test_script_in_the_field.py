"""The shipped script on the simulated autopilot, driving: how soon and how short the rover stops."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from bench.stopping.limits import braking
from companion.sim.field.autopilot import HAND
from companion.sim.field.control import FieldError
from companion.sim.field.modes import Mode
from companion.sim.field.onboard import install
from companion.sim.field.requests import ControlRequests
from companion.sim.field.router import DatagramParser, Port
from companion.sim.field.simulation import Simulation
from companion.sim.field.things import World
from companion.wire.ids import Policy, State, heartbeat_mode

pytest.importorskip("lupa.lua53", reason="the script runs in Lua 5.3")

TICK = 0.02


class Scene:
    """The trail in virtual time, a companion that beats or not, and a ground station that listens."""

    def __init__(self, *, speed: float = 2.5, seed: int = 1) -> None:
        self.heard: list[Any] = []
        self.simulation = Simulation(World(seed), self._send, cruise_speed=speed)
        self.autopilot, self.rover = self.simulation.autopilot, self.simulation.rover
        assert install(self.autopilot) == ""
        self.companion = mavlink.MAVLink(None, 1, 191)
        self.ground = mavlink.MAVLink(None, 255, 190)
        self.state: State | None = State.OK
        self.policy = Policy.HOLD
        self._beat_at = 0.0
        self.pass_time(0.2)

    def _send(self, port: Port, frame: bytes) -> bool:
        if port is Port.GCS:
            self.heard += DatagramParser().frames(frame)
        return True

    def hear(self, port: Port, datagram: bytes) -> None:
        """As the running field does it: scripts first, then routing of what is right."""
        self.autopilot.pass_to_script(port, datagram)
        for frame in DatagramParser().frames(datagram):
            self.autopilot.receive(port, frame)

    def beat(self, state: State) -> bytes:
        mode = heartbeat_mode(state, 0, self.policy)
        return bytes(mavlink.MAVLink_heartbeat_message(18, 8, 0, mode, 4, 3).pack(self.companion))

    def pass_time(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK)):
            self.simulation.advance(TICK)
            if self.state is not None and self.rover.time >= self._beat_at:
                self._beat_at = self.rover.time + 1.0
                self.hear(Port.COMPANION, self.beat(self.state))
            self.autopilot.poll(self.rover.time)

    def drive(self) -> None:
        self.pass_time(1.0)
        self.autopilot.arm(on=True)
        self.autopilot.set_mode(Mode.AUTO, HAND)
        self.pass_time(9.0)
        assert self.rover.speed > 0.9 * self.rover.cruise_speed

    def standstill(self, limit: float = 30.0) -> tuple[float, float]:
        """Seconds and metres from now until it stands."""
        begun, driven = self.rover.time, self.rover.distance
        while self.rover.speed > 0.02 and self.rover.time - begun < limit:
            self.pass_time(TICK)
        return self.rover.time - begun, self.rover.distance - driven

    def is_in(self, mode: Mode) -> bool:
        return self.autopilot.mode is mode

    def texts(self) -> list[str]:
        return [frame.text for frame in self.heard if frame.get_type() == "STATUSTEXT"]

    def set_parameter(self, name: str, value: float) -> None:
        message = mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, 9)
        self.hear(Port.GCS, bytes(message.pack(self.ground)))

    def command(self, number: int, *params: float) -> int:
        message = mavlink.MAVLink_command_long_message(1, 1, number, 0, *params, *[0.0] * (7 - len(params)))
        self.hear(Port.GCS, bytes(message.pack(self.ground)))
        return int([frame for frame in self.heard if frame.get_type() == "COMMAND_ACK"][-1].result)


@pytest.fixture
def scene() -> Scene:
    return Scene()


@pytest.mark.slow
@pytest.mark.parametrize("speed", [1.0, 2.5, 4.0])
@pytest.mark.parametrize("timeout", [1.5, 3.0])
def test_a_companion_that_dies_in_auto_is_stopped_in_time_and_metres(speed: float, timeout: float) -> None:
    scene = Scene(speed=speed)
    scene.set_parameter("ATS_TIMEOUT", timeout)
    scene.drive()
    scene.state = None
    died = scene.rover.time
    seconds, metres = scene.standstill()
    held = scene.autopilot.mode_log[-1]
    assert (held.mode, held.by) == (Mode.HOLD, "script")
    assert timeout - 1.0 <= held.t - died <= timeout + 0.2
    braked_in, braked_by = braking(speed)
    assert seconds <= timeout + 0.2 + braked_in + 0.1
    assert metres <= speed * (timeout + 0.4) + braked_by + 0.2
    assert "HOLD: companion silent. AUTO again = go blind" in scene.texts()


def test_a_fault_of_the_companion_stops_sooner(scene: Scene) -> None:
    scene.drive()
    scene.state = State.FAULT
    scene._beat_at = 0.0
    seconds, metres = scene.standstill()
    braked_in, braked_by = braking(2.5)
    assert seconds < braked_in + 0.4
    assert metres < braked_by + 0.4


@pytest.mark.parametrize(("speed", "metres"), [(0.9, 0.9), (1.4, 1.6), (2.9, 4.75)])
def test_the_brake_takes_the_metres_that_were_measured_with_ardupilot(speed: float, metres: float) -> None:
    scene = Scene(speed=speed)
    scene.drive()
    request = mavlink.MAVLink_command_long_message(1, 1, 31014, 0, 7, 10, 4, 9, 4, 0, 0)
    scene.hear(Port.COMPANION, bytes(request.pack(scene.companion)))
    _, braked = scene.standstill()
    assert braked == pytest.approx(metres, rel=0.12)
    set_by = [(one.mode, one.by) for one in scene.autopilot.mode_log][-2:]
    assert set_by == [(Mode.GUIDED, "companion"), (Mode.HOLD, "companion")]


@pytest.mark.slow
@pytest.mark.parametrize("speed", [1.0, 2.5])
def test_a_dead_companion_that_told_a_time_to_brake_is_stopped_sooner(speed: float) -> None:
    ways = []
    for seconds in (0.0, 4.0):
        scene = Scene(speed=speed)
        scene.drive()
        question = mavlink.MAVLink_command_long_message(1, 1, 31014, 0, 0, 0, 0, 9, seconds, 0, 0)
        scene.hear(Port.COMPANION, bytes(question.pack(scene.companion)))
        scene.state = None
        ways.append(scene.standstill()[1])
        assert scene.is_in(Mode.HOLD)
    assert ways[1] < ways[0] - 0.4 * speed


def test_damaged_heartbeats_and_rubbish_do_not_keep_it_driving(scene: Scene) -> None:
    scene.drive()
    scene.state = None
    for number in range(40):
        damaged = bytearray(scene.beat(State.OK))
        damaged[10 + number % 10] ^= 0x55
        scene.hear(Port.COMPANION, bytes(damaged))
        scene.hear(Port.COMPANION, b"\xfd\xff\xfe" * 20)
        scene.pass_time(0.1)
    assert scene.is_in(Mode.HOLD)


def test_a_restart_of_scripting_does_not_stop_a_companion_s_rover_nor_forget_the_next_loss(
    scene: Scene,
) -> None:
    scene.drive()
    assert scene.command(42701, 3) == mavlink.MAV_RESULT_ACCEPTED
    scene.pass_time(3.0)
    assert scene.is_in(Mode.AUTO)
    scene.state = None
    scene.standstill()
    assert scene.is_in(Mode.HOLD)


@pytest.mark.slow
def test_its_parameters_are_the_autopilot_s_own(scene: Scene) -> None:
    scene.pass_time(1.0)
    names = {row.name for row in scene.autopilot.parameters.rows()}
    assert {"ATS_ENABLE", "ATS_TIMEOUT", "ATS_MODES", "ATS_NEED", "ATS_FAULT", "ATS_PRX"} <= names
    assert not any(name.startswith("AT_") for name in names)
    scene.set_parameter("ATS_ENABLE", 0)
    scene.drive()
    scene.state = None
    scene.pass_time(10.0)
    assert scene.is_in(Mode.AUTO)
    scene.set_parameter("ATS_ENABLE", 1)
    scene.standstill()
    assert scene.is_in(Mode.HOLD)


def test_arming_needs_a_companion_where_the_owner_says_so(scene: Scene) -> None:
    scene.state = None
    scene.set_parameter("ARMING_CHECK", 1)
    scene.pass_time(1.0)
    scene.set_parameter("ATS_NEED", 1)
    scene.pass_time(1.0)
    arm = int(mavlink.MAV_CMD_COMPONENT_ARM_DISARM)
    assert scene.command(arm, 1) == mavlink.MAV_RESULT_FAILED
    assert "Arm: no companion: fix it or ATS_NEED 0" in scene.texts()
    requests = ControlRequests(
        scene.simulation,
        status=dict,
        look=lambda _box, _at: {},
        freeze=lambda _: None,
        film=lambda _: None,
        stop=lambda: None,
    )
    with pytest.raises(FieldError, match="forbids arming"):
        requests.handle({"do": "start"})
    scene.state = State.OK
    scene.pass_time(2.0)
    assert scene.command(arm, 1) == mavlink.MAV_RESULT_ACCEPTED


def test_the_human_s_mode_wins_by_radio_and_by_hand(scene: Scene) -> None:
    scene.drive()
    scene.state = None
    scene.standstill()
    scene.command(int(mavlink.MAV_CMD_DO_SET_MODE), 1, Mode.AUTO)
    scene.pass_time(20.0)
    assert scene.is_in(Mode.AUTO)
    assert "AUTO without companion" in scene.texts()


def test_an_obstacle_feed_that_dies_stops_it(scene: Scene) -> None:
    scene.set_parameter("PRX1_TYPE", 2)
    scene.drive()
    feed = mavlink.MAVLink_obstacle_distance_message(0, 0, [1000] * 72, 5, 20, 1000)
    for _ in range(20):
        scene.hear(Port.COMPANION, bytes(feed.pack(scene.companion)))
        scene.pass_time(0.2)
    assert scene.is_in(Mode.AUTO)
    seconds, _ = scene.standstill()
    assert seconds < 0.5 + 0.5 + 0.3 + braking(2.5)[0]
    assert "HOLD: obstacle feed dead. AUTO again = go blind" in scene.texts()


def test_the_companion_s_call_is_heard_as_the_autopilot_s(scene: Scene) -> None:
    scene.pass_time(2.0)
    call = mavlink.MAVLink_statustext_message(3, b"C7 unknown thing ahead 38%: go/stay/word")
    scene.hear(Port.COMPANION, bytes(call.pack(scene.companion)))
    scene.pass_time(0.5)
    said = [frame.get_srcComponent() for frame in scene.heard if getattr(frame, "text", "").startswith("C7")]
    assert sorted(said) == [1, 191]


def test_after_a_reboot_the_script_knows_no_companion_until_it_is_heard_again() -> None:
    scene = Scene()
    scene.autopilot.reboot(4.0)
    scene.state = None
    scene.pass_time(4.5)
    scene.drive()
    scene.pass_time(5.0)
    assert scene.is_in(Mode.AUTO), "nobody is missed who was never heard"
    scene.state = State.OK
    scene.pass_time(2.0)
    scene.state = None
    scene.pass_time(2.0)
    assert scene.is_in(Mode.HOLD)


@pytest.mark.parametrize("asked", [0, 1], ids=["scripts are not asked", "scripts are asked"])
def test_with_need_one_that_reboots_armed_in_auto_does_not_move_before_a_companion_is_heard(
    asked: int,
) -> None:
    scene = Scene()
    for name, value in (
        ("ATS_NEED", 1),
        ("ARMING_CHECK", asked),
        ("ARMING_REQUIRE", 3),
        ("INITIAL_MODE", 10),
    ):
        scene.autopilot.set_parameter(name, value)
    scene.state = None
    scene.autopilot.reboot(4.0, 2.0)
    before = scene.autopilot.rover.distance
    scene.pass_time(14.0)
    assert scene.autopilot.rover.distance - before < 0.1
    assert scene.autopilot.armed is not bool(asked)
    assert scene.is_in(Mode.AUTO if asked else Mode.HOLD)
    scene.state = State.OK
    scene.pass_time(7.0)
    assert scene.autopilot.armed
    assert scene.is_in(Mode.AUTO if asked else Mode.HOLD), "then it is for the companion to hold it"
