"""While the script on the autopilot holds, the companion, well again, says who holds, why and what to set."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.vehicle.ardupilot import ScriptHold, script_hold
from companion.wire import notices
from companion.wire.ids import Policy, State
from tests.companion.daemon.rig import AUTO, HOLD, MANUAL, MakeRig, Rig

TEXT = "Script holds (companion silent): set AUTO by hand"


def says(rig: Rig, text: str, sender: tuple[int, int] = (1, 1)) -> None:
    """A STATUSTEXT arrives from the autopilot."""
    rig.stage.send(mavlink.MAVLink_statustext_message(2, text.encode()), sender)


def held_by_script(rig: Rig) -> Rig:
    """The script has set HOLD."""
    rig.stage.mode = HOLD
    rig.stage.heartbeat(1)
    says(rig, "HOLD: companion silent. AUTO again = go blind")
    rig.see(0.5)
    return rig


@pytest.mark.slow
def test_it_does_not_say_ok_and_tells_who_holds_and_what_to_set(rig: Rig) -> None:
    held_by_script(rig)
    assert rig.state == ("HOLDING", 0)
    assert rig.texts == [TEXT]
    assert rig.daemon.status.figures()["held_by"] == "script: companion silent"
    rig.see(60.0)
    assert rig.texts.count(TEXT) == 4
    assert rig.stage.sent("STATUSTEXT")[-1].severity == mavlink.MAV_SEVERITY_ALERT
    assert [one for one in rig.stage.sent("COMMAND_LONG") if one.command == 176] == []


@pytest.mark.slow
@pytest.mark.parametrize(("mode", "armed"), [(AUTO, True), (MANUAL, True), (HOLD, False)])
def test_a_mode_that_a_human_sets_ends_it(rig: Rig, mode: int, armed: bool) -> None:
    held_by_script(rig)
    rig.stage.mode, rig.stage.armed = mode, armed
    rig.see(1.5)
    assert rig.state == ("OK", 0)
    rig.stage.mode, rig.stage.armed = HOLD, True
    rig.see(5.0)
    assert rig.state == ("OK", 0), "this HOLD is a human's"
    assert rig.daemon.status.figures()["held_by"] is None


def test_a_text_that_comes_late_says_nothing_of_a_rover_that_drives(rig: Rig) -> None:
    says(rig, "HOLD: companion silent. AUTO again = go blind")
    rig.see(2.0)
    assert rig.state == ("OK", 0)
    rig.stage.mode = HOLD
    rig.see(5.0)
    assert rig.state == ("OK", 0)


def test_a_hold_of_our_own_is_told_as_ours(held: Rig) -> None:
    says(held, "HOLD: companion fault. AUTO again = go blind")
    held.see(1.0, "drum")
    assert held.state == ("CALLING", 1)
    assert held.daemon.status.figures()["held_by"] == "companion"
    assert not [text for text in held.texts if text.startswith("Script")]


def test_another_vehicles_script_is_none_of_ours(rig: Rig) -> None:
    rig.stage.mode = HOLD
    says(rig, "HOLD: companion silent. AUTO again = go blind", (2, 1))
    says(rig, "HOLD: companion silent. AUTO again = go blind", (1, 42))
    rig.see(2.0)
    assert rig.state == ("OK", 0)


def test_where_it_reports_it_says_so_too(make_rig: MakeRig) -> None:
    assert held_by_script(make_rig(Policy.REPORT)).state == ("HOLDING", 0)


def test_a_companion_that_was_killed_says_so_once_it_is_back_and_sees(rig: Rig) -> None:
    """With the shipped script: what each says reaches the other."""
    pytest.importorskip("lupa.lua53", reason="the script runs in Lua 5.3")
    from tests.companion.sim.field.stubs import Board

    board = Board()
    heard = told = 0

    def drive(seconds: float, *, alive: bool = True) -> None:
        nonlocal heard, told
        for _ in range(round(10 * seconds)):
            if alive:
                rig.stage.mode = board.mode_now
                for said in board.said[told:]:
                    says(rig, said.text)
                rig.see(0.1)
                for frame in rig.stage.frames[heard:]:
                    if frame.message.get_type() == "HEARTBEAT":
                        board.hear(frame.message.get_msgbuf())
                heard = len(rig.stage.frames)
            told = len(board.said)
            board.pass_time(0.1)

    drive(3.0)
    drive(5.0, alive=False)
    assert board.mode_now == HOLD
    rig.restart()
    heard = 0
    drive(4.0)
    assert rig.state == ("HOLDING", 0)
    assert TEXT in rig.texts
    assert "HOLD since companion silent: set AUTO by hand" in board.texts(4)
    board.human_sets(AUTO)
    drive(3.0)
    assert (rig.state, board.mode_now) == (("OK", 0), AUTO)


@pytest.mark.parametrize(
    "why", ["companion silent", "companion fault", "companion is off", "obstacle feed dead"]
)
@pytest.mark.parametrize("mode", ["AUTO", "GUIDED", "CIRCLE"])
def test_every_text_of_the_scripts_holds_is_understood(why: str, mode: str) -> None:
    for text in (f"HOLD: {why}. {mode} again = go blind", f"HOLD since {why}: set {mode} by hand"):
        assert script_hold(text[:50]) == ScriptHold(why, mode)
    told = notices.script_holds(why, mode)
    assert why in told
    assert f"set {mode}" in told
    assert script_hold(told) is None, "the script says our texts again"


@given(st.text(max_size=60) | st.from_regex(r"HOLD(: | since )[a-zA-Z .:]{0,40}", fullmatch=True))
def test_whatever_an_autopilot_says_is_read_or_passed_over(text: str) -> None:
    found = script_hold(text)
    assert found is None or ((found.why.islower() or not found.why.strip()) and found.mode.isupper())


def test_the_state_of_the_heartbeat_is_an_old_one_that_scripts_know() -> None:
    assert max(State) == State.OFF
