"""A board whose script guides, and the companion that asks it to and sends the targets."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.wire.ids import MODE_REQUEST_COMMAND, State, heartbeat_mode
from tests.companion.sim.field.stubs import AUTO, BY_GCS, CYCLE, GUIDED, HOLD, SCRIPTING, Board

GUIDE = 65536
ACCEPTED, CHANGED, DENIED, FAILED, IN_PROGRESS = 0, 1, 2, 4, 5
LOST = 0.7
LONGEST = 4.0
STATION: Any = mavlink.MAVLink(None, 255, 190)
STOPPED = "HOLD: guiding stopped. AUTO drives on"


def own_target(system: int = 1, vx: float = 1.0, rate: float = 0.1) -> Any:
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, system, 1, 8, 1479, 0, 0, 0, vx, 0, 0, 0, 0, 0, 0, rate
    )


class Raced(Board):
    """A board on which somebody may act just before or after a mode is set: `between` is called then.

    As on ArduPilot, a mode that stands is not entered again, and keeps its reason.
    """

    between: Callable[[], None] | None = None
    between_which = 0

    def set_mode(self, number: int) -> bool:
        self._meet()
        obeyed = number == self.mode_now or super().set_mode(number)
        self._meet()
        return obeyed

    def human_sets(self, mode: int, reason: int = BY_GCS) -> None:
        if mode != self.mode_now:
            super().human_sets(mode, reason)

    def meet(self, do: Callable[[], None], which: int) -> None:
        """Has `do` happen once, at the `which`-th place from now, counted from 0."""
        self.between, self.between_which = do, which

    def _meet(self) -> None:
        if self.between is not None and self.between_which == 0:
            self.between()
            self.between = None
        self.between_which -= 1


class Guiding:
    """A board in AUTO with a companion that may guide. seconds: the time to brake that it tells.

    guides: whether its heartbeats say that it guides. streams: whether its targets come, each cycle.
    """

    def __init__(self, seconds: float = LONGEST, **parameters: Any) -> None:
        self.board = Raced(**parameters)
        self.seconds, self.serial = seconds, 100
        self.guides, self.streams, self.beats = True, False, True
        self.live(6.0)
        self.ask(0, 0, hold=0)

    def beat(self, state: State = State.OK) -> None:
        mode = heartbeat_mode(state, 7, self.board.policy, guiding=self.guides) | 1 << 29
        self.hears(mavlink.MAVLink_heartbeat_message(18, 8, 0, mode, 4, 3))

    def hears(self, message: Any, mav: Any = None) -> None:
        self.board.hear(message.pack(mav or self.board.companion))

    def send(self, mode: float, expected: float, *, hold: float = 7, serial: float | None = None) -> None:
        """A request arrives."""
        self.serial += 1
        number = self.serial if serial is None else serial
        parameters = (hold, expected, mode, number, self.seconds, 0, 0)
        self.hears(mavlink.MAVLink_command_long_message(1, 1, MODE_REQUEST_COMMAND, 0, *parameters))

    def ask(self, mode: float, expected: float, **how: Any) -> list[int]:
        """A request arrives, and a cycle goes by. Returns the results that were answered."""
        return [result for _, result in self.answers(lambda: self.send(mode, expected, **how))]

    def answers(self, do: Callable[[], None] = lambda: None, seconds: float = CYCLE) -> list[tuple[int, int]]:
        """Returns serial number and result of each answer while something happens, and time goes by."""
        before = len(self.board.sent)
        do()
        self.live(seconds)
        told = [struct.unpack("<HBBiBB", payload) for _, _, payload in self.board.sent[before:]]
        return [(row[3], row[1]) for row in told]

    def live(self, seconds: float, state: State = State.OK) -> None:
        """Time goes by, with what the companion sends each cycle."""
        for _ in range(round(seconds / CYCLE)):
            if self.beats:
                self.beat(state)
            if self.streams:
                self.hears(own_target())
            self.board.pass_time(CYCLE)

    @property
    def shows(self) -> tuple[int, int]:
        """The mode and its reason."""
        return self.board.mode_now, self.board.reason

    @property
    def set_modes(self) -> list[int]:
        return [mode for _, mode, _, _ in self.board.set_modes]

    def guided(self) -> Guiding:
        """The script guides, and targets come."""
        self.streams = True
        assert self.ask(GUIDED, AUTO, hold=GUIDE) == [IN_PROGRESS]
        self.live(1.0)
        assert self.shows == (GUIDED, SCRIPTING)
        self.board.set_modes.clear()
        return self

    def until_held(self, limit: float = 20.0) -> float:
        """Seconds until HOLD."""
        begun = self.board.t
        while self.board.mode_now != HOLD and self.board.t - begun < limit:
            self.live(CYCLE)
        return self.board.t - begun
