"""Floods a whole companion on its link, while a call is open and an operator wants to answer."""

from __future__ import annotations

import multiprocessing
import socket
import time
from collections.abc import Sequence
from itertools import cycle, product
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import SetWord
from bench.attack.outcome import AttackOutcome, watched
from bench.faults.standing import Standing
from bench.link.frame import framed
from companion.wire.answers import Answer
from companion.wire.delivery import Pending
from companion.wire.ids import TUNNEL_ANSWER, Motion

SECONDS, QUICK = 40.0, 12.0
PORTS = 8
_SENDERS = tuple(product(range(245, 256), range(256)))
"""All ids that may answer."""
_FRAMES = 4000
RATES = {"answers": 2000.0, "torrent": 6000.0, "heartbeats": 2000.0, "noise": 50.0}
"""Datagrams a second of each flood."""


def flood(name: str, folder: Path, *, quick: bool) -> AttackOutcome:
    """Run one flood of `RATES`. Its answers set words, which makes vision judge its frames again."""
    outcome = AttackOutcome()
    seconds = QUICK if quick else SECONDS
    with Standing(folder, listens=True, perceiver="builtin") as rover:
        rover.start()
        rover.open_call(20.0)
        attacker = multiprocessing.get_context("spawn").Process(
            target=_pour, args=(name, rover.wire.companion, seconds), daemon=True
        )
        attacker.start()
        operator = _Operator(rover)
        watched(rover, outcome, lambda: operator.step() and attacker.is_alive(), seconds + 30.0)
        attacker.kill()
        outcome.figures = operator.figures()
    return outcome


class _Operator:
    """Sets a word, again and again, and waits for each acknowledgement."""

    def __init__(self, rover: Standing) -> None:
        self._rover = rover
        self._sent: Pending | None = None
        self._at = 0.0
        self._waited: list[float] = []

    def step(self) -> bool:
        """Send the next one where the last one is settled. Returns True."""
        now = time.monotonic()
        if self._sent is None or self._sent.settled:
            if self._sent is not None:
                self._waited.append(now - self._at)
            word = SetWord("dirt path", len(self._waited) % 10 / 10)
            self._sent, self._at = self._rover.client.answer(1, Answer(0, Motion.NONE, (word,)), now), now
        return True

    def figures(self) -> dict[str, Any]:
        waited = [*self._waited, time.monotonic() - self._at]
        return {"answers": len(self._waited), "longest_until_acknowledged_s": round(max(waited), 2)}


def _pour(name: str, to: tuple[str, int], seconds: float) -> None:
    """Send for so many seconds."""
    ports = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(PORTS)]
    frames, rate = cycle(_datagrams(name)), RATES[name]
    began, poured = time.monotonic(), 0
    while (elapsed := time.monotonic() - began) < seconds:
        while poured < elapsed * rate:
            ports[poured % PORTS].sendto(next(frames), to)
            poured += 1
        time.sleep(0.002)


def _datagrams(name: str) -> Sequence[bytes]:
    if name == "noise":
        return [b"\xfe" * 60_000]
    if name == "heartbeats":
        beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
        return [framed(beat, *sender) for sender in _SENDERS]
    return [_answer(number, sender) for number, sender in zip(range(_FRAMES), cycle(_SENDERS), strict=False)]


def _answer(number: int, sender: tuple[int, int]) -> bytes:
    words = (SetWord("gravel", number % 20 / 10 - 1),)
    payload = Answer(0, Motion.NONE, words, 1 + number).pack()
    message = mavlink.MAVLink_tunnel_message(1, 191, TUNNEL_ANSWER, len(payload), payload.ljust(128, b"\0"))
    return framed(message, *sender)
