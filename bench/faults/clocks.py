"""Rows of the fault table: clocks that jump, and a board without a clock."""

from __future__ import annotations

import time
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

from anytraverse.operations import SetWord
from bench.faults.disk import stored_words
from bench.faults.row import RowOutcome, Work
from bench.faults.standing import Standing, repeating
from bench.faults.standing_calls import APPLIED, comes_back, drive_on, held_call, still_open
from bench.shim import compile_shim, preloading
from companion.system.atomic_write import write_atomically
from companion.wire.ids import Motion

DAY = 86_400
_SOURCE = Path(__file__).with_name("jumping_clock.c")


class JumpingClock:
    """Sets the wall clock of the processes that are started with `environment`."""

    def __init__(self, folder: Path) -> None:
        """Compiles the shim into `folder`. Raises RuntimeError if that fails."""
        self._said = folder / "clock_jump"
        self.environment: Mapping[str, str] = {
            **preloading(compile_shim(_SOURCE, folder)),
            "CLOCK_JUMP": str(self._said),
        }

    def set(self, ahead: int) -> None:
        """Make the wall clock `ahead` s ahead of the real one from now on."""
        write_atomically(self._said, str(ahead).encode(), sync=False)


def _check_stamps(rover: Standing, wrong: list[str]) -> None:
    stamps = rover.wire.stamps
    if len(stamps) < 10 or any(later <= earlier for earlier, later in pairwise(stamps)):
        wrong.append(f"signing timestamps of {len(stamps)} frames do not rise")
    if "Traceback" in rover.log:
        wrong.append("a traceback stands in the log")


def _jumps_while_running(work: Work) -> RowOutcome:
    wrong = list[str]()
    with Standing(work.folder, policy="hold", seed=work.seed, signs=True) as rover:
        clock = JumpingClock(work.folder)
        rover.start(clock.environment)
        call = held_call(rover)
        for ahead in (DAY, -DAY, 0):
            clock.set(ahead)
            judged, began = rover.judged(), time.monotonic()
            rover.run(2.2)
            still_open(rover, call, f"{ahead} s ahead", wrong)
            if rover.judged() <= judged:
                wrong.append(f"{ahead} s ahead: it did not go on judging")
            given = rover.answer(call, Motion.NONE, [SetWord("gravel" if ahead else "dirt path", 1.0)])
            if given.result not in APPLIED or time.monotonic() - began > 5.0:
                wrong.append(f"{ahead} s ahead: acknowledged as {given.result.name}")
        drive_on(rover, call, wrong)
        if any("fault" in text.lower() for text in rover.texts()):
            wrong.append(f"a fault was told: {rover.texts()}")
        _check_stamps(rover, wrong)
        rover.stop()
        lines = (rover.state / "logs" / "companion.log").read_text().splitlines()
        days = {line[:10] for line in lines}
        if len(days) < 3 or not (rover.state / "calls" / f"{call}.json").is_file():
            wrong.append(f"log or files of the call are lost: days {sorted(days)}")
        lost = {"gravel", "dirt path"} - stored_words(rover.state).keys()
        if lost:
            wrong.append(f"lost: {sorted(lost)}")
    return RowOutcome(1, tuple(wrong), saw=f"call {call} stays open; {len(rover.wire.stamps)} signed frames")


def _jumps_between_runs(work: Work) -> RowOutcome:
    wrong, back = list[str](), 0.0
    with Standing(work.folder, policy="hold", seed=work.seed, signs=True, listens=True) as rover:
        clock = JumpingClock(work.folder)
        rover.start(clock.environment)
        call = held_call(rover)
        for ahead in (DAY, -DAY):
            rover.kill()
            clock.set(ahead)
            began = time.monotonic()
            rover.start(clock.environment)
            back = max(back, comes_back(rover, call, began))
            still_open(rover, call, f"started {ahead} s ahead", wrong)
        drive_on(rover, call, wrong)
        _check_stamps(rover, wrong)
    return RowOutcome(2, tuple(wrong), None, back, f"call {call} is open after both starts")


def _no_clock(work: Work) -> RowOutcome:
    """The board starts in 1970, then its clock is set, then the power goes, and it is 1970 again."""
    wrong = list[str]()
    with Standing(work.folder, policy="hold", seed=work.seed, signs=True, listens=True) as rover:
        clock = JumpingClock(work.folder)
        clock.set(-int(time.time()) + 60)
        back = rover.start(clock.environment)
        call = held_call(rover)
        clock.set(0)
        rover.run(1.3)
        still_open(rover, call, "after the clock was set", wrong)
        rover.kill()
        clock.set(-int(time.time()) + 60)
        began = time.monotonic()
        rover.start(clock.environment)
        back = max(back, comes_back(rover, call, began))
        drive_on(rover, call, wrong)
        _check_stamps(rover, wrong)
    return RowOutcome(2, tuple(wrong), None, back, "it signs by the time of the autopilot's signed frames")


ROWS = (
    repeating(
        "clock jumps a day while it runs",
        "the wall clock of all its processes goes a day forwards, two back, and one forwards",
        "the call stays open; signing goes on",
        5,
        _jumps_while_running,
        returns=False,
    ),
    repeating(
        "clock jumps a day between two runs",
        "SIGKILL with an open call, and a start a day later; the same, and a start two days earlier",
        "the call stays open; signing goes on",
        3,
        _jumps_between_runs,
    ),
    repeating(
        "no clock at the start",
        "it starts in 1970, its clock is set, and it starts in 1970 again; all is signed",
        "the call stays open; it signs by the autopilot's time",
        3,
        _no_clock,
    ),
)
"""Of clocks."""
