"""The stream of centred sticks to a PX4: what is sent, when it ends, and for whose sticks for good."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import LONGEST_PACE_WITH_STICKS, LinkSettings
from companion.link.dead_man import LISTENS_FIRST, DeadManState
from companion.sim.loopback_link import STEP, LoopbackLink
from companion.vehicle import px4
from companion.wire.ids import ERROR, MAX_TEXT, WARNING
from companion.wire.messages import MESSAGES

STICKS = "MANUAL_CONTROL"


class Stage(LoopbackLink):
    """A PX4 rover in MISSION, whose heartbeat comes each second; what the companion wants is played."""

    def __init__(
        self, *, kind: int = 12, enabled: bool = True, pace: float = LONGEST_PACE_WITH_STICKS
    ) -> None:
        super().__init__(LinkSettings("udpout:127.0.0.1:14550", pace=pace), vehicle=None)
        self.kind, self.shown = kind, px4.MISSION
        self.link.dead_man.enabled = enabled
        self.link.dead_man.on = True

    def live(self, seconds: float, step: float = STEP, *, armed: bool = True) -> None:
        for _ in range(round(seconds)):
            base = 0x81 if armed else 0x01
            self.send(mavlink.MAVLink_heartbeat_message(10, self.kind, base, self.shown, 4, 3), (1, 1))
            self.run(1.0, step)

    def rc(self, count: int = 8) -> None:
        self.send(mavlink.MAVLink_rc_channels_message(0, count, *[1500] * 18, 200), (1, 1))
        self.run(0.1)

    @property
    def texts(self) -> list[tuple[str, int]]:
        return [(message.text, message.severity) for message in self.sent("STATUSTEXT")]

    @property
    def state(self) -> DeadManState:
        return self.link.dead_man.state

    def streams(self) -> bool:
        """Whether it streams in the next second."""
        before = len(self.sent(STICKS))
        self.live(1.0)
        return len(self.sent(STICKS)) > before


def sticks(target: int = 1) -> Any:
    return mavlink.MAVLink_manual_control_message(target, 0, 0, 500, 0, 0)


@pytest.fixture
def stage() -> Stage:
    """It streams."""
    stage = Stage()
    stage.live(LISTENS_FIRST + 1.0)
    assert stage.state is DeadManState.ON
    return stage


def test_the_sticks_are_centred_as_px4_reads_them_and_the_autopilot_s(stage: Stage) -> None:
    frame = next(frame for frame in stage.frames if frame.message.get_type() == STICKS)
    told = frame.message
    assert (told.target, told.x, told.y, told.z, told.r, told.buttons) == (1, 0, 0, 500, 0, 0)
    assert told.enabled_extensions == 0
    assert frame.size == MESSAGES["sticks"].bytes


def test_they_go_out_ten_times_a_second() -> None:
    stage = Stage(pace=0.03)
    stage.live(LISTENS_FIRST + 10.0)
    times = stage.times(STICKS)
    assert 98 <= len(times) <= 101
    assert max(later - earlier for earlier, later in pairwise(times)) < 0.15


def test_at_the_slowest_pace_and_beside_setpoints_no_gap_is_long_and_replies_get_out(stage: Stage) -> None:
    stage.link.setpoints.on = True
    began = len(stage.times(STICKS))
    for number in range(50):
        stage.link.texts.send(f"text {number}", 4, stage.now)
        if number % 10 == 0:
            stage.send(mavlink.MAVLink_command_long_message(1, 191, 512, 0, 148, 0, 0, 0, 0, 0, 0))
            stage.live(1.0)
    times = stage.times(STICKS)[began:]
    assert len(times) >= 35
    assert max(later - earlier for earlier, later in pairwise(times)) < 0.3
    assert len(stage.sent("COMMAND_ACK")) == 5


def test_nothing_is_streamed_before_it_was_listened_for_others() -> None:
    stage = Stage()
    stage.live(LISTENS_FIRST - 1.0)
    assert stage.sent(STICKS) == []
    assert stage.state is DeadManState.READY
    asked = [m.param1 for m in stage.sent("COMMAND_LONG") if m.command == 511]
    assert mavlink.MAVLINK_MSG_ID_RC_CHANNELS in asked


def test_it_may_begin_three_seconds_after_the_first_heartbeat() -> None:
    stage = Stage()
    stage.live(LISTENS_FIRST, step=0.125)
    before = stage.state
    stage.run(0.125, step=0.125)
    assert (before, stage.state) == (DeadManState.READY, DeadManState.ON)


def test_it_ends_when_it_is_not_wanted_any_more_and_begins_again(stage: Stage) -> None:
    stage.shown = px4.custom_mode(1)
    stage.live(1.0)
    stage.link.dead_man.on = False
    assert not stage.streams()
    assert stage.state is DeadManState.READY
    assert stage.texts == [], "a human drives: nothing stops"
    stage.link.dead_man.on = True
    assert stage.streams()


def test_an_end_that_stops_a_mission_is_told(stage: Stage) -> None:
    stage.link.dead_man.on = False
    stage.live(1.0)
    assert stage.texts == [("Dead man ends: PX4 holds, set MISSION by hand", WARNING)]


def test_an_end_by_disarming_is_not(stage: Stage) -> None:
    stage.live(1.0, armed=False)
    stage.link.dead_man.on = False
    stage.live(1.0, armed=False)
    assert stage.texts == []


@pytest.mark.slow
@pytest.mark.parametrize("kind", [STICKS, "RC_CHANNELS_OVERRIDE"])
@pytest.mark.parametrize("target", [0, 1])
@pytest.mark.parametrize("early", [True, False])
def test_somebody_else_s_sticks_end_it_for_good(kind: str, target: int, early: bool) -> None:
    stage = Stage()
    stage.live(1.0 if early else LISTENS_FIRST + 2.0)
    override = mavlink.MAVLink_rc_channels_override_message(target, 1, *[1500] * 8)
    stage.send(sticks(target) if kind == STICKS else override, (255, 190))
    stage.run(0.1)
    assert stage.state is DeadManState.REFUSED
    assert stage.texts == [("Dead man OFF, sticks of 255/190: guard by hand", ERROR)]
    assert stage.link.dead_man.reminder == stage.texts[0][0]
    stage.run(0.2)
    assert not stage.streams()
    stage.link.dead_man.on = False
    stage.live(30.0)
    stage.link.dead_man.on = True
    assert not stage.streams()
    assert len(stage.texts) == 1, "that PX4 holds by itself now is not told: somebody steers"


def test_sticks_under_our_own_ids_end_it_too_but_not_our_own_that_come_back(stage: Stage) -> None:
    own = next(frame for frame in reversed(stage.frames) if frame.message.get_type() == STICKS)
    stage.far.write(bytes(own.message.get_msgbuf()))
    assert stage.streams()
    stage.send(sticks(), (1, 191))
    stage.run(0.1)
    assert stage.state is DeadManState.REFUSED


def test_another_component_under_our_ids_alone_does_not_end_it(stage: Stage) -> None:
    stage.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 7, 4, 3), (1, 191))
    assert stage.streams()


def test_what_does_not_steer_this_vehicle_is_nobody_else_s(stage: Stage) -> None:
    stage.send(sticks(target=2), (255, 190))
    stage.send(sticks(), (1, 1))  # the autopilot tells the sticks that it follows
    stage.rc(count=0)
    assert stage.streams()
    assert stage.texts == []


def test_a_live_transmitter_ends_it_for_good(stage: Stage) -> None:
    stage.rc()
    assert stage.state is DeadManState.REFUSED
    (told,) = stage.texts
    assert told == ("Dead man OFF, sticks of transmitter: guard by hand", ERROR)
    assert len(told[0].encode()) <= MAX_TEXT
    assert not stage.streams()


@pytest.mark.parametrize(("kind", "enabled"), [(3, True), (12, False)])
def test_it_is_off_on_other_autopilots_and_as_shipped(kind: int, enabled: bool) -> None:
    stage = Stage(kind=kind, enabled=enabled)
    stage.live(LISTENS_FIRST + 2.0)
    stage.rc()
    stage.send(sticks(), (255, 190))
    stage.run(0.1)
    assert stage.state is DeadManState.OFF
    assert stage.sent(STICKS) == []
    assert stage.texts == []
    asked = [m.param1 for m in stage.sent("COMMAND_LONG") if m.command == 511]
    assert mavlink.MAVLINK_MSG_ID_RC_CHANNELS not in asked


def test_without_a_vehicle_nothing_is_streamed() -> None:
    stage = Stage()
    stage.run(10.0)
    assert stage.sent(STICKS) == []
