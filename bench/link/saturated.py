"""Measures how soon a hold leaves a serial line that is full of our own frames.

The line is a pseudo-terminal that is drained at 57600 baud. Its kernel does not tell what waits in it.
"""

from __future__ import annotations

import contextlib
import os
import pty
import threading
import time
import tty
from random import Random
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import MAIN, LinkSettings
from companion.link.link import Link
from companion.link.parser import Parser
from companion.link.transport import opener
from companion.wire.parameters import build

BAUD = 57600
MOST = 0.3
"""s that a hold may take."""
_TICK = 0.005
_HOLD = 4
_HEARTBEAT = mavlink.MAVLink_heartbeat_message(10, 3, 129, 10, 4, 3)
_FULL_AFTER = 3.0
"""s that do not count: the line becomes full."""
_EVERY = 0.6
_PATIENCE = 10.0
_TEXTS = 8
"""Texts of each turn, more than the line carries."""


class Drained:
    """The other end of a serial line, which takes what the line carries and no more."""

    def __init__(self) -> None:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.url = f"serial:{os.ttyname(self._slave)}:{BAUD}"
        self.bytes = 0
        self.held_at: list[float] = []
        """When each hold was there as a whole, monotonic s."""
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._drain, name="line", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        os.close(self._slave)
        os.close(self._master)

    def _drain(self) -> None:
        parser, encoder = Parser(), mavlink.MAVLink(None, 1, 1)
        at, room, beat_at = time.monotonic(), 0.0, 0.0
        while not self._over.wait(_TICK):
            now = time.monotonic()
            room = min(room + (now - at) * BAUD / 10, BAUD / 10 * 0.05)
            at = now
            if now >= beat_at:
                beat_at = now + 1.0
                os.write(self._master, _HEARTBEAT.pack(encoder))
            data = b""
            with contextlib.suppress(BlockingIOError):
                data = os.read(self._master, int(room)) if room >= 1 else b""
            room -= len(data)
            self.bytes += len(data)
            for message in parser.feed(data, now, whole=False):
                if message.get_type() == "COMMAND_LONG" and message.command == mavlink.MAV_CMD_DO_SET_MODE:
                    self.held_at.append(now)


def run(seconds: float, seed: int) -> dict[str, Any]:
    """Commands holds at random moments for so many seconds while more is to be sent than the line carries."""
    line, random = Drained(), Random(seed)
    # A serial line's own budgets would not fill it; the device is opened beside them.
    free = LinkSettings("udpout:127.0.0.1:1", budget=0.0, asked_budget=0.0, pace=0.0)
    openers = {MAIN: opener(LinkSettings(line.url).address())}
    link = Link(free, build(["grass"], {}, {}), time.monotonic(), openers=openers)
    began = time.monotonic()
    hold_at, late, number, first = began + _FULL_AFTER, list[float](), 0, 0
    commanded: float | None = None
    try:
        while (now := time.monotonic()) < began + _FULL_AFTER + seconds or commanded is not None:
            for _ in range(_TEXTS):
                number += 1
                link.texts.send(f"text {number} of a rover that has much to say".ljust(50, "."), 6, now)
            link.poll(now)
            if commanded is not None and (line.held_at or now > commanded + _PATIENCE):
                late.append((line.held_at[0] if line.held_at else now) - commanded)
                commanded, hold_at = None, now + random.uniform(0.5, 1.5) * _EVERY
            if commanded is None and now >= hold_at and link.vehicle is not None:
                first = first or line.bytes
                line.held_at.clear()
                commanded = now
                link.modes.command(_HOLD, now)
                link.modes.send_hold_now(now)
            link.tick(now)
            time.sleep(_TICK)
    finally:
        link.close()
        line.close()
    full = (line.bytes - first) / (time.monotonic() - began - _FULL_AFTER) / (BAUD / 10)
    ordered = sorted(late)
    return {
        "holds": len(late),
        "hold_s": {"p50": round(ordered[len(ordered) // 2], 3), "max": round(ordered[-1], 3)},
        "line_used": round(full, 2),
    }
