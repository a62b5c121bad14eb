"""Kills the vision process between an answer and its acknowledgement, again and again, by SIGKILL.

`python -m bench.vision.kills --kills 200`. Real processes: the daemon in this one, the vision process that it
starts, an operator on UDP who sends each answer again under the same transaction until it is acknowledged for
good. Its last line is JSON. `lost`: words that were acknowledged and are not in the journal afterwards.
`twice`: answers that were applied more than once, by the memory's clock, which counts every change.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import random
import signal
import socket
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any
from unittest import mock

import cv2
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import SetWord
from bench.link.synthetic_frames import picture
from bench.processes import child_of
from bench.vision.synthetic import COMMAND, register
from companion import run
from companion.config import load_config
from companion.storage import Journal
from companion.tasks import VISION
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.ids import (
    CHANGING_RESULTS,
    COMPONENT_ID,
    TUNNEL_ACKNOWLEDGEMENT,
    TUNNEL_ANSWER,
    Motion,
)

LONGEST_DELAY = 0.06
"""s from sending to the kill, at random: about the time that an answer takes."""
_LOOK = 0.002
AGAIN_AFTER = 0.4
PATIENCE = 30.0


class _Operator:
    """Sends answers as 255/190 and receives the acknowledgements."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(_LOOK)
        self._rover: Any = None
        self._encoder = mavlink.MAVLink(None, 255, 190)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True

    @property
    def port(self) -> int:
        """The port on which it listens."""
        return int(self.socket.getsockname()[1])

    def send(self, transaction: int, word: str, weight: float) -> None:
        """Sends one word without a call."""
        payload = Answer(0, Motion.NONE, (SetWord(word, weight),), transaction).pack()
        padded = list(payload.ljust(128, b"\0"))
        message = mavlink.MAVLink_tunnel_message(1, COMPONENT_ID, TUNNEL_ANSWER, len(payload), padded)
        packed = message.pack(self._encoder)
        self._encoder.seq = (self._encoder.seq + 1) % 256
        if self._rover is not None:
            self.socket.sendto(packed, self._rover)

    def heard(self) -> bool:
        """Whether anything has come from the companion yet."""
        self.acknowledgements()
        return self._rover is not None

    def acknowledgements(self) -> list[Acknowledgement]:
        """Returns the acknowledgements that came within 2 ms."""
        try:
            data, self._rover = self.socket.recvfrom(4096)
        except TimeoutError:
            return []
        return [
            Acknowledgement.unpack(bytes(message.payload[: message.payload_length]))
            for message in self._parser.parse_buffer(data) or []
            if message.get_type() == "TUNNEL" and message.payload_type == TUNNEL_ACKNOWLEDGEMENT
        ]


class Returns(logging.Handler):
    """Counts how often the vision process came back. took: s from each kill until then."""

    def __init__(self) -> None:
        super().__init__()
        self.count = 0
        self.killed_at: float | None = None
        self.took: list[float] = []
        self.setFormatter(logging.Formatter("%(message)s"))
        log = logging.getLogger("companion.vision.client")
        log.setLevel(logging.INFO)
        log.addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        if record.getMessage() != "the vision process is back":
            return
        self.count += 1
        if self.killed_at is not None:
            self.took.append(time.monotonic() - self.killed_at)
            self.killed_at = None


def kills(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """Kills vision `count` times and returns the figures."""
    register()
    chance, operator = random.Random(seed), _Operator()
    frames = folder / "frames"
    frames.mkdir()
    cv2.imwrite(str(frames / "0.png"), picture(0)[..., ::-1])
    path = folder / "companion.toml"
    path.write_text(
        f'[camera]\nsource = "folder:{frames}"\nloop = true\n[web]\nlisten = ""\n'
        f'[recording]\nsize = 0\n[vehicle]\nfile = ""\n'
        f'[link]\nurl = "udpout:127.0.0.1:{operator.port}"\nbudget = 0\nasked_budget = 0\n'
        f'[journal]\nfolder = "{folder / "state"}"\n[perceiver]\nname = "synthetic"\n[words]\ngrass = 1.0\n'
    )
    over, results = threading.Event(), Counter[str]()
    told: dict[str, float] = {}
    daemon = threading.Thread(
        target=run.main, args=(load_config(str(path)), over.is_set, COMMAND), name="daemon"
    )
    killed = answers = 0
    returns, status = Returns(), folder / "state" / "status.json"
    with mock.patch("companion.run.VISION", VISION._replace(first=0.0)):
        daemon.start()
        try:
            while killed < count:
                answers += 1
                word, weight = f"thing {answers % 12 + 1}", round(2.0 * chance.random() - 1.0, 3)
                _until_ready(operator, partial(_is_ready, status, returns, killed))
                killed += _answered(operator, answers, word, weight, chance, results, returns)
                told[word] = weight
        finally:
            over.set()
            daemon.join()
            operator.socket.close()
    journal = Journal(folder / "state")
    memory = journal.load_memory()
    journal.close()
    assert memory is not None
    kept = {word: round(memory.preferences[word], 3) for word in memory.preferences}
    lost = [word for word, weight in told.items() if abs(kept.get(word, 9.0) - weight) > 1e-3]
    # The clock counts the first reference, if a frame was judged at all between the kills, each return of the
    # process, and each answer that was applied.
    twice = memory.clock - (memory.reference is not None) - returns.count - answers
    return {
        "kills": killed,
        "answers": answers,
        "returns": returns.count,
        "return_s": {"p50": round(median(returns.took), 2), "max": round(max(returns.took), 2)},
        "lost": len(lost),
        "twice": twice,
        "acknowledged": dict(results),
    }


def _answered(
    operator: _Operator,
    transaction: int,
    word: str,
    weight: float,
    chance: random.Random,
    results: Counter[str],
    returns: Returns,
) -> int:
    """Sends an answer until it is acknowledged for good; returns the number of kills meanwhile."""
    until = time.monotonic() + PATIENCE
    kill_at: float | None = None
    sent_at, killed = float("-inf"), 0
    while time.monotonic() < until:
        now = time.monotonic()
        if now - sent_at >= AGAIN_AFTER:
            sent_at = now
            operator.send(transaction, word, weight)
            if kill_at is None and not killed:
                kill_at = now + chance.random() * LONGEST_DELAY
        if kill_at is not None and now >= kill_at:
            kill_at = None
            pid = child_of(os.getpid(), "bench.vision.synthetic")
            if pid:
                os.kill(pid, signal.SIGKILL)
                killed, returns.killed_at = 1, time.monotonic()
        for ack in operator.acknowledgements():
            if ack.transaction == transaction:
                results[ack.result.name.lower()] += 1
                if ack.result in CHANGING_RESULTS:
                    return killed
    raise TimeoutError(f"answer {transaction} was never acknowledged: {dict(results)}")


def _is_ready(status: Path, returns: Returns, killed: int) -> bool:
    return status.is_file() and returns.count >= killed


def _until_ready(operator: _Operator, ready: Callable[[], bool]) -> None:
    """Waits for the process that follows the last one that was killed."""
    until = time.monotonic() + PATIENCE
    while not operator.heard() or not ready():
        if time.monotonic() > until:
            raise TimeoutError("no vision process")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the bench; returns 0 when nothing was lost or applied twice."""
    parser = argparse.ArgumentParser(prog="python -m bench.vision.kills", description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        figures = kills(options.kills, options.seed, Path(folder))
    print(json.dumps(figures))
    return 0 if figures["lost"] == figures["twice"] == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
