"""Simulates the companion's cable to the autopilot: a UDP proxy that can be cut and reads commands."""

from __future__ import annotations

import contextlib
import math
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

from companion.sim.demo.rehearsal import free_port
from companion.sim.field.router import DatagramParser
from companion.wire.ids import MODE_REQUEST_COMMAND, Policy, State, read_heartbeat_mode

_MAY_BE_SAID = {
    "HEARTBEAT",
    "STATUSTEXT",
    "TUNNEL",
    "PARAM_VALUE",
    "NAMED_VALUE_FLOAT",
    "ONBOARD_COMPUTER_STATUS",
    "COMMAND_ACK",
}
_MAY_BE_ASKED = {
    int(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL),
    int(mavlink.MAV_CMD_REQUEST_MESSAGE),
}
_PATIENCE = 0.2
TARGET = "SET_POSITION_TARGET_LOCAL_NED"
_BEATS = 1000
_Way = deque[tuple[float, bytes]]
"""Datagrams under way, and when each is due, in monotonic seconds."""
_GREETING = bytes(
    mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_GENERIC, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
    ).pack(mavlink.MAVLink(None, 1, mavlink.MAV_COMP_ID_TELEMETRY_RADIO))
)
"""A radio's heartbeat, by which the autopilot finds this end."""
_UNWELL = (State.STARTING, State.FAULT)
_SILENCE = 1.5
"""Seconds without a heartbeat at the autopilot after which the next one is a return."""


class Beat(NamedTuple):
    """A heartbeat of the companion. at: monotonic seconds. passed: whether it reached the autopilot."""

    at: float
    state: State
    passed: bool

    @property
    def believed(self) -> bool:
        """Whether it told the autopilot that the companion sees."""
        return self.passed and self.state not in _UNWELL


class Wire:
    """Passes datagrams both ways until it is closed.

    mute: nothing passes from the autopilot to the companion. unheard: nothing passes from the companion to
    the autopilot. deaf: its commands to the vehicle are lost. commands: all commands that the companion sent
    to the vehicle, lost or not, and commanded_at: when, in monotonic seconds. reported: state and policy of
    every heartbeat of the companion, lost or not. beats: its newest heartbeats. ordered_now: called with each
    command to the vehicle and its monotonic seconds, before it is passed on; it returns the s by which that
    command, and what comes after it, is passed on later. delay: s that a datagram takes, each way.
    """

    def __init__(self, autopilot: int, *, calls: bool = False, delay: float = 0.0) -> None:
        """autopilot: its UDP port of 127.0.0.1. calls: the companion listens, and the wire sends first."""
        self.mute = self.unheard = self.deaf = False
        self.beats: deque[Beat] = deque(maxlen=_BEATS)
        self.commands: list[str] = []
        self.commanded_at: list[float] = []
        self.reported: set[tuple[State, Policy]] = set()
        self.ordered_now: Callable[[str, float], float] | None = None
        self.delay = delay
        self._up: _Way = deque()
        self._down: _Way = deque()
        self._near = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._near.bind(("127.0.0.1", 0))
        self._far = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._far.connect(("127.0.0.1", autopilot))
        self._calls = calls
        self._companion = ("127.0.0.1", free_port()) if calls else None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="wire", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """The `url` for the companion's [link]."""
        if self._calls and self._companion is not None:
            return f"udpin:127.0.0.1:{self._companion[1]}"
        return f"udpout:127.0.0.1:{self._near.getsockname()[1]}"

    @property
    def companion(self) -> tuple[str, int] | None:
        """The address of the companion."""
        return self._companion

    def to_companion(self, datagram: bytes) -> None:
        """Sends a datagram to the companion, as if it came from the ground through the autopilot."""
        if self._companion is not None:
            with contextlib.suppress(OSError):
                self._near.sendto(datagram, self._companion)

    def longest_gap(self, since: float, until: float) -> float:
        """Returns the longest gap (s) between heartbeats of the companion within these monotonic seconds."""
        at = [since, *(beat.at for beat in list(self.beats) if since <= beat.at <= until), until]
        return max(after - before for before, after in pairwise(at))

    def ordered(self, since: float) -> float | None:
        """Returns the monotonic s of the first command to the vehicle after `since`; None: none.

        A target by which it is guided does not count.
        """
        orders = zip(list(self.commands), list(self.commanded_at), strict=False)
        return next((at for order, at in orders if at >= since and order != TARGET), None)

    def believed(self, until: float = math.inf) -> float | None:
        """Returns the monotonic seconds of the last heartbeat until then that the autopilot believed."""
        return next(
            (beat.at for beat in reversed(list(self.beats)) if beat.believed and beat.at <= until), None
        )

    def well_again(self, since: float) -> float | None:
        """Returns s from `since` to the first believed heartbeat after one that was not, or after silence.

        None: not yet, or nothing was wrong.
        """
        last, wrong = -math.inf, False
        for beat in list(self.beats):
            if not beat.passed:
                continue
            if not beat.believed:
                wrong = True
            elif beat.at < since:
                wrong = False
            elif wrong or beat.at - last > _SILENCE:
                return beat.at - since
            last = beat.at
        return None

    def close(self) -> None:
        self._closing.set()
        self._thread.join(2.0)
        self._near.close()
        self._far.close()

    def _run(self) -> None:
        if self._calls:  # else neither end speaks first
            with contextlib.suppress(OSError):
                self._far.send(_GREETING)
        while not self._closing.is_set():
            for readable in select.select([self._near, self._far], [], [], self._pause())[0]:
                with contextlib.suppress(OSError):  # one of the two is not there just now
                    self._from_companion() if readable is self._near else self._from_autopilot()
            self._deliver()

    def _pause(self) -> float:
        """Returns the s until the next datagram is due, at most `_PATIENCE`."""
        due = min((way[0][0] for way in (self._up, self._down) if way), default=math.inf)
        return min(max(due - time.monotonic(), 0.0), _PATIENCE)

    def _deliver(self) -> None:
        """Passes on what is due, in the order in which it came."""
        now = time.monotonic()
        for way, send in ((self._up, self._far.send), (self._down, self._to_companion)):
            while way and way[0][0] <= now:
                with contextlib.suppress(OSError):
                    send(way.popleft()[1])

    def _to_companion(self, datagram: bytes) -> None:
        if self._companion is not None:
            self._near.sendto(datagram, self._companion)

    def _from_companion(self) -> None:
        datagram, self._companion = self._near.recvfrom(65536)
        frames = DatagramParser().frames(datagram)
        orders = [order for frame in frames if (order := _ordered(frame))]
        now = time.monotonic()
        self.commands += orders
        self.commanded_at += [now] * len(orders)
        passes = not self.unheard and not (self.deaf and orders)
        later = sum(self.ordered_now(order, now) for order in orders) if self.ordered_now else 0.0
        if passes:
            behind = self._up[-1][0] if self._up else now
            self._up.append((max(now + self.delay + later, behind), datagram))
        told = [_reported_by(frame) for frame in frames if frame.get_type() == "HEARTBEAT"]
        self.reported |= set(told)
        self.beats += [Beat(now, state, passes) for state, _ in told]

    def _from_autopilot(self) -> None:
        datagram = self._far.recv(65536)
        if not self.mute:
            self._down.append((time.monotonic() + self.delay, datagram))


def _reported_by(frame: Any) -> tuple[State, Policy]:
    told = read_heartbeat_mode(frame.custom_mode)
    return told.state, told.policy


def _ordered(frame: Any) -> str:
    """Returns what a frame commands the vehicle to do; "" for frames that are known to be harmless."""
    kind = str(frame.get_type())
    if kind in _MAY_BE_SAID:
        return ""
    if kind in ("COMMAND_LONG", "COMMAND_INT"):
        if frame.command == MODE_REQUEST_COMMAND:  # written as the command that it stands for
            return f"{kind} 176 1 {frame.param3:g}" if frame.param1 else ""
        harmless = frame.command in _MAY_BE_ASKED
        return "" if harmless else f"{kind} {frame.command} {frame.param1:g} {frame.param2:g}"
    return kind
