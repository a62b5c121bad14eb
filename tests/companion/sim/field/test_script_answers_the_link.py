"""The link and the shipped script: whose HOLD stands after both a human and the companion have set one."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.calls.mode_monitor import ModeAnswer
from companion.sim.loopback_link import LoopbackLink
from companion.wire.ids import State
from tests.companion.sim.field.stubs import AUTO, BY_RC, CYCLE, HOLD, MANUAL, Board, driving

pytest.importorskip("lupa.lua53", reason="the script runs in Lua 5.3")


class Wire:
    """The link on the script's board, which the link finds in AUTO."""

    def __init__(self) -> None:
        self.board: Board = driving()
        self.stage = LoopbackLink()
        self.frames = self.answers = 0
        self.pass_time(0.5)
        assert self.stage.link.modes.compares

    def pass_time(self, seconds: float) -> None:
        """Let time pass for both; a companion that is well is heard."""
        for _ in range(round(seconds / CYCLE)):
            self.stage.mode = self.board.mode_now
            self.stage.run(CYCLE)
            new, self.frames = self.stage.frames[self.frames :], len(self.stage.frames)
            for frame in new:
                if frame.message.get_type() == "COMMAND_LONG":
                    self.board.hear(frame.message.get_msgbuf())
            self.board.beat(State.OK)
            self.board.pass_time(CYCLE)
            answers, self.answers = self.board.sent[self.answers :], len(self.board.sent)
            for _, _, payload in answers:
                self.stage.send(_ack(payload), (1, 1))
        self.stage.run(0.02)

    def commanded(self, mode: int, expected: int) -> list[ModeAnswer]:
        """What is reported of a command for hold 7."""
        before = len(self.stage.reported(ModeAnswer))
        self.stage.link.modes.command(mode, self.stage.now, expected=expected, hold=7)
        self.pass_time(0.2)
        answers: list[ModeAnswer] = self.stage.reported(ModeAnswer)[before:]
        return answers


def _ack(payload: bytes) -> Any:
    return mavlink.MAVLink_command_ack_message(*struct.unpack("<HBBiBB", payload))


def test_a_hold_that_a_human_s_switch_has_set_first_is_the_human_s() -> None:
    wire = Wire()
    wire.board.human_sets(HOLD, BY_RC)
    assert wire.commanded(HOLD, AUTO) == [ModeAnswer(HOLD, accepted=False, by_hand=True)]


def test_so_is_a_mode_that_replaced_the_one_that_the_hold_was_decided_on() -> None:
    wire = Wire()
    wire.board.human_sets(MANUAL, BY_RC)
    assert wire.commanded(HOLD, AUTO) == [ModeAnswer(HOLD, accepted=False, by_hand=True)]
    assert wire.board.mode_now == MANUAL


def test_and_a_hold_that_a_switch_has_set_within_ours_before_the_resume() -> None:
    wire = Wire()
    assert wire.commanded(HOLD, AUTO) == [ModeAnswer(HOLD, accepted=True)]
    wire.board.human_sets(HOLD, BY_RC)
    assert wire.commanded(AUTO, HOLD) == [ModeAnswer(AUTO, accepted=False, by_hand=True)]


def test_a_resume_after_another_mode_stood_is_refused_and_the_report_says_whose_mode_that_is() -> None:
    wire = Wire()
    wire.commanded(HOLD, AUTO)
    wire.board.human_sets(MANUAL, BY_RC)
    wire.pass_time(0.3)
    wire.board.human_sets(HOLD, BY_RC)
    wire.pass_time(0.3)
    assert wire.commanded(AUTO, HOLD) == [ModeAnswer(AUTO, accepted=False, by_hand=False)]
    assert wire.board.mode_now == HOLD


def test_a_hold_that_is_repeated_is_ours() -> None:
    wire = Wire()
    assert wire.commanded(HOLD, AUTO) == [ModeAnswer(HOLD, accepted=True)]
    assert wire.commanded(HOLD, AUTO) == [ModeAnswer(HOLD, accepted=True)]
    assert wire.commanded(AUTO, HOLD) == [ModeAnswer(AUTO, accepted=True)]
