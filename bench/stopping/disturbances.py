"""Disturbs a healthy companion, which must go on driving: a slow disk, strangers, a flood of answers."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from itertools import cycle

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import SetWord
from bench.stopping.stage import Stage
from companion.wire.answers import Answer
from companion.wire.ids import COMPONENT_ID, TUNNEL_ANSWER, Motion

DISK_DELAY = 8.0
"""Seconds that each write to the disk takes longer."""
STRANGERS, JUNK_RATE = 8, 300
"""Ports that send datagrams of one byte, and how many a second they send together."""
FLOOD_RATE = 2000
"""Answers a second, from all ids that may answer: 11 systems of 255 components."""
_STEP = 0.01

Pressure = Callable[[Stage], AbstractContextManager[None]]


@contextmanager
def slow_disk(stage: Stage) -> Iterator[None]:
    """Makes every write take 8 s longer, and gives the companion something to write."""
    assert stage.disk is not None
    stage.disk.delay(DISK_DELAY)
    stage.ground.set_weight("GRASS", 0.9)
    try:
        yield
    finally:
        stage.disk.delay(0.0)


@contextmanager
def spoofed_peers(stage: Stage) -> Iterator[None]:
    """Lets strangers send rubbish to the port where the companion listens."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(STRANGERS)]
    others = cycle(sockets)

    def junk() -> None:
        address = stage.wire.companion
        assert address is not None
        next(others).sendto(b"\0", address)

    with _repeated(junk, JUNK_RATE):
        yield
    for one in sockets:
        one.close()


@contextmanager
def answer_flood(stage: Stage) -> Iterator[None]:
    """Lets every id that may answer send answers all the time."""
    frames = cycle(_answers())
    with _repeated(lambda: stage.wire.to_companion(next(frames)), FLOOD_RATE):
        yield


PRESSURES: Mapping[str, Pressure] = {
    "slow_disk": slow_disk,
    "spoofed_peers": spoofed_peers,
    "answer_flood": answer_flood,
}


def _answers() -> list[bytes]:
    found = []
    for number in range(11 * 255):
        sender = mavlink.MAVLink(None, 245 + number // 255, 1 + number % 255)
        payload = Answer(0, Motion.NONE, (SetWord("grass", 0.5),), number + 1).pack()
        padded = list(payload.ljust(128, b"\0"))
        message = mavlink.MAVLink_tunnel_message(1, COMPONENT_ID, TUNNEL_ANSWER, len(payload), padded)
        found.append(bytes(message.pack(sender)))
    return found


@contextmanager
def _repeated(act: Callable[[], None], rate: float) -> Iterator[None]:
    """Calls a function so often a second in a thread, until the block ends."""
    over = threading.Event()

    def run() -> None:
        begun, done = time.monotonic(), 0
        while not over.wait(_STEP):
            due = int((time.monotonic() - begun) * rate)
            for _ in range(min(due - done, 200)):
                act()
            done = due

    thread = threading.Thread(target=run, name="pressure", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
