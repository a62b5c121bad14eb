"""The whole daemon on the simulated PX4 rover, in virtual time: only camera and radio are played."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from bench.virtual_time import Clock
from companion.config import Config
from companion.config.schema import MountSection, StoppingSection
from companion.sim.field.autopilot import SimulatedAutopilot
from companion.sim.field.px4 import Px4, Px4Mode
from companion.sim.field.router import DatagramParser, Port
from companion.sim.field.rover import Rover
from companion.sim.field.trail import Trail
from companion.wire.ids import Motion, Policy
from tests.companion.daemon.rig import Rig

TRAIL = Trail(1)
STEP = 0.02


class Px4Rig(Rig):
    """A rig whose autopilot is the field's: it drives in MISSION, or as `kind` calls that.

    mission: m of the trail after which the mission is complete; None: it goes round.
    """

    def __init__(
        self,
        folder: Path,
        clock: Clock,
        px4_hold: str,
        config: Config,
        kind: type[SimulatedAutopilot] = Px4,
        mission: float | None = None,
    ) -> None:
        self.px4_hold = px4_hold
        self.config = config
        self.rover = Rover(TRAIL, cruise_speed=config.stopping.speed or 2.5)
        self.px4 = kind(self.rover, self._from_px4)
        self.px4.tour.length = mission
        self.to_ground: list[Any] = []
        self._obeyed = 0
        self._stepped_at = clock.now
        super().__init__(folder, clock)
        self.px4.arm(on=True)
        self.px4.set_mode(self.px4.mission, "hand")

    def start(self, *, mode: int = 0, forget_frame: bool = False) -> None:
        super().start(mode=mode, forget_frame=forget_frame)
        self.stage.vehicle = None
        self._obeyed = 0
        self.calls.numbers.px4_hold = self.px4_hold

    def _from_px4(self, port: Port, frame: bytes) -> bool:
        if port is Port.COMPANION:
            self.stage.far.write(frame)
        else:
            self.to_ground += DatagramParser().frames(frame)
        return True

    def turn(self) -> None:
        while self._stepped_at + STEP <= self.clock.now:
            self._stepped_at += STEP
            self.rover.step(STEP)
            self.px4.poll(self._stepped_at)
        self.stage.now = self.clock.now
        self.loop.turn()
        self.writer.drain()
        self.deliver()

    def deliver(self) -> None:
        """What the daemon has sent arrives at the autopilot."""
        self.stage.collect(self.stage.now)
        for frame in self.stage.frames[self._obeyed :]:
            self.px4.receive(Port.COMPANION, frame.message)
        self._obeyed = len(self.stage.frames)

    def leave(self) -> None:
        """As SIGTERM ends it, with the world going on meanwhile."""
        turn = self.loop.turn

        def turn_in_the_world() -> None:
            self.clock.now += STEP
            self.rover.step(STEP)
            self._stepped_at += STEP
            self.px4.poll(self._stepped_at)
            turn()
            self.deliver()

        self.loop.turn = turn_in_the_world  # type: ignore[method-assign]
        self.daemon.leave()
        self.loop.turn = turn  # type: ignore[method-assign]

    @property
    def modes(self) -> list[tuple[str, str]]:
        """Every mode that was entered, and by whom."""
        return [(change.mode.name, change.by) for change in self.px4.mode_log]


MakePx4 = Callable[..., Px4Rig]


@pytest.fixture
def make(tmp_path: Path, clock: Clock) -> Iterator[MakePx4]:
    """Rigs that drive over grass in MISSION."""
    made: list[Px4Rig] = []

    def build(px4_hold: str, config: Config = Rig.config) -> Px4Rig:
        rig = Px4Rig(tmp_path, clock, px4_hold, config)
        made.append(rig)
        rig.see(4.0)
        assert rig.rover.speed > 0.8 * rig.rover.cruise_speed or rig.state[0] == "FAULT"
        return rig

    yield build
    for rig in made:
        rig.kill()


ways = pytest.mark.parametrize(("px4_hold", "mode"), [("loiter", "LOITER"), ("offboard", "OFFBOARD")])


@pytest.mark.slow
@ways
def test_it_is_held_before_a_thing_and_its_mission_goes_on_after_a_go(
    make: MakePx4, px4_hold: str, mode: str
) -> None:
    rig = make(px4_hold)
    rig.see(15.0, "drum")
    assert rig.modes == [("MISSION", "hand"), (mode, "companion")]
    assert rig.rover.speed == 0.0
    assert rig.state == ("CALLING", 1)
    rig.word(1, "drum", 1.0, Motion.GO)
    rig.see(4.0, "drum")
    assert rig.modes[2:] == [("MISSION", "companion")]
    assert rig.rover.speed > 1.5
    assert any("resumed MISSION" in text for text in rig.texts)
    assert not any("GUIDED" in text for text in rig.texts)


def test_the_operator_is_told_that_loiter_circles(make: MakePx4) -> None:
    rig = make("loiter")
    rig.see(3.0, "drum")
    assert "C1 holding: circles back before it stands" in rig.texts


def test_offboard_stops_it_within_braking_distance_and_a_second(make: MakePx4) -> None:
    rig = make("offboard")
    before, since = rig.rover.distance, rig.clock.now
    while rig.rover.speed > 0.02 and rig.clock.now - since < 10:
        rig.see(0.1, "drum")
    assert rig.clock.now - since < 3.5
    assert rig.rover.distance - before < 6.0


@pytest.mark.slow
@ways
def test_a_human_takes_over_and_the_setpoints_stop(make: MakePx4, px4_hold: str, mode: str) -> None:
    rig = make(px4_hold)
    rig.see(4.0, "drum")
    assert rig.px4.mode.name == mode
    rig.px4.set_mode(Px4Mode.MANUAL, "hand")
    rig.see(1.5, "drum")
    assert rig.calls.hold is None
    before = len(rig.stage.sent("SET_POSITION_TARGET_LOCAL_NED"))
    rig.see(5.0, "drum")
    assert len(rig.stage.sent("SET_POSITION_TARGET_LOCAL_NED")) == before
    assert rig.px4.mode is Px4Mode.MANUAL
    assert any("taken over by hand: MANUAL" in text for text in rig.texts)


@pytest.mark.slow
@pytest.mark.parametrize("px4_hold", ["loiter", "offboard"])
def test_a_daemon_that_ends_in_good_order_leaves_it_standing_and_its_successor_resumes(
    make: MakePx4, px4_hold: str
) -> None:
    rig = make(px4_hold)
    rig.see(15.0, "drum")
    rig.leave()
    assert rig.px4.mode is Px4Mode.LOITER
    rig.kill()
    rig.clock.now += 5.0
    rig.start()
    rig.see(3.0, "drum")
    assert rig.px4.mode is Px4Mode.LOITER
    assert rig.calls.current_id == 1
    rig.word(1, "drum", 1.0, Motion.GO)
    rig.see(4.0, "drum")
    assert rig.px4.mode.name == "MISSION"


@pytest.mark.slow
def test_killed_while_it_stands_on_setpoints_it_drives_home_and_the_call_is_closed(make: MakePx4) -> None:
    rig = make("offboard")
    rig.see(10.0, "drum")
    rig.kill()
    for _ in range(250):
        rig.clock.now += STEP
        rig._stepped_at += STEP
        rig.rover.step(STEP)
        rig.px4.poll(rig._stepped_at)
    assert rig.px4.mode is Px4Mode.RTL
    assert rig.rover.speed > 0.5
    rig.start()
    rig.see(3.0, "drum")
    assert rig.px4.mode is Px4Mode.RTL
    assert any("taken over: RTL, not by us" in text for text in rig.texts)


@pytest.mark.slow
@pytest.mark.parametrize("px4_hold", ["loiter", "offboard"])
def test_switched_off_it_is_left_standing(make: MakePx4, px4_hold: str) -> None:
    rig = make(px4_hold)
    rig.see(10.0, "drum")
    rig.set("AT_POLICY", float(Policy.OFF))
    rig.see(5.0, "drum")
    assert rig.px4.mode is Px4Mode.LOITER
    assert rig.state[0] == "OFF"
    assert not rig.calls.holding.streams


@pytest.mark.slow
def test_an_autopilot_of_another_kind_is_told_once_and_never_commanded(make: MakePx4) -> None:
    rig = make("loiter")
    rig.px4.heartbeat = lambda: mavlink.MAVLink_heartbeat_message(10, 4, 129, 4, 4, 3)  # type: ignore[method-assign]
    rig.see(10.0, "drum")
    assert rig.modes == [("MISSION", "hand")]
    assert [text for text in rig.texts if "unknown kind" in text] == [
        "Autopilot of unknown kind: it is never held"
    ]


CLOSE = Config(
    mount=MountSection(height=1.0, tilt=10.0),
    stopping=StoppingSection(speed=1.0, time_constant=0.1, braking=1.0),
)
"""It stops just before what it sees, and not 2.5 m further on."""


@pytest.mark.slow
def test_what_it_runs_on_in_loiter_is_reckoned_with_once_it_is_known_to_be_a_px4(make: MakePx4) -> None:
    rig = make("loiter", CLOSE)
    assert rig.told_policy is Policy.HOLD
    assert rig.settings.policy.hold_refused == "HOLD refused: 1.0 m/s outruns eyes: at most 0.0"
    assert "FAULT: 1.0 m/s: at most 0.0, or AT_POLICY 0" in rig.texts
    assert not any("ATS_NEED" in text for text in rig.texts), "no script runs there"
    rig.see(5.0)
    assert rig.state[0] == "FAULT"
    assert rig.px4.mode is Px4Mode.LOITER, "a rover that drives itself is held"
    rig.set("AT_POLICY", 2)
    rig.see(1.0)
    assert rig.told_policy is Policy.HOLD


def test_a_px4_that_brakes_at_once_may_be_held(make: MakePx4) -> None:
    rig = make("offboard", CLOSE)
    assert rig.told_policy is Policy.HOLD
    assert rig.settings.policy.hold_refused == ""
    assert not any("HOLD refused" in text for text in rig.texts)


@pytest.mark.slow
def test_a_hold_that_stands_when_it_turns_out_that_it_may_not_is_left_where_it_stands(make: MakePx4) -> None:
    rig = make("loiter")
    rig.see(15.0, "drum")
    assert rig.rover.speed == 0.0
    rig.config = CLOSE
    rig.restart()
    rig.word(1, "drum", 1.0, Motion.GO)
    rig.see(10.0, "drum")
    assert rig.told_policy is Policy.HOLD
    assert rig.calls.hold is not None, "the go waits for the end of the fault"
    assert rig.rover.speed == 0.0
    assert rig.modes == [("MISSION", "hand"), ("LOITER", "companion")]
