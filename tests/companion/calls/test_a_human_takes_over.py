"""Rule 12: a human who changes the mode wins, has accepted what is there, and is left alone."""

from __future__ import annotations

import pytest

from anytraverse.assessment import Reason
from anytraverse.regions import Box
from companion.calls.hold import HoldEvent, HoldState
from companion.wire.ids import Outcome, Policy
from tests.companion.calls.scenes import (
    AHEAD,
    AUTO,
    BESIDE,
    BROKEN,
    CLEAR,
    DRUM,
    ELSEWHERE,
    GUIDED,
    HOLD,
    LOG,
    LOITER,
    MANUAL,
    RTL,
    Scene,
    Thing,
    View,
    reported,
)

STAGES = list(HoldState)


def brought_to(stage: HoldState, scene: Scene) -> Scene:
    """A drum ahead, and the hold in the given stage."""
    if stage is HoldState.REQUESTED:
        scene.autopilot.deaf = True
        scene.run(0.5, DRUM)
    else:
        scene.run(1.0, DRUM)
    if stage is HoldState.RESUMING:
        scene.autopilot.deaf = True
        scene.go()
        scene.run(0.6, DRUM)
    assert scene.hold.state is stage
    return scene


@pytest.mark.slow
@pytest.mark.parametrize("stage", STAGES)
@pytest.mark.parametrize("mode", [MANUAL, RTL, LOITER, GUIDED])
def test_another_mode_ends_the_hold_and_closes_the_call_as_taken_over(
    hold: Scene, stage: HoldState, mode: int
) -> None:
    brought_to(stage, hold)
    commanded = len(hold.modes())
    hold.human(mode)
    assert hold.events()[-1] is HoldEvent.TAKEN_OVER
    assert hold.closed() == [(1, Outcome.TAKEN_OVER)]
    assert hold.calls.hold is None
    assert hold.calls.go_at is None
    hold.run(10.0, DRUM)
    assert len(hold.modes()) == commanded
    assert hold.opened() == [1]


def test_a_human_who_drives_on_in_auto_is_not_held_again_for_the_thing(held: Scene) -> None:
    held.human(AUTO)
    assert held.closed() == [(1, Outcome.TAKEN_OVER)]
    held.run(15.0, DRUM)
    assert held.autopilot.mode == AUTO
    assert held.opened() == [1]


def test_nor_is_he_for_a_blocked_way(blocked: Scene) -> None:
    blocked.human(AUTO)
    blocked.run(15.0, LOG)
    assert blocked.autopilot.mode == AUTO
    assert len(blocked.held()) == 1


ROCK = Thing(Box(0.36, 0.84, 0.56, 0.95), "log")
NEXT = Thing(Box(0.44, 0.66, 0.66, 0.76), "log")
"""Two things by name, one behind the other, each with too little room beside it."""


def test_who_drives_past_one_known_thing_has_not_accepted_the_next(hold: Scene) -> None:
    hold.run(1.0, View((ROCK,)))
    assert hold.held() == [{Reason.BLOCKED}]
    hold.human(AUTO)
    hold.run(2.0, View((ROCK,)))
    assert hold.autopilot.mode == AUTO
    hold.run(1.0, View((ROCK, NEXT)))
    assert hold.autopilot.mode == HOLD
    assert [set(reasons) for reasons in hold.held()] == [{Reason.BLOCKED}] * 2


@pytest.mark.parametrize("tile", [None, 0.25, 0.65])
def test_nor_the_next_when_the_first_is_behind_him(tile: float | None) -> None:
    hold = Scene(Policy.HOLD, tile=tile)
    hold.run(1.0, View((ROCK,)))
    hold.human(AUTO)
    for down in (0.0, 0.02, 0.05, 0.08):
        box = Box(0.36, ROCK.box.top + down, 0.56, min(1.0, ROCK.box.bottom + down))
        hold.run(0.5, View((Thing(box, "log"),)))
    assert hold.autopilot.mode == AUTO
    hold.run(1.0, View((NEXT,)))
    assert hold.autopilot.mode == HOLD


@pytest.mark.parametrize("tile", [None, 0.25])
def test_nor_a_way_that_closes_altogether(tile: float | None) -> None:
    hold = Scene(Policy.HOLD, tile=tile)
    hold.run(1.0, View((ROCK,)))
    hold.human(AUTO)
    hold.run(1.0, View((Thing(Box(0.0, 0.60, 1.0, 0.75), "log"), ROCK)))
    assert hold.autopilot.mode == HOLD


def test_who_drives_past_an_unknown_and_a_known_thing_has_accepted_both(hold: Scene) -> None:
    both = View((ROCK, Thing(Box(0.36, 0.62, 0.44, 0.70))))
    hold.run(1.0, both)
    assert hold.opened() == [1]
    hold.human(AUTO)
    hold.run(5.0, both)
    assert hold.autopilot.mode == AUTO
    hold.run(1.0, View((*both.things, Thing(BESIDE))))
    assert hold.autopilot.mode == HOLD


def test_nor_for_a_new_place(hold: Scene) -> None:
    hold.run(1.0, ELSEWHERE)
    hold.human(AUTO)
    hold.run(15.0, ELSEWHERE)
    assert hold.autopilot.mode == AUTO
    assert hold.opened() == [1]


def test_the_place_that_he_accepted_is_the_one_he_drove_on_in(hold: Scene) -> None:
    hold.run(1.0, ELSEWHERE)
    hold.run(1.0, View(turned=110.0))
    hold.human(AUTO)
    hold.run(15.0)
    assert hold.autopilot.mode == AUTO
    hold.run(1.0, ELSEWHERE)
    assert hold.autopilot.mode == HOLD


def test_what_he_accepted_ends_as_any_acceptance_and_is_a_new_call_with_its_own_hold(held: Scene) -> None:
    held.human(AUTO)
    held.run(45.0, DRUM)
    assert held.opened() == [1, 2]
    assert held.hold.id == 2
    assert held.autopilot.mode == HOLD


def test_a_place_that_he_accepted_has_no_more_than_its_limits(hold: Scene) -> None:
    hold.run(1.0, ELSEWHERE)
    hold.human(AUTO)
    hold.run(19.5, ELSEWHERE)
    assert hold.autopilot.mode == AUTO
    hold.run(1.5, ELSEWHERE)
    assert hold.autopilot.mode == HOLD


def test_nor_has_one_with_a_thing_in_it_that_is_gone(hold: Scene) -> None:
    hold.run(1.0, View((Thing(AHEAD),), turned=60.0))
    hold.human(AUTO)
    hold.run(1.0, View((Thing(AHEAD),), turned=60.0))
    hold.run(18.5, ELSEWHERE)
    assert hold.autopilot.mode == AUTO
    hold.run(1.5, ELSEWHERE)
    assert hold.autopilot.mode == HOLD


def test_a_blocked_way_that_he_accepted_holds_again_after_its_limits(blocked: Scene) -> None:
    blocked.human(AUTO)
    blocked.run(45.0, LOG)
    assert [set(reasons) for reasons in blocked.held()] == [{Reason.BLOCKED}] * 2
    assert blocked.hold.id == 2


def test_a_new_thing_after_that_is_a_new_call_with_its_own_hold(held: Scene) -> None:
    held.human(AUTO)
    held.run(1.0, DRUM)
    held.run(1.0, View((Thing(AHEAD), Thing(BESIDE))))
    assert held.opened() == [1, 2]
    assert held.hold.id == 2
    assert held.autopilot.mode == HOLD


def test_a_thing_that_counted_only_after_the_call_opened_is_accepted_with_it(hold: Scene) -> None:
    hold.run(1.0, ELSEWHERE)
    both = View((Thing(AHEAD),), turned=60.0)
    hold.run(1.0, both)
    hold.human(AUTO)
    hold.run(10.0, both)
    assert hold.autopilot.mode == AUTO
    assert hold.opened() == [1]


def test_a_fault_is_not_accepted_before_its_hold_was_told(hold: Scene) -> None:
    hold.run(1.0, BROKEN)
    hold.human(AUTO)
    hold.run(1.0, BROKEN)
    assert hold.autopilot.mode == HOLD
    assert hold.calls.current_id == 2


def test_driving_by_hand_with_a_broken_camera_is_left_alone(hold: Scene) -> None:
    hold.run(1.0, BROKEN)
    hold.human(MANUAL)
    hold.run(10.0, BROKEN)
    assert hold.autopilot.mode == MANUAL


def test_a_human_who_comes_back_to_auto_after_the_limits_is_held_for_what_is_there(held: Scene) -> None:
    held.human(MANUAL)
    held.run(45.0, DRUM)
    assert held.opened() == [1, 2]
    assert held.modes() == [HOLD]
    held.human(AUTO)
    assert held.modes() == [HOLD, HOLD]
    assert held.hold.id == 2


def test_our_own_mode_before_shown_while_we_ask_for_the_hold_is_nobodys_doing(hold: Scene) -> None:
    hold.autopilot.delay = 0.9
    hold.run(0.8, DRUM)
    hold.hear()
    assert hold.hold.state is HoldState.REQUESTED


def test_two_modes_in_one_breath_are_both_seen(held: Scene) -> None:
    for mode in (HOLD, MANUAL):
        held.calls.vehicle_reported(reported(mode, held.now), held.now)
    assert held.calls.hold is None


def test_a_mode_set_by_hand_after_a_failed_resume_is_the_humans(held: Scene) -> None:
    held.autopilot.deaf = True
    held.go()
    held.run(4.0, DRUM)
    assert held.events()[-1] is HoldEvent.FAILED
    held.human(AUTO)
    assert held.events()[-1] is HoldEvent.TAKEN_OVER
    held.autopilot.deaf = False
    held.run(5.0, DRUM)
    assert held.autopilot.mode == AUTO


def test_hold_pressed_by_a_human_inside_ours_cannot_be_seen(held: Scene) -> None:
    held.human(HOLD)
    held.go()
    held.run(1.5, CLEAR)
    assert held.autopilot.mode == AUTO
