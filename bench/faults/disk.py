"""Rows of the fault table: a disk that loses power, is slow, full or hangs, or may not be written."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from anytraverse.operations import SetWord
from bench.faults.row import Row, RowOutcome, Work
from bench.faults.standing import Standing, repeating
from bench.faults.standing_wire import AUTO, HOLD
from bench.shim import compile_shim, preloading
from bench.stopping.slow_disk import SlowDisk
from companion.storage import Journal
from companion.system.atomic_write import write_atomically
from companion.wire.ids import Motion, Result, State

_SOURCE = Path(__file__).with_name("failing_disk.c")
_FAILS, _WORKS = "Journal cannot be written", "Journal is written again"
_SLOW = 6.0
"""Seconds that a sync of the slow disk takes."""


class FailingDisk:
    """Makes the disk below a folder full, read-only or hang, for processes started with `environment`."""

    def __init__(self, folder: Path, root: Path) -> None:
        """folder: for the shim. root: the folder that fails. Raises RuntimeError without a compiler."""
        self._said = folder / "failing_disk"
        library = compile_shim(_SOURCE, folder)
        self.environment: Mapping[str, str] = {
            **preloading(library),
            "FAILING_DISK": str(self._said),
            "FAILING_ROOT": str(root),
        }

    def set(self, how: str) -> None:
        """Make it "full" or "read-only" from now on, or have all changes hang, "hangs"; "": well.

        "dead": the start of any program hangs, too.
        """
        write_atomically(self._said, how.encode(), sync=False)


def stored_words(state: Path) -> dict[str, float]:
    """The words in the journal of a companion that has ended."""
    journal = Journal(state)
    try:
        memory = journal.load_memory()
    finally:
        journal.close()
    return {} if memory is None else {word: memory.preferences[word] for word in memory.preferences}


def _power_loss(work: Work, *, kills: int, cuts: int) -> RowOutcome:
    command = [sys.executable, "-m", "bench.faults.power_loss", "--seed", str(work.seed)]
    command += ["--kills", str(kills), "--cuts", str(cuts)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=3600.0, check=False)
    try:
        figures = json.loads(done.stdout.splitlines()[-1])
    except (IndexError, ValueError):
        return RowOutcome(0, (f"power_loss ended with {done.returncode}: {done.stderr[-500:]}",))
    killed, cut = figures["killed"], figures["cut"]
    states = [killed, cut["all"], cut["in_part"]]
    wrong = [f"{what}: {times} x" for one in states for what, times in one["wrong"].items()]
    if (killed["kills"], cut["cuts"]) != (kills, cuts):
        wrong.append(f"{killed['kills']} kills and {cut['cuts']} cuts instead of {kills} and {cuts}")
    missing = sum(one["frames_missing"] for one in states)
    saw = f"of {killed['changes']} changes; after {missing} the next start takes a newer frame, and says so"
    return RowOutcome(kills + 2 * cuts, tuple(wrong), saw=saw)


def _kills(work: Work) -> RowOutcome:
    return _power_loss(work, kills=3 if work.short else 500, cuts=0)


def _cuts(work: Work) -> RowOutcome:
    return _power_loss(work, kills=0, cuts=5 if work.short else 200)


def _unwritable(work: Work, how: str) -> RowOutcome:
    """A disk becomes full or read-only, or hangs, while the rover drives, meets a thing, and is answered.

    All sign: a hanging disk must not keep their timestamps from being used.
    """
    wrong = list[str]()
    with Standing(work.folder, policy="hold", seed=work.seed, signs=True) as rover:
        disk = FailingDisk(work.folder, rover.state)
        rover.start(disk.environment)
        rover.wait("a good view", lambda: rover.heartbeat is State.OK, 10.0)
        disk.set(how)
        since = len(rover.events)
        rover.run(2.5 if work.short else 8.0)
        if not rover.summaries(since) or rover.heartbeat is not State.OK:
            wrong.append("it did not go on judging")
        if not work.short and _status_code(rover) != 1:
            wrong.append("`companion status` did not exit with 1")
        call = rover.open_call()
        rover.wait("the hold", lambda: rover.wire.mode == HOLD, 5.0)
        hold_s = rover.wire.modes[-1][0] - rover.clear_at
        named = rover.answer(call.id, Motion.NONE, [SetWord("gravel", 1.0)])
        rover.thing = False
        gone = rover.answer(call.id, Motion.GO)
        if {named.result, gone.result} != {Result.APPLIED_NOT_REMEMBERED}:
            wrong.append(f"acknowledged as {named.result.name}, {gone.result.name}")
        rover.wait("the way back", lambda: rover.wire.mode == AUTO, 10.0)
        _expect_text(rover, _FAILS, since, wrong)
        disk.set("")
        back = rover.wait("the journal", lambda: _said(rover, _WORKS, since), 15.0)
        last = rover.answer(0, Motion.NONE, [SetWord("dirt path", 1.0)])
        if last.result is not Result.APPLIED:
            wrong.append(f"afterwards acknowledged as {last.result.name}")
        rover.kill()
        lost = {"gravel", "dirt path"} - stored_words(rover.state).keys()
        if lost:
            wrong.append(f"lost: {sorted(lost)}")
    return RowOutcome(1, tuple(wrong), hold_s, back, f'"{named.text}", "{_FAILS}", "{_WORKS}"')


def _unwritable_at_start(work: Work, how: str) -> RowOutcome:
    """A disk that is full or read-only at the start, with a journal from before."""
    wrong = list[str]()
    with Standing(work.folder, policy="hold", seed=work.seed) as rover:
        disk = FailingDisk(work.folder, rover.state)
        rover.start(disk.environment)
        rover.stop()
        disk.set(how)
        if how == "full":
            rover.start(disk.environment)
            since = len(rover.events)
            call = rover.open_call()
            rover.wait("the hold", lambda: rover.wire.mode == HOLD, 5.0)
            hold_s: float | None = rover.wire.modes[-1][0] - rover.clear_at
            answer = rover.answer(call.id, Motion.GO)
            if answer.result is not Result.APPLIED_NOT_REMEMBERED:
                wrong.append(f"acknowledged as {answer.result.name}")
            saw = f'it starts; "{answer.text}"'
            disk.set("")
            back = rover.wait("the journal", lambda: _said(rover, _WORKS, since), 15.0)
        else:
            before = len(rover.log)
            rover.start(disk.environment, wait=False)
            rover.wait("its end", lambda: rover.daemon is None or not rover.daemon.running, 20.0, runs=False)
            assert rover.daemon is not None
            hold_s, code = None, rover.daemon.process.returncode
            saw = rover.log[before:].strip().splitlines()[-1].replace(str(rover.state), "STATE")
            if code != 2 or "Traceback" in rover.log[before:] or "check the disk" not in saw:
                wrong.append(f"exit code {code}: {saw}")
            disk.set("")
            back = rover.start(disk.environment)
        rover.stop()
    return RowOutcome(1, tuple(wrong), hold_s, back, saw)


def _slow(work: Work) -> RowOutcome:
    """A disk on which each sync takes 6 s, while an operator answers."""
    wrong = list[str]()
    with Standing(work.folder, seed=work.seed) as rover:
        disk = SlowDisk(work.folder)
        rover.start(disk.environment)
        rover.wait("a good view", lambda: rover.heartbeat is State.OK, 10.0)
        disk.delay(_SLOW)
        since, began = len(rover.events), time.monotonic()
        answer = rover.answer(0, Motion.NONE, [SetWord("gravel", 1.0)])
        took = time.monotonic() - began
        if answer.result is not Result.APPLIED_NOT_REMEMBERED or not 1.9 <= took <= 3.0:
            wrong.append(f"acknowledged as {answer.result.name} after {took:.1f} s")
        if not rover.summaries(since):
            wrong.append("it did not go on judging")
        rover.wait("that the operator is told", lambda: _said(rover, _FAILS, since), 5.0)
        disk.delay(0.0)
        began = time.monotonic()
        while (
            last := rover.answer(0, Motion.NONE, [SetWord("dirt path", 1.0)])
        ).result is not Result.APPLIED:
            if time.monotonic() - began > 30.0:
                wrong.append(f"afterwards acknowledged as {last.result.name}")
                break
        back = time.monotonic() - began
        rover.kill()
        lost = {"gravel", "dirt path"} - stored_words(rover.state).keys()
        if lost:
            wrong.append(f"lost: {sorted(lost)}")
    return RowOutcome(1, tuple(wrong), None, back, f'"{answer.text}" after {took:.1f} s')


def _said(rover: Standing, text: str, since: int) -> bool:
    return any(text in one for one in rover.texts(since))


def _expect_text(rover: Standing, text: str, since: int, wrong: list[str]) -> None:
    if not _said(rover, text, since):
        wrong.append(f'the operator was not told "{text}"')


def _status_code(rover: Standing) -> int:
    """Ask `companion status`, while the camera goes on."""
    command = [sys.executable, "-m", "companion", "status", str(rover.config)]
    asked = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        rover.wait("companion status", lambda: asked.poll() is not None, 60.0)
    finally:
        asked.kill()
    return asked.wait()


_GOES_ON = "not remembered"

ROWS = (
    Row(
        "companion killed while it writes",
        "SIGKILL before 500 random changes of the journal, pictures and settings",
        "no acknowledged answer lost or counted twice",
        _kills,
    ),
    Row(
        "power lost while it writes",
        "at 200 random points all that was not synced is thrown away, and a random part of it",
        "no acknowledged answer lost or counted twice",
        _cuts,
    ),
    repeating(
        "slow disk",
        "each sync takes 6 s",
        "not remembered",
        5,
        _slow,
    ),
    repeating("disk full", "ENOSPC", _GOES_ON, 5, partial(_unwritable, how="full"), holds=True),
    repeating(
        "disk full at the start",
        "ENOSPC from the first write on",
        "it starts, " + _GOES_ON.removeprefix("it "),
        5,
        partial(_unwritable_at_start, how="full"),
        holds=True,
    ),
    repeating(
        "disk becomes read-only", "EROFS", _GOES_ON, 5, partial(_unwritable, how="read-only"), holds=True
    ),
    repeating(
        "disk hangs in a write",
        "no write, sync or other change below the state folder ends",
        _GOES_ON,
        5,
        partial(_unwritable, how="hangs"),
        holds=True,
    ),
    repeating(
        "disk read-only at the start",
        "EROFS from the first write on",
        "does not start, says why",
        5,
        partial(_unwritable_at_start, how="read-only"),
    ),
)
"""Of the disk."""
