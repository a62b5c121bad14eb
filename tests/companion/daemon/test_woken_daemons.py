"""Rule 12 after SIGSTOP and SIGCONT: what waited in the socket is old, and a human may have taken over."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.calls.hold import HoldState
from companion.link.channel import READS_PER_POLL
from companion.wire.ids import Motion, Result
from tests.companion.daemon.rig import AUTO, HOLD, MANUAL, MakeRig, Rig

RTL = 11


def sleep(rig: Rig, seconds: float, *told: int, busy: int = READS_PER_POLL) -> None:
    """Stopped, while the autopilot tells these modes, each `busy` times, and stays in the last."""
    rig.clock.now += seconds
    rig.stage.now = rig.clock.now
    for mode in told:
        rig.stage.mode = mode
        for _ in range(busy):  # by default more than one turn reads
            rig.stage.heartbeat(1)


def orders(rig: Rig) -> int:
    return sum(message.command == 176 for message in rig.stage.sent("COMMAND_LONG"))


@pytest.mark.slow
@pytest.mark.parametrize("mode", [MANUAL, RTL])
@pytest.mark.parametrize("seconds", [1.2, 3.0, 30.0])
def test_a_human_who_took_over_meanwhile_is_not_overruled_by_old_news(
    rig: Rig, mode: int, seconds: float
) -> None:
    sleep(rig, seconds, AUTO, AUTO, mode)
    rig.wait(3.0)
    assert orders(rig) == 0
    assert rig.stage.mode == mode


def test_one_who_took_over_unheard_is_not_either(rig: Rig) -> None:
    sleep(rig, 2.0, AUTO)
    rig.stage._heartbeat_at = rig.clock.now + 0.9
    rig.stage.mode = MANUAL
    rig.wait(0.8)
    assert orders(rig) == 0
    rig.wait(3.0)
    assert orders(rig) == 0


def test_where_the_vehicle_is_does_not_tell_its_mode(rig: Rig) -> None:
    position = mavlink.MAVLink_global_position_int_message(0, 470000000, 80000000, 0, 0, 100, 0, 0, 0)
    sleep(rig, 2.0, AUTO)
    rig.stage._heartbeat_at = rig.clock.now + 0.9
    rig.stage.mode = MANUAL
    for _ in range(8):
        rig.stage.send(position, (1, 1))
        rig.wait(0.1)
    assert orders(rig) == 0
    rig.wait(3.0)
    assert orders(rig) == 0


def test_a_vehicle_that_still_drives_itself_is_held_with_its_next_heartbeat(rig: Rig) -> None:
    sleep(rig, 4.0, AUTO)
    rig.wait(1.3)
    assert rig.stage.mode == HOLD


def test_a_hold_outlasts_the_sleep_and_is_ended_by_whom_it_was_ended_by(held: Rig) -> None:
    sleep(held, 4.0, HOLD)
    held.see(2.0, "drum")
    assert held.state == ("CALLING", 1)
    sleep(held, 4.0, HOLD, MANUAL)
    held.see(2.0, "drum")
    assert held.calls.hold is None
    assert held.stage.mode == MANUAL


def test_an_answer_sent_meanwhile_must_be_sent_again(make_rig: MakeRig) -> None:
    rig = make_rig()
    rig.see(3.0, "drum")
    sleep(rig, 4.0, HOLD)
    rig.word(1, "drum", 1.0)
    rig.see(0.5, "drum")
    assert rig.acks == []
    rig.word(1, "drum", 1.0)
    rig.see(0.5, "drum")
    assert len(rig.acks) == 1


def test_after_a_short_stall_all_that_waited_is_heard_before_anything_is_ordered(rig: Rig) -> None:
    rig.wait(0.4)
    sleep(rig, 0.95, AUTO, MANUAL, busy=60)
    rig.wait(3.0)
    assert orders(rig) == 0
    assert rig.stage.mode == MANUAL


def test_an_order_to_drive_on_that_waited_while_the_daemon_hung_is_not_given(
    held: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    save, before = held.persistence.save_calls, orders(held)

    def hang(*what: Any) -> None:
        if held.calls.hold is not None and held.calls.hold.state is HoldState.RESUMING:
            monkeypatch.setattr(held.persistence, "save_calls", save)
            sleep(held, 5.0, HOLD, MANUAL)
        save(*what)

    monkeypatch.setattr(held.persistence, "save_calls", hang)
    held.answer(1, Motion.GO)
    held.see(2.0)
    assert held.persistence.save_calls == save, "it hung"
    assert orders(held) == before
    assert held.stage.mode == MANUAL


def test_a_hold_waits_for_no_picture_and_no_disk(make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = make_rig(pictures=50)
    ordered: list[tuple[str, int, int]] = []

    def noting(part: object, name: str) -> None:
        do = getattr(part, name)

        def note(*what: Any) -> Any:
            if rig.calls.hold is not None:
                rig.stage.collect(rig.stage.now)
                ordered.append((name, orders(rig), rig.frame_id))
            return do(*what)

        monkeypatch.setattr(part, name, note)

    noting(rig.frames, "call_opened")
    noting(rig.persistence, "save_calls")
    rig.disk_hangs = True
    rig.see(1.0, "drum")
    assert [name for name, _, frame in ordered if frame == ordered[0][2]] == ["call_opened", "save_calls"]
    assert {count for _, count, _ in ordered} == {1}


def test_nor_does_one_for_want_of_a_camera(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    save, counts = rig.persistence.save_calls, list[int]()

    def note(*what: Any) -> None:
        if rig.calls.hold is not None:
            rig.stage.collect(rig.stage.now)
            counts.append(orders(rig))
        save(*what)

    monkeypatch.setattr(rig.persistence, "save_calls", note)
    rig.wait(3.0)
    assert set(counts) == {1}


def test_a_hold_in_which_auto_ends_at_once_is_drawn_after_it_has_left(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = make_rig(pictures=50)
    show, counts = rig.frames.hold_shown, list[int]()

    def note(*what: Any) -> None:
        rig.stage.collect(rig.stage.now)
        counts.append(orders(rig))
        show(*what)

    monkeypatch.setattr(rig.frames, "hold_shown", note)
    rig.stage.mode = MANUAL
    rig.see(3.0, "rock")
    rig.stage.mode = AUTO
    rig.see(3.0, "rock")
    assert (rig.state, rig.stage.mode, counts) == (("BLOCKED", 1), HOLD, [1])
    assert rig.records.picture_of(1) == "/calls/1.jpg"


def test_killed_before_a_hold_was_kept_it_stands_until_a_human_drives_on(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rig.journal, "commit", lambda _: None)
    rig.see(1.0, "drum")
    assert rig.stage.mode == HOLD
    rig.restart()
    rig.see(3.0, "drum")
    assert rig.state[0] == "CALLING"
    rig.answer(rig.state[1], Motion.GO)
    rig.see(3.0)
    assert rig.acks[-1].result is Result.APPLIED
    assert orders(rig) == 0
    assert rig.calls.hold is None
