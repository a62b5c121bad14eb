"""Rule 13: report, shadow, hold and off, and switching between them at any moment."""

from __future__ import annotations

import pytest

from anytraverse.assessment import Reason
from companion.calls.decisions import WouldHold
from companion.calls.hold import HoldEvent, HoldState
from companion.config import Config
from companion.daemon.settings.runtime import restored_policy
from companion.wire.ids import Outcome, Policy, Stage, State
from tests.companion.calls.scenes import AUTO, BROKEN, CLEAR, DRUM, HOLD, LOG, MANUAL, Scene, View

IDLE = [Policy.REPORT, Policy.SHADOW, Policy.OFF]
DRIVABLE = {"drum": 1.0}


@pytest.mark.parametrize("policy", IDLE)
@pytest.mark.parametrize("view", [DRUM, LOG, BROKEN])
def test_only_the_hold_policy_commands_a_mode(policy: Policy, view: View) -> None:
    scene = Scene(policy)
    scene.run(1.0)
    scene.run(3.0, view)
    assert scene.modes() == []
    assert scene.calls.hold is None


def test_report_is_the_default() -> None:
    assert restored_policy(Config(), None, 0.0).in_force is Policy.REPORT


def test_switched_off_nothing_is_called_and_the_heartbeat_says_so() -> None:
    scene = Scene(Policy.OFF)
    scene.run(3.0, DRUM)
    assert scene.log == []
    assert scene.calls.state(scene.now) is State.OFF


def test_shadow_calls_and_tells_once_what_would_have_been_held() -> None:
    scene = Scene(Policy.SHADOW)
    scene.run(1.0)
    scene.run(5.0, DRUM)
    assert scene.opened() == [1]
    assert scene.all(WouldHold) == [WouldHold(frozenset({Reason.UNKNOWN_OBJECT}), 1)]


def test_shadow_counts_the_next_stop_after_five_ok_frames() -> None:
    scene = Scene(Policy.SHADOW)
    scene.run(1.0)
    scene.run(1.0, LOG)
    scene.run(0.3, CLEAR)
    scene.run(0.5, LOG)
    assert len(scene.all(WouldHold)) == 1
    scene.run(1.0, CLEAR)
    scene.run(1.0, LOG)
    assert len(scene.all(WouldHold)) == 2


def test_shadow_counts_nothing_that_hold_would_not_have_held() -> None:
    scene = Scene(Policy.SHADOW, mode=MANUAL)
    scene.run(3.0, DRUM)
    assert scene.all(WouldHold) == []


def test_shadow_without_an_autopilot_tells_what_it_would_do() -> None:
    scene = Scene(Policy.SHADOW)
    scene.autopilot.silent = True
    scene.run(3.0, DRUM)
    assert len(scene.all(WouldHold)) == 1


def brought_to(stage: HoldState, scene: Scene) -> Scene:
    """A hold of a drum in the given stage."""
    scene.autopilot.deaf = stage is HoldState.REQUESTED
    scene.run(1.0, DRUM)
    if stage is HoldState.RESUMING:
        scene.autopilot.deaf = True
        scene.go()
        scene.run(0.6)
    assert scene.hold.state is stage
    return scene


@pytest.mark.parametrize("policy", IDLE)
@pytest.mark.parametrize("stage", list(HoldState))
def test_without_the_hold_policy_nothing_is_commanded_any_more_nor_the_way_back(
    hold: Scene, policy: Policy, stage: HoldState
) -> None:
    brought_to(stage, hold)
    before = hold.modes()
    hold.policy(policy)
    assert hold.events()[-1] is HoldEvent.DROPPED
    hold.run(10.0, CLEAR)
    assert hold.modes() == before
    assert hold.calls.hold is None
    assert hold.calls.current_id == 0


def test_switching_off_closes_the_call_as_switched_off(held: Scene) -> None:
    held.policy(Policy.OFF)
    assert held.closed() == [(1, Outcome.SWITCHED_OFF)]
    assert held.calls.stage() is Stage.CLOSED


def test_an_answered_call_does_not_outlive_a_dropped_hold(held: Scene) -> None:
    held.answer(words=DRIVABLE)
    held.policy(Policy.REPORT)
    assert held.closed() == [(1, Outcome.ANSWERED)]


def test_an_open_call_outlives_a_dropped_hold_and_then_passes(held: Scene) -> None:
    held.policy(Policy.REPORT)
    held.run(1.0)
    assert held.closed() == []
    held.run(6.0, CLEAR)
    assert held.closed() == [(1, Outcome.PASSED)]


def test_allowed_to_hold_the_rover_is_held_at_once_for_what_is_open(report: Scene) -> None:
    report.run(2.0, DRUM)
    report.policy(Policy.HOLD)
    assert report.modes() == [HOLD]
    assert report.hold.id == report.call.id


def test_the_hold_policy_said_twice_changes_nothing(held: Scene) -> None:
    held.policy(Policy.HOLD)
    held.run(5.0)
    assert held.modes() == [HOLD]


def test_switched_on_again_what_is_there_is_called_anew(held: Scene) -> None:
    held.policy(Policy.OFF)
    held.autopilot.mode = AUTO
    held.run(5.0)
    held.policy(Policy.HOLD)
    held.run(1.0)
    assert held.opened() == [1, 2]
    assert held.autopilot.mode == HOLD


def test_switched_on_again_nothing_that_was_accepted_counts(held: Scene) -> None:
    held.go()
    held.run(1.5)
    assert held.autopilot.mode == AUTO
    held.policy(Policy.OFF)
    held.policy(Policy.HOLD)
    held.run(1.0)
    assert held.opened() == [1, 2]
    assert held.autopilot.mode == HOLD


def test_a_blackout_while_off_is_a_fault_when_switched_on() -> None:
    scene = Scene(Policy.HOLD)
    scene.run(1.0)
    scene.policy(Policy.OFF)
    scene.camera = False
    scene.run(5.0)
    scene.policy(Policy.HOLD)
    assert scene.held() == [frozenset({Reason.FAULT})]
