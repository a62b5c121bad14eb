"""Hung eyes, broken perceivers, lost cameras: a fault and a hold within T, said once, and the way back."""

from __future__ import annotations

from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import Tap
from companion.calls.decisions import Decision
from companion.cameras.newest import CameraState
from companion.daemon.startup import report_death
from companion.system.error_guard import FatalError
from companion.wire import notices
from companion.wire.ids import Motion, Policy, Result
from tests.companion.daemon.rig import AUTO, HOLD, MANUAL, MakeRig, Rig

T = 1.0
AROUND = (0.4, 0.65, 0.6, 0.9)


def test_without_frames_the_rover_is_held_within_t(rig: Rig) -> None:
    rig.wait(T + 0.3)
    assert rig.stage.mode == HOLD
    assert rig.state == ("FAULT", 1)
    assert "H1 FAULT camera silent" in rig.texts


def test_with_half_a_second_of_latency_the_hold_still_comes_at_t_after_the_last_capture(rig: Rig) -> None:
    rig.latency = 0.5
    rig.see(2.0)
    newest = rig.calls.reason_filter.newest
    assert newest is not None
    assert rig.stage.mode == AUTO
    while rig.stage.mode == AUTO:
        rig.wait(0.1)
    assert T < rig.clock.now - newest.frame.captured_at <= T + 0.15
    assert rig.daemon.status.figures()["latency_ms"] == 500.0


@pytest.mark.parametrize(
    ("state", "text"), [(CameraState.ENDED, "camera ended"), (CameraState.FAILED, "camera failed")]
)
def test_the_camera_that_is_gone_is_named(make_rig: MakeRig, state: CameraState, text: str) -> None:
    rig = make_rig(Policy.REPORT)
    rig.camera.status = replace(rig.camera.status, state=state)
    rig.wait(2.0)
    assert rig.state == ("FAULT", 0)
    assert rig.texts == [f"Companion FAULT: {text}"]


def test_hung_eyes_are_told_from_a_lost_camera(rig: Rig) -> None:
    rig.hung = True
    rig.see(T + 0.5)
    assert rig.stage.mode == HOLD
    assert "H1 FAULT vision hangs" in rig.texts


def test_eyes_that_hang_just_after_they_told_of_the_camera_are_no_lost_camera(rig: Rig) -> None:
    rig.see(1.0)
    rig.wait(0.2)
    rig.hung = True
    rig.wait(T + 0.3)
    assert rig.stage.mode == HOLD
    told = {text for text in rig.texts if "FAULT" in text}
    assert told == {"H1 FAULT vision hangs", "Companion FAULT: vision hangs"}


def test_a_perceiver_that_fails_on_every_frame_is_a_fault(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rig.perceiver, "encode", lambda _: 1 / 0)
    rig.see(T + 0.5)
    assert rig.state == ("FAULT", 1)
    assert "H1 FAULT the perceiver failed" in rig.texts


def test_a_frame_whose_judging_took_longer_than_t_is_no_fresh_view(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    encode = rig.perceiver.encode

    def slow(image: object) -> object:
        for _ in range(12):
            rig.clock.now += T / 10
            rig.turn()
        return encode(image)  # type: ignore[arg-type]

    monkeypatch.setattr(rig.perceiver, "encode", slow)
    rig.see(1.0)
    assert rig.state[0] == "FAULT"
    assert rig.stage.mode == HOLD
    assert rig.calls.reason_filter.newest is not None
    assert not rig.calls.reason_filter.newest.ok


@pytest.mark.slow
def test_a_fault_that_comes_and_goes_is_said_once(make_rig: MakeRig) -> None:
    rig = make_rig(Policy.REPORT)
    for _ in range(8):
        rig.wait(1.3)
        rig.see(0.6)
    assert rig.texts == ["Companion FAULT: camera silent"]
    rig.see(4.0)
    assert rig.texts == ["Companion FAULT: camera silent", "Companion sees again"]
    assert rig.state == ("OK", 0)


def test_a_camera_that_comes_back_does_not_resume_by_itself(rig: Rig) -> None:
    rig.wait(2.0)
    rig.see(8.0)
    assert rig.stage.mode == HOLD
    assert "H1 clear now, go?" in rig.texts
    rig.answer(1, Motion.GO)
    rig.see(2.0)
    assert rig.stage.mode == AUTO
    assert rig.state == ("OK", 0)


def test_answers_while_vision_hangs_are_busy_and_stay_counts_at_once(held: Rig) -> None:
    held.hung = True
    held.see(2.5, "drum")
    held.answer(1, Motion.GO, transaction=21)
    held.word(1, "drum", 0.5)
    held.see(0.3, "drum")
    assert [ack.result for ack in held.acks] == [Result.BUSY, Result.BUSY]
    held.answer(1, Motion.STAY, transaction=22)
    held.see(0.3, "drum")
    assert held.acks[-1].result is Result.APPLIED
    held.hung = False
    held.see(1.0, "drum")
    held.word(1, "drum", 0.5)
    held.see(0.5, "drum")
    assert held.acks[-1].result is Result.APPLIED


def test_a_vision_that_hangs_is_killed_and_started_again_on_what_it_knew(held: Rig) -> None:
    held.word(0, "trail", 1.0)
    held.see(0.5, "drum")
    before, words = held.child, held.vision.memory.preferences.format()
    assert "trail" in words
    held.hung = True
    held.see(4.0, "drum")
    assert before.death == "closed"
    assert held.child is not before
    held.hung = False
    held.see(1.0, "drum")
    assert held.engine.memory.preferences.format() == words
    assert held.vision.trouble == ""
    assert held.state == ("CALLING", 1)
    # The new process has judged no frame yet.
    faults = ["C1 FAULT vision hangs", "C1 FAULT no fresh frame"]
    assert [text for text in held.texts if "FAULT" in text] == faults


@pytest.mark.slow
def test_an_answer_caught_by_the_hang_is_busy_leaves_nothing_and_its_go_is_void(held: Rig) -> None:
    held.hung = True
    held.word(1, "drum", 0.5, Motion.GO)
    held.see(2.9, "drum")
    assert held.acks == []
    held.see(1.0, "drum")
    assert [(ack.result, ack.text) for ack in held.acks] == [(Result.BUSY, "vision restarted: send it again")]
    held.hung = False
    held.see(6.0)
    assert "drum" not in held.engine.memory.preferences
    assert held.stage.mode == HOLD, "clear, but nobody said go since"
    held.word(1, "drum", 0.5, Motion.GO)
    held.see(2.0, "drum")
    assert [ack.result for ack in held.acks] == [Result.BUSY, Result.APPLIED], "the same transaction counts"
    assert held.engine.memory.preferences["drum"] == 0.5
    assert held.stage.mode == AUTO


def test_the_frame_of_the_call_outlives_a_vision_that_hung(held: Rig) -> None:
    asked = held.calls.call
    assert asked is not None
    frame = asked.frame_id
    held.hung = True
    held.see(4.0)
    held.hung = False
    held.see(1.0)
    assert held.calls.call is asked
    assert asked.frame_id == frame
    held.answer(1, Motion.GO, Tap(frame, AROUND, "gnome", 1.0), transaction=31)
    held.see(0.5)
    assert held.acks[-1].result is Result.APPLIED
    assert held.engine.memory.examples["gnome"]


@pytest.mark.slow
def test_after_three_deaths_in_ten_minutes_the_hold_needs_a_go_and_an_alert_says_so(rig: Rig) -> None:
    for _ in range(3):
        rig.child.death = "SIGSEGV"
        rig.wait(6.0)
        rig.see(6.0)
    alerts = [m.text for m in rig.stage.sent("STATUSTEXT") if m.severity == 1]
    assert notices.vision_unreliable(hold=True) in alerts
    assert rig.vision.watchdog.restarted == 3
    assert rig.stage.mode == HOLD
    rig.see(8.0)
    assert rig.stage.mode == HOLD
    rig.answer(rig.calls.current_id, Motion.GO)
    rig.see(2.0)
    assert rig.stage.mode == AUTO


@pytest.mark.slow
def test_a_go_given_before_the_third_death_is_void(rig: Rig) -> None:
    for _ in range(2):
        rig.child.death = "SIGSEGV"
        rig.wait(6.0)
        rig.see(6.0)
    assert rig.stage.mode == HOLD
    rig.wait(2.0)
    rig.answer(rig.calls.current_id, Motion.GO)
    rig.wait(0.5)
    assert rig.calls.go_at is not None
    rig.child.death = "SIGSEGV"
    rig.wait(6.0)
    rig.see(8.0)
    assert rig.stage.mode == HOLD


def test_a_go_for_a_hold_without_a_call_counts_while_the_eyes_hang(rig: Rig) -> None:
    rig.hung = True
    rig.see(4.0)
    rig.answer(1, Motion.GO)
    rig.see(0.3)
    assert rig.acks[-1].result is Result.APPLIED
    assert rig.stage.mode == HOLD, "but it waits for a clear view"
    rig.hung = False
    rig.see(2.0)
    assert rig.stage.mode == AUTO


def test_a_parameter_while_the_eyes_hang_keeps_its_value_and_is_told(rig: Rig) -> None:
    rig.hung = True
    rig.see(3.0)
    rig.set("AT_W_GRASS", -1.0)
    rig.set("AT_THR_ROI", 0.9)
    rig.see(0.5)
    assert rig.echoes("AT_W_GRASS")[-1] == 1.0
    assert rig.echoes("AT_THR_ROI")[-1] == 0.3
    assert "Refused: vision is busy, set it again" in rig.texts


def test_an_error_in_one_message_is_survived_and_seen(rig: Rig) -> None:
    rig.fails = True
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(rig.answer_handler, "receive", lambda *_: 1 / 0)
        for number in range(5):
            rig.answer(0, Motion.GO, transaction=number + 1)
            rig.see(0.2)
    assert rig.texts == ["Companion error: see its log"]
    rig.see(1.0, "drum")
    assert rig.state == ("CALLING", 1), "it still watches"


def test_a_picture_that_fails_keeps_no_hold_from_being_commanded(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig.fails = True
    monkeypatch.setattr(rig.frames, "call_opened", lambda *_: 1 / 0)
    rig.see(1.0, "drum")
    assert rig.stage.mode == HOLD
    assert rig.state == ("CALLING", 1)


def commands_of_death(rig: Rig) -> list[int]:
    """Let the daemon report its death, and return the modes that it then commands."""
    before = len(rig.stage.frames)
    report_death(rig.stage.link, rig.calls)
    rig.stage.collect(rig.stage.now)
    sent = [frame.message for frame in rig.stage.frames[before:]]
    commands = [message for message in sent if message.get_type() == "COMMAND_LONG"]
    return [int(one.param2) for one in commands if one.command == mavlink.MAV_CMD_DO_SET_MODE]


@pytest.mark.parametrize(
    ("part", "method"),
    [
        ("reason_filter", "add_frame"),
        ("holding", "vehicle_reported"),
        ("holding", "settle"),
        ("holding", "release"),
    ],
    ids=["a frame", "a report of the autopilot", "the passing of time", "a change of policy"],
)
def test_an_error_in_the_state_machine_ends_the_daemon_whatever_led_to_it_and_holds_the_rover(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, part: str, method: str
) -> None:
    rig.see(1.0)
    monkeypatch.setattr(getattr(rig.calls, part), method, lambda *_, **__: 1 / 0)
    monkeypatch.setattr("time.sleep", rig.clock.sleep)
    if method == "release":
        rig.set("AT_POLICY", float(Policy.OFF))
    with pytest.raises(FatalError):
        rig.see(2.0)
    assert commands_of_death(rig) == ([] if method == "release" else [HOLD])
    assert rig.state[0] == "FAULT"
    assert rig.texts[-1] == "Companion STOPS, internal error: WATCH THE TRAIL"


def test_a_human_whose_mode_led_to_the_error_is_not_held(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    rig.see(1.0)
    monkeypatch.setattr(rig.calls.holding, "vehicle_reported", lambda *_: 1 / 0)
    monkeypatch.setattr("time.sleep", rig.clock.sleep)
    rig.stage.mode = MANUAL
    with pytest.raises(FatalError):
        rig.see(2.0)
    assert commands_of_death(rig) == []


@pytest.mark.parametrize(("part", "method"), [("holding", "answer"), ("holding", "confirm_go")])
def test_an_error_while_a_go_is_applied_ends_the_daemon_and_the_rover_stands(
    held: Rig, monkeypatch: pytest.MonkeyPatch, part: str, method: str
) -> None:
    monkeypatch.setattr(getattr(held.calls, part), method, lambda *_: 1 / 0)
    monkeypatch.setattr("time.sleep", held.clock.sleep)
    held.answer(0, Motion.GO)
    with pytest.raises(FatalError):
        held.see(2.0, "drum")
    assert commands_of_death(held) == []
    assert held.stage.mode == HOLD


@pytest.mark.parametrize(("policy", "mode"), [(Policy.SHADOW, AUTO), (Policy.HOLD, MANUAL)])
def test_a_dying_daemon_commands_nothing_without_the_hold_policy_or_over_a_human(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch, policy: Policy, mode: int
) -> None:
    rig = make_rig(policy)
    rig.stage.mode = mode
    rig.see(1.5)
    monkeypatch.setattr("time.sleep", rig.clock.sleep)
    assert commands_of_death(rig) == []


def test_a_dying_daemon_sends_no_resume_that_waits(held: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    link, tick = held.stage.link, held.calls.tick
    monkeypatch.setattr(
        held.calls, "tick", lambda now: 1 / 0 if link._outbox.waiting("resume") else tick(now)
    )
    monkeypatch.setattr("time.sleep", held.clock.sleep)
    held.answer(0, Motion.GO)
    with pytest.raises(ZeroDivisionError):
        held.see(3.0)
    assert AUTO not in commands_of_death(held)
    assert held.stage.mode == HOLD


def test_a_dying_daemon_holds_a_rover_that_was_just_told_to_drive_on(
    held: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("time.sleep", held.clock.sleep)
    turn, tick = held.turn, held.calls.tick

    def slow_autopilot() -> None:
        turn()
        held.stage.mode = HOLD

    def told_to_drive_on(now: float) -> list[Decision]:
        told = [one for one in held.stage.sent("COMMAND_LONG")[before:] if one.command == 176]
        assert not told
        return tick(now)

    monkeypatch.setattr(held, "turn", slow_autopilot)
    monkeypatch.setattr(held.calls, "tick", told_to_drive_on)
    before = len(held.stage.sent("COMMAND_LONG"))
    held.answer(0, Motion.GO)
    with pytest.raises(AssertionError):
        held.see(3.0)
    assert commands_of_death(held) == [HOLD]


def test_a_hold_that_waits_is_not_sent_by_a_daemon_that_dies_as_the_policy_leaves_hold(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("time.sleep", rig.clock.sleep)
    while rig.calls.hold is None:
        rig.stage.near.full = True
        rig.see(0.1, "drum")
    monkeypatch.setattr(rig.calls.holding, "release", lambda *_: 1 / 0)
    with pytest.raises(FatalError):
        rig.settings.policy.set(Policy.REPORT, (255, 190), rig.clock.now)
    rig.stage.near.full = False
    assert commands_of_death(rig) == []
