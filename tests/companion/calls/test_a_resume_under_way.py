"""A resume that may still be under way explains a mode; nothing else does, and a human's mode comes back."""

from __future__ import annotations

import pytest

from companion.calls.decisions import GoLapsed, HoldMoved, HoldStarted, ResumeCancelled, SetMode, Unasked
from companion.calls.hold import HoldEvent, HoldState
from companion.calls.hold_rules import RESUME_WAITS
from companion.calls.mode_monitor import ModeAnswer
from companion.vehicle.ardupilot import INITIALISING
from companion.wire.ids import Motion, Policy
from tests.companion.calls.scenes import AUTO, CLEAR, DRUM, GUIDED, HOLD, LOG, MANUAL, Scene


def resuming(*, mode: int = AUTO, round_trip: float = 0.1) -> Scene:
    """Held out of `mode`; a go was given, and the resume has been commanded a moment ago."""
    scene = Scene(Policy.HOLD, mode=mode)
    scene.run(1.0)
    scene.run(1.0, LOG)
    assert scene.autopilot.mode == HOLD
    scene.autopilot.delay = round_trip
    scene.run(1.0, CLEAR)
    scene.go()
    while scene.modes()[-1] != mode:
        scene.run(0.05, CLEAR)
    return scene


def lose_resume(scene: Scene) -> None:
    """The command to resume never reaches the autopilot."""
    scene.autopilot.commands.clear()


def test_a_human_s_mode_soon_after_a_stay_is_the_human_s() -> None:
    scene = resuming(mode=GUIDED)
    lose_resume(scene)
    scene.answer(Motion.STAY)
    scene.run(1.2, CLEAR)
    assert scene.hold.state is HoldState.STANDING
    commanded = len(scene.modes())
    scene.human(GUIDED)
    assert scene.events()[-1] is HoldEvent.TAKEN_OVER
    scene.run(3.0, CLEAR)
    assert scene.autopilot.mode == GUIDED
    assert len(scene.modes()) == commanded


def test_even_before_the_hold_after_the_stay_was_shown() -> None:
    scene = resuming(mode=GUIDED)
    lose_resume(scene)
    scene.answer(Motion.STAY)
    scene.keep(scene.calls.mode_answered(ModeAnswer(HOLD, accepted=True), scene.now))
    scene.human(GUIDED)
    assert scene.events()[-1] is HoldEvent.TAKEN_OVER


def test_a_resume_that_comes_after_the_stay_is_held_again() -> None:
    scene = resuming(mode=GUIDED, round_trip=0.3)
    scene.answer(Motion.STAY)
    scene.run(3.0, CLEAR)
    assert HoldEvent.TAKEN_OVER not in scene.events()
    assert scene.autopilot.mode == HOLD
    assert scene.hold.state is HoldState.STANDING


def test_and_so_is_one_whose_hold_was_lost_on_the_wire_since_its_answer_came() -> None:
    scene = resuming(mode=GUIDED)
    scene.answer(Motion.STAY)
    scene.autopilot.commands = [(at, mode) for at, mode in scene.autopilot.commands if mode == GUIDED]
    scene.keep(scene.calls.mode_answered(ModeAnswer(GUIDED, accepted=True), scene.now))
    scene.run(3.0, CLEAR)
    assert HoldEvent.TAKEN_OVER not in scene.events()
    assert scene.autopilot.mode == HOLD


def test_a_resume_that_was_refused_is_not_under_way() -> None:
    scene = resuming(mode=GUIDED, round_trip=2.0)
    lose_resume(scene)
    scene.keep(scene.calls.mode_answered(ModeAnswer(GUIDED, accepted=False), scene.now))
    scene.answer(Motion.STAY)
    scene.run(1.2, CLEAR)
    scene.human(GUIDED)
    assert scene.events()[-1] is HoldEvent.TAKEN_OVER


def test_an_old_report_does_not_confirm_the_hold_after_a_stay() -> None:
    scene = resuming(round_trip=0.5)
    scene.answer(Motion.STAY)
    scene.hear()
    assert scene.hold.state is HoldState.REQUESTED


@pytest.mark.parametrize("round_trip", [0.05, 0.4, 1.0])
def test_our_mode_that_replaces_a_human_s_is_held_at_once_and_told(round_trip: float) -> None:
    scene = resuming(round_trip=round_trip)
    under_way = list(scene.autopilot.commands)
    scene.human(MANUAL)
    assert scene.events()[-1] is HoldEvent.TAKEN_OVER
    scene.autopilot.commands = under_way
    while scene.autopilot.mode == MANUAL:
        scene.run(0.05, CLEAR)
    assert scene.all(HoldStarted)[-1].unasked is Unasked.OVERRODE
    assert scene.modes()[-1] == HOLD
    scene.run(round_trip + 0.1, CLEAR)
    assert scene.autopilot.mode == HOLD
    scene.run(10.0, CLEAR)
    assert scene.autopilot.mode == HOLD, "it needs a go"
    scene.go()
    scene.run(3.0, CLEAR)
    assert scene.autopilot.mode == AUTO


def test_a_resume_is_not_repeated_while_its_report_is_on_its_way() -> None:
    scene = resuming(round_trip=1.2)
    scene.run(3.0, CLEAR)
    assert scene.autopilot.mode == AUTO
    assert scene.modes().count(AUTO) == 1, "a second one would override a human who set a mode meanwhile"


def test_later_it_is_the_human_s_own_mode() -> None:
    scene = resuming()
    lose_resume(scene)
    scene.human(MANUAL)
    scene.run(1.8, CLEAR)
    scene.human(AUTO)
    scene.run(3.0, CLEAR)
    assert scene.autopilot.mode == AUTO
    assert len(scene.all(HoldStarted)) == 1


def test_nor_is_a_human_s_own_mode_held_where_no_resume_was_under_way(held: Scene) -> None:
    held.human(MANUAL)
    held.run(0.3, CLEAR)
    held.human(AUTO)
    held.run(3.0, CLEAR)
    assert held.autopilot.mode == AUTO


def test_nothing_is_held_again_under_a_lower_policy() -> None:
    scene = resuming()
    under_way = list(scene.autopilot.commands)
    scene.human(MANUAL)
    scene.policy(Policy.REPORT)
    scene.autopilot.commands = under_way
    scene.run(2.0, CLEAR)
    assert scene.autopilot.mode == AUTO


def test_a_resume_waits_for_a_report_that_left_after_the_go() -> None:
    scene = Scene(Policy.HOLD)
    scene.run(1.0)
    scene.run(1.0, LOG)
    scene.autopilot.delay = 0.2
    scene.run(1.0, CLEAR)
    scene.hear()
    scene.go()
    scene.autopilot.beat_at = scene.now
    scene.run(0.9, CLEAR)
    assert scene.calls.reason_filter.ok_run >= 5
    assert scene.modes() == [HOLD]
    scene.run(0.3, CLEAR)
    assert scene.modes() == [HOLD, AUTO]


def test_and_without_one_nothing_is_resumed() -> None:
    scene = Scene(Policy.HOLD)
    scene.run(1.0)
    scene.run(2.0, LOG)
    scene.autopilot.silent = True
    scene.go()
    scene.run(2.6, CLEAR)
    assert scene.modes() == [HOLD]


def test_where_a_script_compares_the_resume_does_not_wait(held: Scene) -> None:
    held.autopilot.compares = True
    held.hear()
    held.go()
    held.autopilot.silent = True
    held.run(0.7, DRUM)
    assert held.modes() == [HOLD, AUTO]


def test_where_the_link_sends_no_resume_a_go_lapses_and_a_human_s_mode_is_the_human_s(held: Scene) -> None:
    held.autopilot.takes_resume = False
    held.hear()
    held.go()
    held.run(RESUME_WAITS + 0.2, DRUM)
    assert held.modes() == [HOLD]
    assert len(held.all(GoLapsed)) == 1
    assert held.hold.state is HoldState.STANDING
    assert held.hold.resumed_at is None
    held.human(AUTO)
    assert held.events()[-1] is HoldEvent.TAKEN_OVER


def test_a_go_waits_for_a_link_that_has_just_come_back_and_does_not_know_its_script_yet(held: Scene) -> None:
    held.autopilot.takes_resume = False
    held.hear()
    held.go()
    held.run(RESUME_WAITS - 1.0, CLEAR)
    assert (held.modes(), held.all(GoLapsed)) == ([HOLD], [])
    held.autopilot.takes_resume = True
    held.run(2.0, CLEAR)
    assert held.modes() == [HOLD, AUTO]


def test_once_it_does_a_go_resumes(held: Scene) -> None:
    held.autopilot.takes_resume = False
    held.hear()
    held.go()
    held.autopilot.takes_resume = True
    held.run(1.0, DRUM)
    held.go()
    held.run(3.0, DRUM)
    assert held.autopilot.mode == AUTO


def test_a_resume_that_the_link_would_not_repeat_is_cancelled() -> None:
    scene = resuming()
    lose_resume(scene)
    scene.autopilot.takes_resume = False
    scene.hear()
    assert scene.all(ResumeCancelled)
    scene.run(2.0, CLEAR)
    assert scene.modes()[-1] == HOLD
    assert scene.hold.state is HoldState.STANDING
    assert HoldEvent.FAILED not in scene.events()


def test_a_hold_that_a_human_pressed_inside_ours_is_the_human_s(held: Scene) -> None:
    held.autopilot.compares, held.autopilot.deaf = True, True
    held.hear()
    held.go()
    held.run(0.7, DRUM)
    held.keep(held.calls.mode_answered(ModeAnswer(AUTO, accepted=False, by_hand=True), held.now))
    assert held.all(HoldMoved)[-1].event is HoldEvent.TAKEN_OVER
    assert held.calls.hold is None
    held.run(5.0, DRUM)
    assert held.autopilot.mode == HOLD


NOT_SET = ModeAnswer(HOLD, accepted=False, by_hand=True)
"""The script's answer to a hold where another mode stands than it expected, or a human's HOLD."""


def requested() -> Scene:
    """A hold has been commanded, and nothing of it is shown yet."""
    scene = Scene(Policy.HOLD)
    scene.run(1.0)
    scene.autopilot.deaf = True
    while not scene.modes():
        scene.run(0.05, LOG)
    return scene


@pytest.mark.parametrize("answer_first", [True, False], ids=["answered", "shown"])
def test_a_hold_that_a_human_has_set_in_the_same_moment_is_the_human_s(answer_first: bool) -> None:
    scene = requested()
    if answer_first:
        scene.keep(scene.calls.mode_answered(NOT_SET, scene.now))
        assert scene.events() == []
    scene.human(HOLD)
    if not answer_first:
        assert scene.events() == [HoldEvent.CONFIRMED]
        scene.keep(scene.calls.mode_answered(NOT_SET, scene.now))
    assert scene.events()[-1] is HoldEvent.TAKEN_OVER
    scene.run(5.0, CLEAR)
    scene.go()
    scene.run(5.0, CLEAR)
    assert set(scene.modes()) == {HOLD}


def test_a_hold_that_was_not_set_is_requested_again_and_then_is_ours() -> None:
    scene = requested()
    scene.keep(scene.calls.mode_answered(NOT_SET, scene.now))
    scene.run(1.0, LOG)
    assert len(scene.modes()) > 1
    scene.keep(scene.calls.mode_answered(ModeAnswer(HOLD, accepted=True), scene.now))
    scene.human(HOLD)
    assert scene.events() == [HoldEvent.CONFIRMED]


def test_each_command_names_the_hold_and_the_mode_that_it_was_decided_on(held: Scene) -> None:
    held.go()
    held.run(2.0, DRUM)
    number = held.all(HoldMoved)[0].hold.id
    assert held.all(SetMode) == [SetMode(HOLD, AUTO, number), SetMode(AUTO, HOLD, number)]


def test_a_hold_that_a_call_gave_its_id_is_resumed_as_it_was_commanded_also_after_a_restart(
    blocked: Scene,
) -> None:
    first = blocked.hold.id
    blocked.run(1.0, DRUM)
    assert blocked.hold.id == blocked.call.id != first
    blocked.restarted()
    blocked.judge_again()
    blocked.run(1.0, DRUM)
    blocked.go()
    blocked.run(3.0, DRUM)
    assert blocked.all(SetMode)[-1] == SetMode(AUTO, HOLD, first)


def test_a_reboot_in_an_acknowledged_hold_is_no_human(held: Scene) -> None:
    held.keep(held.calls.mode_answered(ModeAnswer(HOLD, accepted=True), held.now))
    held.human(INITIALISING, armed=False)
    held.run(1.0, DRUM)
    held.human(AUTO)
    held.run(2.0, DRUM)
    assert HoldEvent.TAKEN_OVER not in held.events()
    assert not held.calls.reason_filter.things
    assert held.autopilot.mode == HOLD


def test_a_resume_that_waits_is_dropped_when_the_rover_is_disarmed() -> None:
    scene = resuming()
    scene.human(HOLD, armed=False)
    assert scene.all(ResumeCancelled)
