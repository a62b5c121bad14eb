"""Simulates the companion's cable to the autopilot: a UDP proxy that can be cut and reads commands."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
import time
from collections import deque
from itertools import pairwise
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.sim.demo.rehearsal import free_port
from companion.sim.field.router import Parser
from companion.wire.ids import Policy, State, read_heartbeat_mode

_MAY_BE_SAID = {
    "HEARTBEAT",
    "STATUSTEXT",
    "TUNNEL",
    "PARAM_VALUE",
    "NAMED_VALUE_FLOAT",
    "COMMAND_ACK",
}
_MAY_BE_ASKED = {
    int(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL),
    int(mavlink.MAV_CMD_REQUEST_MESSAGE),
}
_PATIENCE = 0.2
_BEATS = 1000
_GREETING = bytes(
    mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_GENERIC, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
    ).pack(mavlink.MAVLink(None, 1, mavlink.MAV_COMP_ID_TELEMETRY_RADIO))
)
"""A radio's heartbeat, by which the autopilot finds this end."""
_UNWELL = (State.STARTING, State.FAULT)


class Wire:
    """Passes datagrams both ways until it is closed.

    cut: nothing passes. deaf: commands to the vehicle are lost. mute: nothing passes from the autopilot to
    the companion. commands: all commands that the companion sent to the vehicle, lost or not. well:
    heartbeats that reached the autopilot and said neither starting nor fault. reported: state and policy of
    every heartbeat of the companion, lost or not. beats: when the newest heartbeats of the companion came,
    monotonic seconds, and their state.
    """

    def __init__(self, autopilot: int, *, calls: bool = False) -> None:
        """autopilot: its UDP port of 127.0.0.1. calls: the companion listens, and the wire sends first."""
        self.cut = self.deaf = self.mute = False
        self.beats: deque[tuple[float, State]] = deque(maxlen=_BEATS)
        self.commands: list[str] = []
        self.well = 0
        self.reported: set[tuple[State, Policy]] = set()
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
        at = [since, *(when for when, _ in list(self.beats) if since <= when <= until), until]
        return max(after - before for before, after in pairwise(at))

    def well_again(self, since: float) -> float | None:
        """Returns s from `since` to the first well heartbeat after a fault's; None: not yet, or no fault."""
        later = [(when, state) for when, state in list(self.beats) if when >= since]
        faulty = [when for when, state in later if state is State.FAULT]
        good = (when for when, state in later if faulty and when > faulty[0] and state not in _UNWELL)
        found = next(good, None)
        return None if found is None else found - since

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
            for readable in select.select([self._near, self._far], [], [], _PATIENCE)[0]:
                with contextlib.suppress(OSError):  # one of the two is not there just now
                    self._from_companion() if readable is self._near else self._from_autopilot()

    def _from_companion(self) -> None:
        datagram, self._companion = self._near.recvfrom(65536)
        frames = Parser().frames(datagram)
        orders = [order for frame in frames if (order := _ordered(frame))]
        self.commands += orders
        beats = [_reported_by(frame) for frame in frames if frame.get_type() == "HEARTBEAT"]
        self.reported |= set(beats)
        self.beats += [(time.monotonic(), state) for state, _ in beats]
        if not self.cut and not (self.deaf and orders):
            self._far.send(datagram)
            self.well += sum(_is_well(frame) for frame in frames)

    def _from_autopilot(self) -> None:
        datagram = self._far.recv(65536)
        if not self.cut and not self.mute and self._companion is not None:
            self._near.sendto(datagram, self._companion)


def _reported_by(frame: Any) -> tuple[State, Policy]:
    state, _, policy = read_heartbeat_mode(frame.custom_mode)
    return state, policy


def _is_well(frame: Any) -> bool:
    if frame.get_type() != "HEARTBEAT":
        return False
    return read_heartbeat_mode(frame.custom_mode)[0] not in _UNWELL


def _ordered(frame: Any) -> str:
    """Returns what a frame commands the vehicle to do; "" for frames that are known to be harmless."""
    kind = str(frame.get_type())
    if kind in _MAY_BE_SAID:
        return ""
    if kind in ("COMMAND_LONG", "COMMAND_INT"):
        harmless = frame.command in _MAY_BE_ASKED
        return "" if harmless else f"{kind} {frame.command} {frame.param1:g} {frame.param2:g}"
    return kind
