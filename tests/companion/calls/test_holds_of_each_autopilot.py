"""The same hold on ArduPilot and PX4, and what is PX4's own: its stream of setpoints."""

from __future__ import annotations

import json

import pytest

from companion.calls.decisions import SetMode
from companion.calls.hold import HoldEvent, HoldState
from companion.calls.snapshot import restore, snapshot
from companion.vehicle import Autopilot, ardupilot, known_autopilot, px4
from companion.wire.ids import Outcome, Policy, State
from tests.companion.calls.scenes import CLEAR, DRUM, PX4_RTL, Scene, reported

ARDUPILOT, LOITERING, OFFBOARD_HOLD = ardupilot.ROVER, px4.LOITERING, px4.OFFBOARD_HOLD
MISSION, LOITER, OFFBOARD, MANUAL = px4.MISSION, px4.LOITER, px4.OFFBOARD, px4.custom_mode(1)
KINDS = [ARDUPILOT, LOITERING, OFFBOARD_HOLD]
NAMES = ["ardupilot", "loiter", "offboard"]
each = pytest.mark.parametrize("kind", KINDS, ids=NAMES)


def driving(kind: Autopilot, mode: int | None = None) -> Scene:
    """In one of its own driving modes over a clear trail, allowed to hold."""
    scene = Scene(Policy.HOLD, mode=min(kind.holdable) if mode is None else mode, kind=kind)
    scene.run(1.0)
    return scene


def held(kind: Autopilot) -> Scene:
    """Standing before a drum."""
    scene = driving(kind)
    scene.run(2.0, DRUM)
    assert scene.autopilot.mode == kind.hold_mode
    return scene


def brought_to(stage: HoldState, kind: Autopilot) -> Scene:
    """A hold in the given stage, which the autopilot does not follow."""
    scene = driving(kind) if stage is HoldState.REQUESTED else held(kind)
    scene.autopilot.deaf = stage is not HoldState.STANDING
    if stage is HoldState.RESUMING:
        scene.go()
    scene.run(0.8 if stage is not HoldState.RESUMING else 1.4, DRUM)
    assert scene.hold.state is stage
    return scene


@each
def test_it_holds_confirms_and_goes_back(kind: Autopilot) -> None:
    scene = held(kind)
    scene.go()
    scene.run(1.5, CLEAR)
    before = min(kind.holdable)
    assert scene.modes() == [kind.hold_mode, before]
    assert scene.autopilot.mode == before
    assert scene.events() == [HoldEvent.CONFIRMED, HoldEvent.RESUMED]
    assert not scene.calls.holding.streams


@each
def test_it_is_held_in_no_other_mode(kind: Autopilot) -> None:
    for mode in [*kind.names, 12345]:
        if mode in kind.holdable or mode in kind.streamed:
            continue
        scene = driving(kind, mode)
        scene.run(2.0, DRUM)
        assert scene.modes() == []
        assert not scene.calls.holding.streams


def test_an_offboard_mode_that_is_somebody_elses_is_not_held() -> None:
    scene = driving(OFFBOARD_HOLD, MANUAL)
    scene.calls.vehicle_reported(reported(OFFBOARD, scene.now, OFFBOARD_HOLD), scene.now)
    scene.autopilot.silent = True
    scene.run(3.0, DRUM)
    assert scene.modes() == []
    assert not scene.calls.holding.streams


def test_an_autopilot_of_unknown_kind_is_never_held() -> None:
    scene = Scene(Policy.HOLD, kind=None)
    scene.run(5.0, DRUM)
    assert scene.opened() == [1]
    assert scene.calls.hold is None
    assert scene.modes() == []


@pytest.mark.parametrize(
    ("kind", "vehicle", "found"),
    [
        (3, 10, ARDUPILOT),
        (3, 11, ARDUPILOT),
        (12, 10, LOITERING),
        (3, 2, None),
        (12, 2, None),
        (0, 10, None),
        (8, 10, None),
    ],
)
def test_the_table_is_that_of_the_vehicle_heard(kind: int, vehicle: int, found: Autopilot | None) -> None:
    assert known_autopilot(kind, vehicle) is found


def test_the_way_px4_is_held_is_the_configured_one() -> None:
    assert known_autopilot(12, 10, "offboard") is OFFBOARD_HOLD
    assert known_autopilot(3, 10, "offboard") is ARDUPILOT


def test_another_vehicle_on_the_wire_is_held_by_its_own_table() -> None:
    scene = driving(ARDUPILOT)
    scene.autopilot.kind, scene.autopilot.mode = LOITERING, MISSION
    scene.run(2.0, DRUM)
    assert scene.modes() == [LOITER]


@pytest.mark.slow
@each
@pytest.mark.parametrize("stage", HoldState)
def test_another_mode_set_by_a_human_ends_it_in_every_stage(kind: Autopilot, stage: HoldState) -> None:
    scene = brought_to(stage, kind)
    commanded = scene.modes()
    scene.human(MANUAL if kind is not ARDUPILOT else 0)
    assert scene.events()[-1] is HoldEvent.TAKEN_OVER
    assert scene.closed() == [(1, Outcome.TAKEN_OVER)]
    assert not scene.calls.holding.streams
    scene.run(10.0, DRUM)
    assert scene.modes() == commanded
    assert not scene.calls.holding.streams


@each
def test_the_mode_before_set_by_a_human_while_it_stands_is_his(kind: Autopilot) -> None:
    scene = held(kind)
    scene.human(min(kind.holdable))
    assert scene.events()[-1] is HoldEvent.TAKEN_OVER
    assert not scene.calls.holding.streams
    scene.run(5.0, DRUM)
    assert scene.modes() == [kind.hold_mode]


@each
def test_three_tries_then_failed_and_it_goes_on_trying(kind: Autopilot) -> None:
    scene = driving(kind)
    scene.autopilot.deaf = True
    scene.run(4.5, DRUM)
    assert scene.events() == [HoldEvent.FAILED]
    scene.autopilot.deaf = False
    scene.run(6.0)
    assert scene.events() == [HoldEvent.FAILED, HoldEvent.CONFIRMED]


def test_offboard_is_asked_for_after_a_stream_of_setpoints() -> None:
    scene = driving(OFFBOARD_HOLD)
    scene.run(2.0, DRUM)
    start = scene.hold.started_at
    asked = next(at for at, decision in scene.log if isinstance(decision, SetMode))
    assert 0.65 < asked - start < 0.8
    assert len(scene.modes()) == 1, "it was taken at once"


def test_setpoints_go_on_until_the_way_back_shows() -> None:
    scene = brought_to(HoldState.RESUMING, OFFBOARD_HOLD)
    assert scene.calls.holding.streams
    scene.run(0.5, DRUM)
    assert scene.autopilot.mode == OFFBOARD
    scene.autopilot.deaf = False
    scene.run(1.5, DRUM)
    assert scene.autopilot.mode == MISSION
    assert not scene.calls.holding.streams


def test_a_loiter_hold_needs_no_setpoints() -> None:
    scene = held(LOITERING)
    assert not scene.calls.holding.streams


@pytest.mark.parametrize("policy", [Policy.OFF, Policy.REPORT, Policy.SHADOW])
def test_switched_off_while_it_stands_on_setpoints_it_is_left_in_loiter(policy: Policy) -> None:
    scene = held(OFFBOARD_HOLD)
    scene.policy(policy)
    assert scene.calls.hold is None
    scene.run(3.0)
    assert scene.modes() == [OFFBOARD, LOITER]
    assert scene.autopilot.mode == LOITER
    assert not scene.calls.holding.streams


@pytest.mark.parametrize("kind", [ARDUPILOT, LOITERING])
def test_switched_off_elsewhere_nothing_is_commanded(kind: Autopilot) -> None:
    scene = held(kind)
    scene.policy(Policy.OFF)
    scene.run(3.0)
    assert scene.modes() == [kind.hold_mode]
    assert scene.calls.state(scene.now) is State.OFF


def test_an_offboard_that_was_on_its_way_when_it_was_switched_off_is_left_in_loiter_too() -> None:
    scene = driving(OFFBOARD_HOLD)
    scene.autopilot.delay = 0.6
    scene.run(1.0, DRUM)
    assert scene.modes() == [OFFBOARD]
    scene.policy(Policy.OFF)
    scene.run(3.0)
    assert scene.autopilot.mode == LOITER


def test_off_and_on_again_while_offboard_is_on_its_way_is_a_hold_like_any_other() -> None:
    scene = driving(OFFBOARD_HOLD)
    scene.autopilot.delay = 0.6
    scene.run(1.0, DRUM)
    assert scene.modes() == [OFFBOARD]
    scene.policy(Policy.OFF)
    scene.policy(Policy.HOLD)
    scene.run(5.0, DRUM)
    assert scene.autopilot.mode == OFFBOARD
    assert LOITER not in scene.modes()
    assert scene.hold.state is HoldState.STANDING
    scene.go()
    scene.run(3.0, DRUM)
    assert scene.autopilot.mode == MISSION


def test_setpoints_stay_until_loiter_is_taken() -> None:
    scene = held(OFFBOARD_HOLD)
    scene.autopilot.deaf = True
    scene.policy(Policy.OFF)
    scene.run(20.0)
    asked = [at for at, one in scene.log if isinstance(one, SetMode) and one.mode == LOITER]
    assert [round(at - asked[0]) for at in asked] == [0, 1, 2, 3, 8, 13, 18]
    assert scene.calls.holding.streams
    assert scene.autopilot.mode == OFFBOARD
    scene.autopilot.deaf = False
    scene.run(6.0)
    assert scene.autopilot.mode == LOITER
    assert not scene.calls.holding.streams


def test_a_human_ends_the_leaving_too() -> None:
    scene = held(OFFBOARD_HOLD)
    scene.autopilot.deaf = True
    scene.policy(Policy.OFF)
    scene.run(0.5)
    scene.human(MANUAL)
    assert not scene.calls.holding.streams
    commanded = scene.modes()
    scene.run(10.0)
    assert scene.modes() == commanded


def test_a_daemon_that_ends_leaves_it_in_loiter_and_its_successor_resumes() -> None:
    scene = held(OFFBOARD_HOLD)
    scene.calls.holding.release(scene.now)
    scene.run(1.0)
    assert scene.autopilot.mode == LOITER
    assert scene.calls.holding.offboard_release is None
    scene.restarted()
    scene.run(3.0)
    assert scene.hold.state is HoldState.STANDING
    assert not scene.calls.holding.streams
    scene.go()
    scene.run(1.5, CLEAR)
    assert scene.autopilot.mode == MISSION
    assert scene.modes() == [OFFBOARD, LOITER, MISSION]


def test_after_a_crash_that_px4_answered_with_rtl_the_call_is_taken_over() -> None:
    scene = held(OFFBOARD_HOLD)
    scene.restarted()
    scene.human(PX4_RTL)
    assert scene.closed() == [(1, Outcome.TAKEN_OVER)]
    commanded = scene.modes()
    scene.run(5.0, DRUM)
    assert scene.modes() == commanded


def test_loiter_set_by_a_human_inside_an_offboard_hold_is_his() -> None:
    scene = held(OFFBOARD_HOLD)
    scene.human(LOITER)
    assert scene.events()[-1] is HoldEvent.TAKEN_OVER
    assert not scene.calls.holding.streams


def test_a_hold_of_another_way_survives_a_restart_with_the_new_one() -> None:
    scene = held(LOITERING)
    kept = json.loads(json.dumps(snapshot(scene.calls)))
    restore(scene.calls, kept, scene.now)
    scene.autopilot.kind = OFFBOARD_HOLD
    scene.run(3.0, DRUM)
    scene.go()
    scene.run(1.5, CLEAR)
    assert scene.autopilot.mode == MISSION
    assert scene.modes() == [LOITER, MISSION]
