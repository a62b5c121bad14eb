"""What the ground sends: answers to calls and holds, words alone, parameters, carried out or refused."""

from __future__ import annotations

import logging
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import ForgetCall, ForgetWord, SetWord, Tap
from anytraverse.regions import Box
from companion.config import Config
from companion.config.schema import MountSection, StoppingSection
from companion.pages.given import Answered, OwnAnswers
from companion.wire.answers import Answer
from companion.wire.call_report import CallReport
from companion.wire.delivery import Pending
from companion.wire.documents import state_from
from companion.wire.ids import CHANGING_RESULTS, TUNNEL_CALL, Kind, Motion, Outcome, Policy, Result, Stage
from tests.anytraverse.conftest import AHEAD
from tests.companion.daemon.rig import AUTO, HOLD, MANUAL, MakeRig, Rig

BOX = (AHEAD.left, AHEAD.top, AHEAD.right, AHEAD.bottom)


def closed(rig: Rig) -> list[tuple[Kind, int, Outcome]]:
    """What was told to be over, each once."""
    told = [CallReport.unpack(payload) for payload in rig.stage.tunnels(TUNNEL_CALL)]
    return list(dict.fromkeys((one.kind, one.id, one.outcome) for one in told if one.stage is Stage.CLOSED))


def test_a_call_answered_by_a_tap_and_go_is_over_and_the_rover_drives_on(held: Rig) -> None:
    call = held.calls.call
    assert call is not None
    held.answer(1, Motion.GO, Tap(call.frame_id, BOX, "gnome", 0.5))
    held.see(3.0, "drum")
    assert held.acks[-1].result is Result.APPLIED
    assert held.stage.mode == AUTO
    assert closed(held) == [(Kind.CALL, 1, Outcome.ANSWERED)]
    assert held.state == ("OK", 0)


@pytest.mark.slow
def test_a_thing_named_not_drivable_keeps_the_rover_standing(held: Rig) -> None:
    held.word(1, "drum", -1.0, Motion.GO)
    held.see(10.0, "drum")
    assert held.stage.mode == HOLD
    assert held.state == ("BLOCKED", 1)


def test_words_without_anything_open_apply_at_once(rig: Rig) -> None:
    rig.word(0, "drum", -1.0)
    rig.see(0.3)
    assert rig.acks[-1].result is Result.APPLIED
    assert rig.acks[-1].text == "in use: grass: 1; rock: -1; drum: -1"
    assert rig.echoes("AT_W_DRUM")[-1] == -1.0


def test_a_tap_without_a_call_is_refused_with_what_to_do(rig: Rig) -> None:
    rig.answer(0, Motion.NONE, Tap(3, BOX, "gnome", -1.0))
    rig.see(0.3)
    assert (rig.acks[-1].result, rig.acks[-1].text) == (
        Result.REFUSED,
        "no picture to tap in: say the word alone",
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("operation", "text"),
    [
        (ForgetWord("mud"), '"mud" is not in use. In use: grass, rock'),
        (ForgetCall(9), "nothing was learnt from call 9, nor from any"),
    ],
)
def test_to_forget_what_is_not_there_answers_no_call(
    held: Rig, operation: ForgetWord | ForgetCall, text: str
) -> None:
    words = held.vision.words
    held.answer(1, Motion.GO, SetWord("drum", 1.0), operation)
    held.see(2.0, "drum")
    assert (held.acks[-1].result, held.acks[-1].text) == (Result.REFUSED, text)
    assert (held.state, held.stage.mode, held.vision.words) == (("CALLING", 1), HOLD, words)


def test_a_word_forgotten_once_is_acknowledged_again_over_a_restart_and_refused_as_a_new_answer(
    rig: Rig,
) -> None:
    rig.answer(0, Motion.NONE, ForgetWord("rock"))
    rig.see(0.3)
    rig.answer(0, Motion.NONE, ForgetWord("rock"))
    rig.see(0.3)
    assert [ack.result for ack in rig.acks] == [Result.APPLIED] * 2
    rig.restart()
    rig.answer(0, Motion.NONE, ForgetWord("rock"))
    rig.answer(0, Motion.NONE, ForgetWord("rock"), transaction=8)
    rig.see(0.5)
    told = {ack.transaction: (ack.result, ack.text) for ack in rig.acks}
    assert told[7] == (Result.APPLIED, "in use: grass: 1")
    assert told[8] == (Result.REFUSED, '"rock" is not in use. In use: grass')


def test_a_weight_set_to_not_in_use_twice_is_no_mistake(rig: Rig) -> None:
    for _ in range(2):
        rig.set("AT_W_ROCK", -2.0)
        rig.see(0.3)
    assert rig.echoes("AT_W_ROCK")[-2:] == [-2.0, -2.0]
    assert not [text for text in rig.texts if "not in use" in text]


@pytest.mark.slow
def test_a_hold_for_a_mistaken_name_is_shown_and_ended_by_a_tap_on_what_it_is(held: Rig) -> None:
    call = held.calls.call
    assert call is not None
    held.answer(1, Motion.GO, Tap(call.frame_id, BOX, "gnome", -1.0))
    held.see(2.0)
    assert (held.stage.mode, held.state) == (AUTO, ("OK", 0))

    held.see(2.0, "drum")
    assert (held.stage.mode, held.state) == (HOLD, ("BLOCKED", 2))
    hold = held.calls.hold
    assert hold is not None
    assert hold.seen is not None
    told = [CallReport.unpack(payload) for payload in held.stage.tunnels(TUNNEL_CALL)][-1]
    assert (told.kind, told.frame_id) == (Kind.HOLD, hold.seen.frame.id)
    held.answer(2, Motion.GO, Tap(told.frame_id - 1, BOX, "gnome", 1.0), transaction=8)
    held.see(1.0, "drum")
    held.answer(2, Motion.GO, Tap(told.frame_id, BOX, "gnome", 1.0), transaction=9)
    held.see(2.0, "drum")
    assert [ack.result for ack in held.acks[-2:]] == [Result.REFUSED, Result.APPLIED]
    assert held.stage.mode == AUTO
    assert closed(held)[-1] == (Kind.HOLD, 2, Outcome.ANSWERED)


def test_words_and_go_for_a_hold_that_is_no_call(rig: Rig) -> None:
    rig.see(2.0, "rock")
    assert rig.state == ("BLOCKED", 1)
    rig.word(1, "rock", 0.5, Motion.GO)
    rig.see(2.0, "rock")
    assert rig.acks[-1].result is Result.APPLIED
    assert rig.stage.mode == AUTO
    assert closed(rig) == [(Kind.HOLD, 1, Outcome.ANSWERED)]


@pytest.mark.parametrize("motion", list(Motion))
def test_an_answer_to_what_is_not_open_is_refused_with_the_reason(rig: Rig, motion: Motion) -> None:
    rig.answer(9, motion, SetWord("drum", -1.0))
    rig.see(0.3)
    assert (rig.acks[-1].result, rig.acks[-1].text) == (
        Result.STALE,
        "No open call or hold 9: nothing changed",
    )
    assert "drum" not in rig.vision.words


def test_an_answer_whose_call_closes_meanwhile_is_told_so_and_moves_nothing(held: Rig) -> None:
    held.hung = True
    held.word(1, "drum", 0.5, Motion.GO)
    held.see(0.3, "drum")
    held.stage.mode = MANUAL
    held.stage._heartbeat_at = 0.0
    held.see(0.3, "drum")
    held.hung = False
    held.see(0.5, "drum")
    assert (held.acks[-1].result, held.acks[-1].outcome) == (Result.STALE, Outcome.NONE)
    assert held.acks[-1].text.startswith("1 is closed; in use: ")
    assert held.stage.mode == MANUAL


def test_a_word_that_the_perceiver_does_not_know_is_refused_by_name(rig: Rig) -> None:
    rig.word(0, "unicorn", 1.0)
    rig.see(0.3)
    assert rig.acks[-1].result is Result.REFUSED
    assert "unicorn" in rig.acks[-1].text
    assert rig.vision.words.format() == "grass: 1; rock: -1"


def test_a_parameter_that_the_perceiver_refuses_echoes_the_old_value_with_a_text(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rig.perceiver, "meaning", lambda _: "the same for all")
    rig.set("AT_W_DRUM", 1.0)
    rig.see(0.3)
    assert rig.echoes("AT_W_DRUM") == [-2.0]
    assert any(text.startswith("Refused: ") for text in rig.texts)


def test_a_threshold_reaches_eyes_and_state_machine(held: Rig) -> None:
    held.set("AT_THR_ROI", 1.0)
    held.see(0.3, "drum")
    assert held.echoes("AT_THR_ROI") == [1.0]
    assert held.engine.settings.thresholds.roi == held.calls.numbers.judging.thresholds.roi == 1.0
    held.see(3.0, "drum")
    assert held.state == ("CALLING", 1), "no threshold makes a way of what has no word"
    held.see(3.0)
    assert held.texts[-1] == "C1 clear now, go?"


@pytest.mark.parametrize("name", ["AT_THR_ROI", "AT_THR_TILE"])
def test_a_threshold_that_cannot_be_is_refused_and_the_old_one_stays(rig: Rig, name: str) -> None:
    before = rig.calls.numbers.judging.thresholds
    rig.set(name, 0.0)
    rig.see(0.5)
    assert rig.calls.numbers.judging.thresholds == before
    assert rig.echoes(name) == [{"AT_THR_ROI": 0.3, "AT_THR_TILE": -2.0}[name]]
    assert any(text.startswith("Refused: ") for text in rig.texts)
    assert rig.state == ("OK", 0)


@pytest.mark.slow
def test_a_policy_without_holds_lets_go_of_the_hold_and_says_so(held: Rig) -> None:
    held.set("AT_POLICY", float(Policy.REPORT))
    held.see(2.0, "drum")
    assert "Companion policy: report (by 255/190)" in held.texts
    assert "C1 let go: drive on by hand" in held.texts
    assert held.state == ("CALLING", 1), "the question stays"
    held.answer(1, Motion.GO)
    held.see(2.0)
    assert held.stage.mode == HOLD, "who may not hold may not resume"


@pytest.mark.slow
def test_switched_off_everything_is_over_and_said_again_and_again(held: Rig) -> None:
    held.set("AT_POLICY", float(Policy.OFF))
    held.see(20.0, "drum")
    assert closed(held) == [(Kind.CALL, 1, Outcome.SWITCHED_OFF)]
    assert held.state == ("OFF", 0)
    assert held.texts.count("Companion OFF by 255/190: nobody watches the trail") == 2


def test_a_hold_that_goes_on_as_a_call_is_told_to_be_over(rig: Rig) -> None:
    rig.wait(2.0)
    rig.see(3.0, "drum")
    assert rig.state == ("CALLING", 2)
    assert closed(rig) == [(Kind.HOLD, 1, Outcome.NONE)]


def test_a_human_who_takes_over_right_after_a_restart_closes_the_call_not_a_hold(held: Rig) -> None:
    held.restart()
    held.stage.mode = MANUAL
    held.see(1.0, "drum")
    assert "C1 taken over by hand: MANUAL" in held.texts
    assert closed(held) == [(Kind.CALL, 1, Outcome.TAKEN_OVER)]


@pytest.mark.parametrize(("mode", "name"), [(11, "RTL"), (12, "SMART_RTL")])
def test_a_fence_that_drives_it_home_out_of_our_hold_is_not_told_to_be_a_hand(
    held: Rig, mode: int, name: str
) -> None:
    held.stage.mode = mode
    held.see(1.0, "drum")
    assert f"C1 taken over: {name}, not by us" in held.texts
    assert "C1 closed: taken over, not by us" in held.texts
    assert not [text for text in held.texts if "hand" in text or "human" in text]
    assert closed(held) == [(Kind.CALL, 1, Outcome.TAKEN_OVER)]


def test_an_old_mode_told_with_positions_is_no_news_of_the_mode(rig: Rig) -> None:
    from pymavlink.dialects.v20 import development as mavlink

    rig.stage.vehicle = None
    for _ in range(80):
        message = mavlink.MAVLink_global_position_int_message(0, 515000000, 0, 0, 0, 100, 0, 0, 0)
        rig.stage.send(message, (1, 1))
        rig.see(0.1)
    rig.see(2.0, "drum")
    assert rig.calls.call is not None
    assert rig.calls.hold is None, "nobody knows what drives it"


def test_in_report_policy_a_thing_that_is_gone_passes(make_rig: MakeRig) -> None:
    rig = make_rig(Policy.REPORT)
    rig.see(1.0, "drum")
    rig.see(7.0)
    assert closed(rig) == [(Kind.CALL, 1, Outcome.PASSED)]
    assert rig.stage.mode == AUTO


def test_a_region_of_interest_that_sees_less_far_is_judged_for_the_hold_policy_too(rig: Rig) -> None:
    rig.config = replace(
        Config(),
        mount=MountSection(height=1.0, tilt=10.0),
        stopping=StoppingSection(speed=1.0, time_constant=0.1, braking=1.0),
    )
    rig.restart()
    rig.see(2.0)
    told = [rig.told_policy]
    judging, states = rig.calls.numbers.judging, list[str]()
    for region in (Box(0.3, 0.8, 0.7, 0.95), judging.region):
        rig.calls.retune(replace(judging, region=region))
        rig.see(2.0)
        told.append(rig.told_policy)
        states.append(rig.state[0])
    assert any(text.startswith("FAULT: 1.0 m/s: at most 0.") for text in rig.texts)
    assert told == [Policy.HOLD] * 3, "nobody sets it but the operator"
    assert states == ["FAULT", "HOLDING"]


def test_an_autopilot_that_refuses_a_mode_is_in_the_log(rig: Rig, caplog: pytest.LogCaptureFixture) -> None:
    denied = mavlink.MAVLink_command_ack_message(176, 2, 0, 0, 1, 191)
    rig.see(1.0, "drum")
    with caplog.at_level(logging.INFO, "companion.link.mode_commands"):
        rig.stage.send(denied, (1, 1))
        rig.see(0.1, "drum")
    assert "says no to mode 4: MAV_RESULT 2" in caplog.text


@pytest.mark.slow
def test_the_undo_of_an_answer_that_forgot_a_tapped_word_is_taken(held: Rig) -> None:
    call = held.calls.call
    assert call is not None
    held.answer(1, Motion.NONE, Tap(call.frame_id, BOX, "gnome", -1.0))
    held.see(1.0, "drum")
    state = state_from(held.daemon.status.state_file())
    assert state.tapped == ("gnome",)
    answer = Answer(1, Motion.GO, (ForgetWord("gnome"), SetWord("trail", 1.0)), 8)
    given = Pending(1, answer, 0.0)
    held.answer(1, answer.motion, *answer.changes, transaction=8)
    held.see(4.0, "drum")
    given.acknowledge(held.acks[-1], final=True)
    undoing = OwnAnswers([Answered(given, 0.0, state.words, None, state.tapped)]).undoing()
    held.answer(0, Motion.NONE, *undoing, transaction=9)
    held.see(1.0, "drum")
    assert held.acks[-1].result in CHANGING_RESULTS
    assert set(held.vision.words) == {"grass", "rock"}
