"""Rule 12: when the rover is held, and how hard that is tried."""

from __future__ import annotations

from dataclasses import replace

import pytest

from anytraverse.assessment import Reason
from companion.calls.decisions import HoldStarted, SetMode
from companion.calls.hold import HoldEvent, HoldState
from companion.wire.ids import Kind, Policy, State
from tests.companion.calls.scenes import (
    AUTO,
    BROKEN,
    CLEAR,
    DRUM,
    GUIDED,
    HOLD,
    LOG,
    LOITER,
    MANUAL,
    RTL,
    Scene,
    View,
    reported,
)


def when(scene: Scene, mode: int) -> list[float]:
    """Seconds between the commands of `mode` and the first of them."""
    times = [at for at, decision in scene.log if isinstance(decision, SetMode) and decision.mode == mode]
    return [round(at - times[0], 2) for at in times]


def stage(scene: Scene) -> HoldState:
    """Where the hold stands."""
    return scene.hold.state


@pytest.mark.parametrize("mode", [AUTO, GUIDED])
def test_a_call_holds_the_rover_in_the_autopilots_own_driving_modes(mode: int) -> None:
    scene = Scene(Policy.HOLD, mode=mode)
    scene.run(1.0)
    scene.run(1.0, DRUM)
    assert scene.modes() == [HOLD]
    assert scene.autopilot.mode == HOLD
    assert scene.hold.mode_before == mode
    assert scene.hold.id == scene.call.id == 1


@pytest.mark.parametrize("mode", [MANUAL, RTL, LOITER, HOLD])
@pytest.mark.parametrize("view", [DRUM, LOG, BROKEN])
def test_the_rover_is_never_held_in_another_mode(mode: int, view: View) -> None:
    scene = Scene(Policy.HOLD, mode=mode)
    scene.run(1.0)
    scene.run(3.0, view)
    assert scene.modes() == []
    assert scene.calls.hold is None


def test_a_disarmed_rover_is_not_held() -> None:
    scene = Scene(Policy.HOLD, armed=False)
    scene.run(3.0, DRUM)
    assert scene.modes() == []
    scene.human(AUTO, armed=True)
    assert scene.modes() == [HOLD]


def test_nothing_is_commanded_before_the_autopilot_was_heard() -> None:
    scene = Scene(Policy.HOLD)
    scene.autopilot.silent = True
    scene.run(3.0, DRUM)
    assert scene.opened() == [1]
    assert scene.modes() == []
    scene.autopilot.silent = False
    scene.run(0.2)
    assert scene.modes() == [HOLD]


def test_a_mode_that_was_heard_too_long_ago_is_not_commanded_over(hold: Scene) -> None:
    hold.autopilot.silent = True
    hold.run(6.0, CLEAR)
    hold.run(2.0, DRUM)
    assert hold.modes() == []
    hold.autopilot.silent = False
    hold.run(0.2)
    assert hold.modes() == [HOLD]


def test_a_mode_that_was_told_in_the_moment_of_waking_is_old_news(hold: Scene) -> None:
    hold.autopilot.silent = True
    hold.calls.monitor.forget(hold.now)
    hold.hear()
    hold.show(DRUM, DRUM, DRUM)
    assert hold.modes() == []
    hold.autopilot.silent = False
    hold.run(1.0, DRUM)
    assert hold.modes() == [HOLD]


def test_a_position_alone_is_no_news_of_the_mode(hold: Scene) -> None:
    heard = hold.calls.monitor.newest.reported_at
    hold.autopilot.silent = True
    for _ in range(8):
        hold.run(1.0, CLEAR)
        hold.calls.vehicle_reported(replace(reported(AUTO, heard), travelled=3.0), hold.now)
    assert hold.calls.monitor.newest.travelled == 3.0
    hold.run(2.0, DRUM)
    assert hold.modes() == []


def test_a_blocked_way_is_held_under_an_id_of_the_one_counter(hold: Scene) -> None:
    hold.run(1.0, DRUM)
    hold.go()
    hold.run(2.0, CLEAR)
    hold.run(1.0, LOG)
    assert (hold.calls.current_id, hold.calls.kind) == (2, Kind.HOLD)
    assert hold.held()[-1] == {Reason.BLOCKED}
    assert hold.calls.state(hold.now) is State.BLOCKED


def test_the_hold_is_confirmed_by_the_mode_read_back(hold: Scene) -> None:
    hold.autopilot.delay = 0.6
    hold.run(0.5, DRUM)
    assert stage(hold) is HoldState.REQUESTED
    assert hold.events() == []
    hold.run(0.6, DRUM)
    assert stage(hold) is HoldState.STANDING
    assert hold.events() == [HoldEvent.CONFIRMED]


def test_three_tries_then_failed_once_then_a_try_every_five_seconds(hold: Scene) -> None:
    hold.autopilot.deaf = True
    hold.run(20.0, DRUM)
    assert when(hold, HOLD) == [0.0, 1.0, 2.0, 3.0, 8.0, 13.0, 18.0]
    assert hold.events() == [HoldEvent.FAILED]
    assert hold.hold.failed
    hold.autopilot.deaf = False
    hold.run(6.0)
    assert hold.events() == [HoldEvent.FAILED, HoldEvent.CONFIRMED]
    assert not hold.hold.failed


def test_a_hold_that_fails_on_a_silent_autopilot_is_told_and_nothing_more_is_commanded(hold: Scene) -> None:
    hold.run(0.5, DRUM)
    assert hold.calls.hold is not None
    hold.autopilot.silent = hold.autopilot.deaf = True
    hold.calls.hold.enter(HoldState.REQUESTED)
    hold.run(4.0)
    assert hold.events()[-1] is HoldEvent.FAILED
    before = len(hold.modes())
    hold.run(20.0)
    assert len(hold.modes()) <= before + 1


def test_a_hold_that_was_asked_for_is_not_asked_for_again_while_nobody_knows_the_mode(hold: Scene) -> None:
    hold.autopilot.deaf = True
    hold.run(0.5, DRUM)
    hold.autopilot.silent = True
    hold.run(5.5, DRUM)
    asked = hold.modes()
    hold.run(20.0, DRUM)
    assert hold.modes() == asked


def test_a_call_that_opens_while_a_blocked_hold_stands_names_it(blocked: Scene) -> None:
    blocked.run(1.0, DRUM)
    assert blocked.opened() == [2]
    assert blocked.hold.id == 2
    assert len(blocked.all(HoldStarted)) == 1
    assert blocked.modes() == [HOLD]
