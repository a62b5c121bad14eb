"""Whatever is commanded, cancelled, kept back and answered in whatever order."""

from __future__ import annotations

from typing import Any

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule
from pymavlink.dialects.v20 import development as mavlink

from companion.calls.mode_monitor import ModeAnswer
from companion.link.streams import STUCK_AFTER
from companion.sim.loopback_link import LoopbackLink, MemoryTransport
from companion.wire.ids import MODE_REQUEST_COMMAND

AUTO, HOLD = 10, 4
SET_MODE = int(mavlink.MAV_CMD_DO_SET_MODE)
ACCEPTED, CHANGED, DENIED, UNSUPPORTED = 0, 1, 2, 3
_ANSWERED_WITHIN = 4.0
"""s: the autopilot of this test answers no later."""


class Line(MemoryTransport):
    """A line whose kernel keeps what was written while it is `stuck`, and tells that."""

    def __init__(self, replaced: MemoryTransport) -> None:
        super().__init__()
        self._inbox, self._outbox = replaced._inbox, replaced._outbox
        self.stuck = False
        self.kept: list[bytes] = []
        self._kept_since: float | None = None

    def check(self, now: float) -> None:
        if not self.kept or self._kept_since is None:
            self._kept_since = now if self.kept else None
        elif now - self._kept_since >= STUCK_AFTER:
            self.kept.clear()
            raise OSError("stuck")

    def write(self, frame: bytes) -> bool:
        if self.full:
            return False
        self.kept.append(frame)
        self.move()
        return True

    def move(self) -> None:
        """Let go what is kept, unless it is stuck."""
        if not self.stuck:
            self._outbox.extend(self.kept)
            self.kept.clear()

    def idle(self) -> bool:
        return not self.kept

    def settled(self) -> bool:
        return not self.kept

    def has_room(self) -> bool:
        return not self.kept

    def recall(self) -> None:
        self.kept.clear()


class Commands(RuleBasedStateMachine):
    """wanted: mode and hold of the newest command, None once it was cancelled. left: what left, and when."""

    def __init__(self) -> None:
        super().__init__()
        self.stage = LoopbackLink()
        self.line = self.stage.near = Line(self.stage.near)
        self.wanted: tuple[int, int] | None = None
        self.hold = 0
        self.seen = 0
        self.left: list[tuple[float, Any]] = []
        self.pass_time(0.2)

    @rule(seconds=st.sampled_from([0.01, 0.05, 0.4, 1.1, 4.0]))
    def pass_time(self, seconds: float) -> None:
        self.stage.run(seconds)
        new, self.seen = self.stage.frames[self.seen :], len(self.stage.frames)
        for frame in new:
            if frame.message.get_type() == "COMMAND_LONG" and _mode(frame.message) is not None:
                resumes = _mode(frame.message) == AUTO
                assert not resumes or (AUTO, _hold(frame.message)) == self.wanted
                self.left.append((frame.at, frame.message))

    @rule(there=st.booleans())
    def the_script_is_heard_or_absent(self, there: bool) -> None:
        questions = [one for one in self.stage.sent("COMMAND_LONG") if _is_question(one)]
        if questions:
            result = ACCEPTED if there else UNSUPPORTED
            self._answer(MODE_REQUEST_COMMAND, result, int(questions[-1].param4) if there else 0)

    @rule(hold=st.integers(1, 3), again=st.booleans())
    def command_hold(self, hold: int, again: bool) -> None:
        self.hold = self.hold or hold if again else hold
        self.wanted = HOLD, self.hold
        self.stage.link.modes.command(HOLD, self.stage.now, expected=AUTO, hold=self.hold)

    @rule()
    def send_it_now(self) -> None:
        self.stage.link.modes.send_hold_now(self.stage.now)
        self.pass_time(0.01)

    @rule()
    def command_resume(self) -> None:
        self.wanted = AUTO, self.hold
        takes = self.stage.link.modes.takes_resume
        self.stage.link.modes.command(AUTO, self.stage.now, expected=HOLD, hold=self.hold)
        assert self.stage.link.modes.resume_waits is takes

    @rule()
    def cancel(self) -> None:
        self.wanted = None
        self.stage.link.modes.cancel()
        assert not self.stage.link.modes.resume_waits

    @rule(full=st.booleans(), stuck=st.booleans())
    def the_device_takes_or_keeps_what_is_written(self, full: bool, stuck: bool) -> None:
        self.line.full, self.line.stuck = full, stuck
        self.line.move()

    @rule()
    def another_component_uses_our_ids(self) -> None:
        self.stage.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 77, 4, 3), (1, 191))
        self.pass_time(0.01)

    @rule(lost=st.integers(0, 2), result=st.sampled_from([ACCEPTED, CHANGED, DENIED]))
    def answer(self, lost: int, result: int) -> None:
        """Answers come in the order of the commands; those to the first ones are lost."""
        self.left = [one for one in self.left[-3:] if self.stage.now - one[0] <= _ANSWERED_WITHIN][lost:]
        if not self.left:
            return
        _, command = self.left.pop(0)
        by_script = command.command == MODE_REQUEST_COMMAND
        for told in self._answer(command.command, result, int(command.param4) if by_script else 0):
            assert (told.mode, told.accepted) == (_mode(command), result == ACCEPTED)
            assert _hold(command) == self.hold
            assert not told.by_hand or by_script

    @invariant()
    def at_most_one_command_waits(self) -> None:
        outbox = self.stage.link._outbox
        assert outbox.waiting("hold") + outbox.waiting("resume") <= 1

    def _answer(self, command: int, result: int, serial: int) -> list[ModeAnswer]:
        before = len(self.stage.reported(ModeAnswer))
        self.stage.send(mavlink.MAVLink_command_ack_message(command, result, 0, serial, 1, 191), (1, 1))
        self.pass_time(0.01)
        told: list[ModeAnswer] = self.stage.reported(ModeAnswer)[before:]
        return told


def _is_question(message: Any) -> bool:
    return bool(message.command == MODE_REQUEST_COMMAND and not message.param1)


def _mode(message: Any) -> int | None:
    """The mode that is commanded, None where none is."""
    if message.command == SET_MODE:
        return int(message.param2)
    return int(message.param3) if message.command == MODE_REQUEST_COMMAND and message.param1 else None


def _hold(message: Any) -> int:
    return int(message.param7 if message.command == SET_MODE else message.param1)


TestAnySequence = Commands.TestCase
TestAnySequence.settings = settings(max_examples=60, stateful_step_count=25, deadline=None)
