"""Rule 8: the open call, our hold, the mode before it and the mode seen last come back from the journal."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.assessment import Reason
from companion.calls.decisions import Call, CallState
from companion.calls.hold import Hold, HoldEvent, HoldState
from companion.calls.machine import OperatorCalls
from companion.calls.mode_monitor import HeldMission
from companion.calls.snapshot import restore, snapshot
from companion.vehicle.state import Mission, MissionState
from companion.wire.ids import Outcome, Policy, Stage, State
from tests.companion.calls.scenes import AUTO, CLEAR, DRUM, GUIDED, HOLD, LOG, MANUAL, Scene

IDS = st.integers(1, 0xFFFF)


def made(saved: Any, policy: Policy = Policy.HOLD) -> OperatorCalls:
    """A state machine that took up where `saved` ended."""
    calls = Scene(policy).calls
    restore(calls, saved, 1000.0)
    return calls


@st.composite
def states(draw: st.DrawFn) -> OperatorCalls:
    """Any call and hold that can be open together."""
    calls = Scene(Policy.HOLD).calls
    call = hold = None
    number = draw(IDS)
    if draw(st.booleans()):
        reasons = draw(st.sets(st.sampled_from([Reason.UNKNOWN_SCENE, Reason.UNKNOWN_OBJECT]), min_size=1))
        call = Call(number, draw(st.integers(0, 2**32 - 1)), reasons, 1.0, None)
        call.state = draw(st.sampled_from(CallState))
        call.learnt, call.quiet = draw(st.booleans()), draw(st.booleans())
    if draw(st.booleans()):
        mode, state = draw(st.sampled_from([AUTO, GUIDED, 0x04040000])), draw(st.sampled_from(HoldState))
        hold = Hold(number, HOLD, mode, 1.0, state, only_fault=draw(st.booleans()))
        item, total = draw(st.integers(0, 0xFFFF)), draw(st.none() | st.integers(1, 0xFFFE))
        mission = Mission(
            item, total, draw(st.sampled_from(MissionState)), draw(st.integers(0, 2**32 - 1)), 1.0
        )
        settled, ended = draw(st.booleans()), draw(st.booleans())
        hold.interrupted = HeldMission(draw(st.sampled_from([None, mission])), None, settled, ended)
    calls.restore(draw(IDS), call, hold, draw(st.none() | st.sampled_from([AUTO, HOLD, MANUAL])))
    return calls


@given(states())
@settings(max_examples=60)
def test_every_state_comes_back_as_it_was_but_for_a_way_back_under_way(calls: OperatorCalls) -> None:
    kept = snapshot(calls)
    back = snapshot(made(json.loads(json.dumps(kept))))
    if kept["hold"] and kept["hold"]["stage"] == "resuming":
        kept["hold"]["stage"] = "standing"
    assert back == kept


RUBBISH = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


@given(states(), st.data())
@settings(max_examples=150)
def test_rubbish_is_refused_and_changes_nothing(calls: OperatorCalls, data: st.DataObject) -> None:
    kept = snapshot(calls)
    parts = [part for part in (kept, kept["call"], kept["hold"]) if part]
    part = data.draw(st.sampled_from(parts))
    part[data.draw(st.sampled_from(sorted(part)))] = data.draw(RUBBISH)
    fresh = Scene(Policy.HOLD).calls
    before = snapshot(fresh)
    try:
        restore(fresh, kept, 1000.0)
    except (KeyError, TypeError, ValueError):
        assert snapshot(fresh) == before
    else:
        assert json.loads(json.dumps(snapshot(fresh)))["last_id"] == kept["last_id"]
        assert 0 <= fresh.current_id <= 0xFFFF


@pytest.mark.parametrize("rubbish", [None, [], "calls", 7, {}, {"last_id": 1}])
def test_what_is_no_snapshot_is_refused(rubbish: Any) -> None:
    with pytest.raises((KeyError, TypeError, ValueError)):
        made(rubbish)


@pytest.mark.parametrize("number", [-1, 0x10000, True, 1.0, "1", None, float("nan")])
def test_an_id_that_is_none_is_refused(held: Scene, number: Any) -> None:
    kept = snapshot(held.calls)
    kept["call"]["id"] = number
    with pytest.raises((TypeError, ValueError)):
        made(kept)


def test_a_call_and_a_hold_of_different_ids_are_refused(held: Scene) -> None:
    kept = snapshot(held.calls)
    kept["hold"]["id"] = 2
    with pytest.raises(ValueError, match="cannot both be open"):
        made(kept)


def test_an_open_call_and_its_hold_go_on_after_a_restart(held: Scene) -> None:
    held.restarted()
    held.judge_again()
    assert held.calls.state(held.now) is State.CALLING
    held.run(3.0, DRUM)
    assert held.opened() == [1]
    assert held.call.id == held.hold.id == 1
    assert held.modes() == [HOLD]
    held.go()
    held.run(1.5, DRUM)
    assert held.autopilot.mode == AUTO
    assert held.closed() == [(1, Outcome.ACCEPTED)]


def test_frame_one_after_a_restart_is_judged_like_any_other(hold: Scene) -> None:
    hold.restarted()
    hold.show(DRUM)
    assert hold.opened() == []
    hold.show(DRUM)
    assert hold.opened() == [1]


def test_ids_go_on_after_a_restart(held: Scene) -> None:
    held.go()
    held.run(2.0, CLEAR)
    held.restarted()
    held.run(1.0, DRUM)
    assert held.opened() == [1, 2]


def test_a_go_does_not_survive_a_restart(held: Scene) -> None:
    held.go()
    held.restarted()
    held.run(1.0, CLEAR)
    assert held.calls.stage() is Stage.CLEAR
    held.run(10.0, CLEAR)
    assert held.autopilot.mode == HOLD


def test_nor_does_what_it_accepted(held: Scene) -> None:
    held.go()
    held.restarted()
    held.run(1.0, DRUM)
    assert held.calls.stage() is Stage.OPEN
    assert held.opened() == [1]


def test_words_that_covered_the_call_survive(held: Scene) -> None:
    held.answer(words={"drum": 1.0})
    held.restarted()
    held.run(1.0, DRUM)
    assert held.calls.stage() is Stage.CLEAR


def test_a_resume_cut_off_by_a_restart_needs_another_go(held: Scene) -> None:
    held.autopilot.deaf = True
    held.go()
    held.run(0.6, DRUM)
    assert snapshot(held.calls)["hold"]["stage"] == "resuming"
    held.restarted()
    assert snapshot(held.calls)["hold"]["stage"] == "standing"
    commanded = held.modes()
    held.run(10.0, CLEAR)
    assert held.modes() == commanded


def test_a_hold_that_was_being_asked_for_is_asked_for_again(hold: Scene) -> None:
    hold.autopilot.deaf = True
    hold.run(0.5, LOG)
    hold.autopilot.deaf = False
    hold.restarted()
    hold.run(0.5, LOG)
    assert hold.autopilot.mode == HOLD
    assert hold.hold.mode_before == AUTO


def test_nothing_is_commanded_over_the_mode_seen_last_before_the_autopilot_is_heard(hold: Scene) -> None:
    hold.autopilot.deaf = True
    hold.run(0.5, LOG)
    hold.autopilot.silent = True
    hold.restarted()
    before = hold.modes()
    hold.run(5.0, LOG)
    assert hold.calls.monitor.newest.mode == AUTO
    assert hold.modes() == before


def test_a_mode_that_a_human_set_while_we_were_down_is_his(held: Scene) -> None:
    held.restarted()
    held.human(MANUAL)
    assert held.events()[-1] is HoldEvent.TAKEN_OVER
    assert held.closed() == [(1, Outcome.TAKEN_OVER)]


def test_without_the_hold_policy_a_kept_hold_is_not_taken_up(held: Scene) -> None:
    calls = made(snapshot(held.calls), Policy.REPORT)
    assert calls.hold is None
    assert calls.call is not None


def test_zero_does_not_mean_a_call_that_a_restart_has_just_found(held: Scene) -> None:
    held.restarted()
    assert held.calls.resolve(0, held.now + 1.0) is None
    assert held.calls.resolve(1, held.now) == 1


def test_a_restored_call_passes_only_after_frames_have_shown_it_gone(report: Scene) -> None:
    report.run(1.0, DRUM)
    report.restarted()
    report.camera = False
    report.run(0.9)
    report.camera = True
    report.run(4.5, CLEAR)
    assert report.closed() == []
    report.run(1.0, CLEAR)
    assert report.closed() == [(1, Outcome.PASSED)]
