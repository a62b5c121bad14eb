"""The autopilot is heard no more while it still hears us: a fault that is told, and the script acts on it."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.wire.ids import Motion, Policy
from tests.companion.daemon.rig import AUTO, HOLD, MANUAL, MakeRig, Rig

TEXT = "Companion FAULT: autopilot silent, STOP BY HAND"


def commanded(rig: Rig) -> list[int]:
    """Modes asked for."""
    return [int(one.param2) for one in rig.stage.sent("COMMAND_LONG") if one.command == 176]


def broken(rig: Rig) -> None:
    """The wire from the autopilot breaks, behind a heartbeat."""
    rig.stage.heartbeat(1)
    rig.stage.vehicle = None


@pytest.mark.slow
def test_it_is_told_in_heartbeat_status_and_a_text_that_repeats_and_becomes_an_alert(rig: Rig) -> None:
    broken(rig)
    rig.see(2.8)
    assert rig.state == ("OK", 0)
    rig.see(0.5)
    assert rig.state == ("FAULT", 0)
    status = rig.daemon.status.figures()
    assert (status["state"], status["reasons"]) == ("fault", ["fault"])
    assert rig.texts[-1] == TEXT
    rig.see(60.0)
    told = [message.severity for message in rig.stage.sent("STATUSTEXT") if message.text == TEXT]
    assert told[0] == mavlink.MAV_SEVERITY_ERROR
    assert told[-1] == mavlink.MAV_SEVERITY_ALERT
    assert (commanded(rig), rig.calls.hold) == ([], None)


@pytest.mark.slow
def test_it_ends_with_a_text_once_the_heartbeat_is_back(rig: Rig) -> None:
    broken(rig)
    rig.see(6.0)
    rig.stage.vehicle = 1
    rig.see(1.5)
    assert rig.state == ("FAULT", 0)
    rig.see(2.0)
    assert rig.state == ("OK", 0)
    assert rig.texts[-1] == "Autopilot is heard again"
    rig.see(30.0)
    assert rig.texts.count(TEXT) == 1


@pytest.mark.slow
def test_an_open_call_says_it_itself(held: Rig) -> None:
    broken(held)
    held.see(5.0, "drum")
    assert held.state == ("FAULT", 1)
    assert "C1 FAULT autopilot silent, STOP BY HAND" in held.texts
    assert TEXT not in held.texts
    held.stage.vehicle = 1
    held.see(5.0, "drum")
    assert held.state == ("CALLING", 1)


@pytest.mark.slow
@pytest.mark.parametrize("policy", [Policy.REPORT, Policy.SHADOW])
def test_who_only_reports_says_nothing_of_it(make_rig: MakeRig, policy: Policy) -> None:
    rig = make_rig(policy)
    broken(rig)
    rig.see(20.0)
    assert rig.state == ("OK", 0)
    assert rig.texts == []


def test_another_policy_ends_the_fault_without_a_word_of_an_autopilot_that_is_heard(rig: Rig) -> None:
    broken(rig)
    rig.see(5.0)
    rig.set("AT_POLICY", float(Policy.REPORT))
    rig.see(3.0)
    assert rig.state == ("OK", 0)
    assert "Autopilot is heard again" not in rig.texts


@pytest.mark.slow
def test_an_autopilot_that_reboots_with_a_call_open_keeps_it_and_that_is_said(held: Rig) -> None:
    broken(held)
    held.see(4.0, "drum")
    held.stage.vehicle, held.stage.armed = 1, False
    for mode in (16, MANUAL):
        held.stage.mode = mode
        held.see(3.0, "drum")
    assert held.state == ("CALLING", 1)
    assert "C1 stays open: the autopilot rebooted" in held.texts
    assert not [text for text in held.texts if "taken over" in text]
    assert held.daemon.status.figures()["held_by"] is None


@pytest.mark.slow
def test_an_autopilot_that_reboots_armed_in_auto_is_held_until_a_go_and_that_is_said(rig: Rig) -> None:
    rig.stage.send(mavlink.MAVLink_system_time_message(0, 90_000), (1, 1))
    rig.see(1.0)
    broken(rig)
    rig.see(2.0)
    rig.stage.vehicle = 1
    rig.see(1.0)
    assert commanded(rig) == [], "it was not silent for long enough to count"
    rig.stage.send(mavlink.MAVLink_system_time_message(0, 6_000), (1, 1))
    rig.see(2.0)
    assert (rig.stage.mode, rig.state) == (HOLD, ("HOLDING", 1))
    assert "H1 autopilot rebooted into AUTO: needs a go" in rig.texts
    rig.see(20.0)
    assert "H1 clear now, go?" in rig.texts
    rig.answer(1, Motion.GO)
    rig.see(2.0)
    assert rig.stage.mode == AUTO
    rig.see(10.0)
    assert commanded(rig) == [HOLD, AUTO]


def test_the_script_on_the_autopilot_stops_the_rover_and_the_companion_commands_nothing(rig: Rig) -> None:
    """What the companion says reaches the script; nothing that the autopilot says reaches the companion."""
    pytest.importorskip("lupa.lua53", reason="the script runs in Lua 5.3")
    from tests.companion.sim.field.stubs import Board

    board = Board()
    board.mode_now = AUTO
    said = 0

    def drive(seconds: float) -> None:
        nonlocal said
        for _ in range(round(10 * seconds)):
            rig.see(0.1)
            for frame in rig.stage.frames[said:]:
                if frame.message.get_type() in ("HEARTBEAT", "STATUSTEXT"):
                    board.hear(frame.message.get_msgbuf())
            said = len(rig.stage.frames)
            board.pass_time(0.1)

    drive(5.0)
    assert board.mode_now == AUTO
    broken(rig)
    drive(2.8)
    assert board.mode_now == AUTO
    drive(0.7)
    assert board.mode_now == HOLD
    assert board.texts(2)[0] == "HOLD: companion fault. AUTO again = go blind"
    assert commanded(rig) == []
