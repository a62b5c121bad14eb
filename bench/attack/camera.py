"""Lets a whole companion look through a hostile camera."""

from __future__ import annotations

import time
from contextlib import closing
from functools import partial
from pathlib import Path

from bench.attack.hostile_camera import GOOD, WAYS, HostileCamera
from bench.attack.outcome import AttackOutcome, peak_memory, watched
from bench.faults.standing import Standing
from bench.processes import children
from companion.wire.ids import State

SECONDS, QUICK, QUICK_WAYS = 4.0, 3.0, slice(1, None, 3)
BACK_WITHIN, MOST_MB = 10.0, 500
"""s until frames are judged again, and what the vision process may take: its own 90 MB, and a buffer of
FFmpeg with its copy."""


def camera(folder: Path, *, quick: bool) -> AttackOutcome:
    """Be hostile in each of `WAYS`, and good again. While the camera is hostile no frame need be judged."""
    outcome, longest, most = AttackOutcome(), 0.0, 0
    names = list(WAYS)[QUICK_WAYS] if quick else list(WAYS)
    with closing(HostileCamera()) as hostile, Standing(folder, camera=hostile.source) as rover:
        rover.start()
        for name in names:
            way, hostile.way = _Way(rover), name
            watched(rover, outcome, way.look, QUICK if quick else SECONDS, sees=False)
            hostile.way, began, judged = GOOD, time.monotonic(), rover.judged()
            watched(rover, outcome, partial(_is_blind, rover, judged), 2 * BACK_WITHIN, sees=False)
            longest, most = max(longest, time.monotonic() - began), max(most, way.megabytes)
            if not (way.faulty or way.judges):
                outcome.reached.append(f"{name}: blind without a fault")
            if time.monotonic() - began > BACK_WITHIN:
                outcome.reached.append(f"{name}: not seeing again")
            if way.megabytes > MOST_MB:
                outcome.reached.append(f"{name}: {way.megabytes} MB of memory")
    outcome.figures = {"ways": len(names), "longest_until_seeing_s": round(longest, 2), "vision_mb": most}
    return outcome


class _Way:
    """What a rover does while its camera is hostile."""

    def __init__(self, rover: Standing) -> None:
        self._rover, self._before, self._began = rover, rover.judged(), time.monotonic()
        self.faulty, self.megabytes = False, 0

    @property
    def judges(self) -> bool:
        """Whether a frame a second was judged."""
        return self._rover.judged() - self._before > time.monotonic() - self._began

    def look(self) -> bool:
        """Note what is so now. Returns True."""
        assert self._rover.daemon is not None
        self.faulty = self.faulty or self._rover.heartbeat is State.FAULT
        started = children(self._rover.daemon.process.pid).items()
        memory = [peak_memory(pid) for pid, command in started if "companion.vision" in command]
        self.megabytes = max([self.megabytes, *memory])
        return True


def _is_blind(rover: Standing, judged: int) -> bool:
    return rover.judged() <= judged + 3 or rover.heartbeat in (State.FAULT, State.STARTING)
