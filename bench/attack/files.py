"""Asks MAVLink FTP for files outside of what it serves, by paths and by links."""

from __future__ import annotations

import time
from itertools import product
from pathlib import Path

from bench.attack.outcome import AttackOutcome, watched
from bench.faults.standing import Standing
from bench.faults.standing_wire import SYSTEM
from gcs_plugin.client.fetch import FetchStatus

SECRET = b"a secret outside of what is served"
_UP = ("..", "....//..", "%2e%2e", "..\\", ".\0.", "calls/../..", "calls/./../..", "logs/../calls/../..")
_NAMES = ("secret", "companion.toml", "signing.key", "state/journal.db", "etc/passwd", "proc/self/environ")
_SERVED_WITHIN, QUICK_PATHS = 120.0, 12


def files(folder: Path, *, quick: bool) -> AttackOutcome:
    """Ask for all paths, and for links in served folders."""
    outcome = AttackOutcome()
    (folder / "secret").write_bytes(SECRET)
    with Standing(folder, signs=False) as rover:
        rover.start()
        paths = ["/etc/passwd", str(folder / "secret"), *_climbing()]
        waiting = [*_plant(rover.state, folder), *(paths[:: len(paths) // QUICK_PATHS] if quick else paths)]
        asked, known = len(waiting), rover.client.fetch(SYSTEM, "/state.json", time.monotonic())
        rover.wait("a file that is served", lambda: known.status is FetchStatus.DONE, 10.0)
        fetch = known

        def ask() -> bool:
            nonlocal fetch
            if not fetch.settled:
                return True
            if fetch.status is FetchStatus.DONE and fetch is not known:
                outcome.reached.append(f"{fetch.path} by MAVLink FTP")
            if waiting:
                fetch = rover.client.fetch(SYSTEM, waiting.pop(), time.monotonic())
            return not fetch.settled

        watched(rover, outcome, ask, _SERVED_WITHIN)
        outcome.figures = {"asked": asked, "unanswered": len(waiting) + (not fetch.settled)}
    return outcome


def _climbing() -> list[str]:
    """Return paths that lead up and out, however it is written."""
    ways = [("/".join([up] * depth), name) for up, depth, name in product(_UP, (1, 2, 5), _NAMES)]
    return [f"{lead}{way}/{name}" for lead in ("/", "") for way, name in ways]


def _plant(state: Path, outside: Path) -> list[str]:
    """Leave links in the folders that are served. Return their paths."""
    (state / "calls").mkdir(exist_ok=True)
    for name, to in (("901.jpg", "secret"), ("902.json", "signing.key"), ("903-large.jpg", "companion.toml")):
        (state / "calls" / name).symlink_to(outside / to)
    (state / "scenes").mkdir(exist_ok=True)
    (state / "scenes" / "0123456789abcdef.jpg").symlink_to(outside / "secret")
    return [
        "/calls/901.jpg", "/calls/902.json", "/calls/903-large.jpg", "/scenes/0123456789abcdef.jpg",
    ]  # fmt: skip
