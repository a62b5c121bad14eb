"""While something is driven round, what the region shows stops nobody. A hold returns to AUTO."""

from __future__ import annotations

import pytest

from anytraverse.assessment import Reason
from companion.calls.decisions import HoldMoved, SetMode
from companion.calls.hold import HoldEvent, HoldState
from companion.calls.mode_monitor import ModeAnswer
from companion.calls.reason_filter import PASSABLE
from companion.calls.snapshot import snapshot
from companion.calls.summary import current_text
from companion.guide.rules import NO_WAY
from companion.wire.ids import Policy, Stage
from tests.companion.calls.scenes import AUTO, CLEAR, DRUM, GUIDED, HOLD, MANUAL, Scene


def guided() -> Scene:
    """A rover that the companion drives round a drum in GUIDED. The test plays the script."""
    scene = Scene(Policy.GUIDE, mode=AUTO)
    scene.autopilot.brake, scene.autopilot.compares, scene.autopilot.deaf = 2.0, True, True
    scene.run(2.0, CLEAR)
    scene.calls.monitor.guided_out_of = AUTO
    scene.calls.reason_filter.passes = True
    scene.autopilot.mode = GUIDED
    scene.run(1.0, DRUM)
    return scene


def shows(scene: Scene, mode: int, seconds: float = 0.1) -> list[HoldEvent]:
    scene.autopilot.mode = mode
    return [one.event for one in scene.run(seconds, DRUM) if isinstance(one, HoldMoved)]


def stopped() -> Scene:
    """No way is left, and the hold was just commanded."""
    scene = guided()
    scene.calls.reason_filter.passes, scene.calls.reason_filter.no_way = False, NO_WAY
    scene.run(0.05, DRUM)
    return scene


def test_what_is_driven_round_neither_calls_nor_holds() -> None:
    scene = guided()
    scene.run(5.0, DRUM)
    assert scene.calls.hold is None
    assert scene.calls.call is None
    assert scene.calls.reason_filter.shows_passable


def test_what_was_passed_over_counts_at_once_where_it_is_driven_round_no_more() -> None:
    scene = guided()
    scene.calls.reason_filter.passes = False
    scene.run(0.05)
    assert scene.calls.hold is not None
    assert scene.calls.call is not None


def test_where_no_way_is_left_it_is_held_whatever_the_region_shows() -> None:
    scene = guided()
    scene.run(1.0, CLEAR)
    scene.calls.reason_filter.no_way = NO_WAY
    scene.run(0.05, CLEAR)
    assert scene.calls.reasons(scene.now) == {Reason.BLOCKED}
    assert scene.calls.hold is not None


def test_the_hold_is_commanded_out_of_guided_and_returns_to_auto() -> None:
    scene = stopped()
    wanted = [one for _, one in scene.log if isinstance(one, SetMode)]
    assert [(one.mode, one.expected) for one in wanted] == [(HOLD, GUIDED)]
    assert shows(scene, HOLD) == [HoldEvent.CONFIRMED]
    assert scene.calls.hold is not None
    assert scene.calls.hold.mode_before == AUTO


def test_the_script_s_brake_in_guided_anew_is_its_own_and_ends_in_hold() -> None:
    scene = stopped()
    shows(scene, HOLD)
    assert shows(scene, GUIDED, 0.1) == []
    answer = ModeAnswer(HOLD, accepted=True, brakes_out_of=AUTO)
    scene.keep(scene.calls.mode_answered(answer, scene.now))
    assert shows(scene, GUIDED, 1.5) == []
    assert scene.calls.hold is not None
    assert scene.calls.hold.state is HoldState.REQUESTED
    assert shows(scene, HOLD) == [HoldEvent.CONFIRMED]
    assert scene.calls.hold.mode_before == AUTO


def test_guided_in_a_hold_that_stood_for_longer_is_a_human_s() -> None:
    scene = stopped()
    shows(scene, HOLD, 1.0)
    assert HoldEvent.TAKEN_OVER in shows(scene, GUIDED)


def test_any_other_mode_is_a_human_s() -> None:
    assert HoldEvent.TAKEN_OVER in shows(stopped(), MANUAL)
    scene = stopped()
    shows(scene, GUIDED, 1.2)
    assert HoldEvent.TAKEN_OVER in shows(scene, AUTO)


def test_auto_that_was_requested_just_before_the_hold_is_held() -> None:
    scene = stopped()
    assert shows(scene, AUTO, 0.3) == []
    assert scene.calls.hold is not None
    assert shows(scene, HOLD) == [HoldEvent.CONFIRMED]
    assert scene.calls.hold.mode_before == AUTO


def test_guided_that_the_script_calls_somebody_else_s_is_not_held() -> None:
    scene = stopped()
    answer = ModeAnswer(HOLD, accepted=False, by_hand=True)
    decisions = scene.keep(scene.calls.mode_answered(answer, scene.now))
    assert [one.event for one in decisions if isinstance(one, HoldMoved)] == [HoldEvent.TAKEN_OVER]


def test_a_named_thing_that_the_frame_does_not_show_stops_it_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = guided()
    things = scene.calls.reason_filter.things
    monkeypatch.setattr(things, "block", lambda _: frozenset({Reason.BLOCKED}))
    scene.run(1.0, CLEAR)
    assert scene.calls.hold is not None


def test_a_restart_in_such_a_hold_returns_to_auto_too() -> None:
    scene = stopped()
    saved = snapshot(scene.calls)
    assert saved["hold"]["mode_before"] == AUTO


def test_a_reboot_ends_guiding_and_what_is_held_after_it_returns_to_its_own_mode() -> None:
    scene = stopped()
    hold = scene.calls.hold
    assert hold is not None
    hold.request_again()
    assert (hold.mode_before, hold.guided_out_of) == (AUTO, None)


def room_again(scene: Scene) -> Scene:
    """Held before a drum, beside which a way shows now."""
    shows(scene, HOLD)
    assert scene.calls.call is not None
    scene.calls.reason_filter.passes, scene.calls.reason_filter.no_way = True, ""
    scene.run(2.0, DRUM)
    return scene


def test_a_thing_with_room_beside_it_is_not_said_to_be_gone() -> None:
    scene = room_again(stopped())
    assert scene.calls.stage() is Stage.CLEAR
    assert current_text(scene.calls, [], scene.now) == f"C{scene.calls.current_id} room beside it, go?"
    scene.run(4.0, CLEAR)
    assert current_text(scene.calls, [], scene.now) == f"C{scene.calls.current_id} clear now, go?"


def test_a_bare_go_drives_round_the_thing_and_not_over_it() -> None:
    scene = room_again(stopped())
    scene.autopilot.deaf = False
    scene.go()
    scene.run(1.0, DRUM)
    assert scene.autopilot.mode == AUTO
    assert not scene.calls.reason_filter.things.accepted & PASSABLE
    scene.calls.reason_filter.passes = False
    scene.run(0.5, DRUM)
    assert scene.calls.hold is not None, "no room is left, and nobody has said that it may be driven over"


def test_a_go_that_was_asked_for_so_drives_round_it_where_one_plan_has_no_way() -> None:
    scene = room_again(stopped())
    scene.calls.reason_filter.passes = False
    scene.run(0.5, DRUM)
    scene.go()
    assert not scene.calls.reason_filter.things.accepted & PASSABLE
    scene.run(4.0, DRUM)
    scene.go()
    assert scene.calls.reason_filter.things.accepted & PASSABLE, "the text says that no room is left"


def test_a_go_with_words_above_0_drives_over_it() -> None:
    scene = room_again(stopped())
    scene.autopilot.deaf = False
    scene.go({"drum": 1.0})
    assert scene.calls.reason_filter.things.accepted


def test_a_stop_for_a_fault_of_guiding_is_not_said_to_be_for_want_of_room() -> None:
    scene = guided()
    scene.run(1.0, CLEAR)
    scene.calls.reason_filter.passes, scene.calls.reason_filter.no_way = False, "AUTO refused"
    scene.run(0.05, CLEAR)
    assert scene.calls.hold is not None
    told = current_text(scene.calls, [], scene.now)
    assert told == f"H{scene.calls.current_id} cannot drive round: AUTO refused, go?"
