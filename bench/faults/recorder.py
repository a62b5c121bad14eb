"""Rows of the fault table: the recorder or its disk fails, while the rover is held and answered."""

from __future__ import annotations

import os
import signal
import threading
import time
from functools import partial
from typing import Any

from anytraverse.operations import SetWord
from bench.faults.disk import FailingDisk
from bench.faults.row import RowOutcome, Work
from bench.faults.standing import Standing, repeating
from bench.faults.standing_wire import AUTO, HOLD
from bench.processes import child_of
from companion.observers.recording.reading import messages, whole
from companion.observers.recording.recorder import missing
from companion.observers.recording.ring import FOLDER
from companion.wire.ids import Motion, Result, State

_MB = 20
_ACKNOWLEDGED_WITHIN = 1.0
"""s for an answer that must not wait for the recorder: a disk that does delays it by 2 s."""
_TOLD_WITHIN = 20.0
_BACK_WITHIN = 15.0
"""s until it records again: a recorder that hangs is killed after 10 s of silence."""


def _recorder(rover: Standing) -> int:
    """The process id of the recorder. Raises LookupError without one."""
    assert rover.daemon is not None
    if child := child_of(rover.daemon.process.pid, "companion.observers.recording"):
        return child
    raise LookupError("no recorder runs")


def _told(rover: Standing) -> dict[str, Any]:
    return dict(rover.status().get("recording", {}))


class Restarted(threading.Thread):
    """Watches the status until another recorder records. at: monotonic seconds of that, None before."""

    def __init__(self, rover: Standing) -> None:
        super().__init__(daemon=True)
        self._rover = rover
        self.at: float | None = None

    def run(self) -> None:
        """Watch."""
        until = time.monotonic() + _TOLD_WITHIN
        while self.at is None and time.monotonic() < until:
            told = _told(self._rover)
            if told.get("restarts") and told.get("on"):
                self.at = time.monotonic()
            time.sleep(0.05)


def _recorder_fails(work: Work, how: str) -> RowOutcome:
    """how: a signal's name, or what `FailingDisk` takes."""
    if why := missing():
        return RowOutcome(0, (why,))
    wrong = list[str]()
    with Standing(work.folder, policy="hold", seed=work.seed, recorded=_MB) as rover:
        folder = rover.state / FOLDER
        disk = FailingDisk(work.folder, folder)
        rover.start(disk.environment)
        rover.wait("a recording", lambda: any(path.stat().st_size for path in folder.glob("*.mcap")), 20.0)
        rover.wait("that it is told", lambda: _told(rover).get("on") is True, 5.0)
        rover.wait("a good view", lambda: rover.heartbeat is State.OK, 10.0)
        first, since, began = _recorder(rover), len(rover.events), time.monotonic()
        restarted = Restarted(rover)
        if how.startswith("SIG"):
            os.kill(first, signal.Signals[how])
            restarted.start()
        else:
            disk.set(how)
        hold_s = _hold_and_answer(rover, since, wrong)
        if how.startswith("SIG"):
            rover.wait("another recorder", lambda: restarted.at is not None, _TOLD_WITHIN)
            lines = (line for line in rover.log.splitlines() if "the recorder " in line)
            saw = "log: the recorder" + next(lines, "").partition("the recorder")[2]
        else:
            rover.wait("its trouble", lambda: _in_trouble(rover), _TOLD_WITHIN)
            saw = f"status: {_told(rover)['trouble']}, told after {time.monotonic() - began:.0f} s"
        disk.set("")
        back = rover.wait("that it records again", lambda: _told(rover).get("on") is True, 20.0)
        if restarted.at is not None:
            back = restarted.at - began
        rover.run(3.0)
        lost = _told(rover).get("lost")
        rover.stop()
        files = sorted(folder.glob("*.mcap"))
        if how.startswith("SIG") and not all(map(whole, files)):
            wrong.append("a recording was not repaired")
        for path, when in ((files[0], "before"), (files[-1], "afterwards")):
            if next(messages(path, {"/camera"}), None) is None:
                wrong.append(f"nothing that was recorded {when} is left")
    return RowOutcome(1, tuple(wrong), hold_s, back, f"{saw}; {lost} messages lost")


def _in_trouble(rover: Standing) -> bool:
    told = _told(rover)
    return told.get("on") is False and bool(told.get("trouble"))


def _hold_and_answer(rover: Standing, since: int, wrong: list[str]) -> float:
    """Judge for a while, meet a thing, and answer; return s until the hold."""
    rover.run(1.5)
    if not rover.summaries(since):
        wrong.append("it did not go on judging")
    call = rover.open_call()
    rover.wait("the hold", lambda: rover.wire.mode == HOLD, 5.0)
    hold_s = rover.wire.modes[-1][0] - rover.clear_at
    for changes in ([SetWord("gravel", 1.0)], [SetWord("gravel", 0.5)]):
        asked = time.monotonic()
        answer = rover.answer(call.id, Motion.NONE, changes)
        took = time.monotonic() - asked
        if answer.result is Result.APPLIED_NOT_REMEMBERED or took > _ACKNOWLEDGED_WITHIN:
            wrong.append(f"acknowledged as {answer.result.name} after {took:.1f} s")
    rover.thing = False
    rover.answer(call.id, Motion.GO)
    rover.wait("the way back", lambda: rover.wire.mode == AUTO, 10.0)
    return hold_s


_GOES_ON = "goes on"

ROWS = tuple(
    repeating(fault, produced, _GOES_ON, 5, partial(_recorder_fails, how=how), holds=True)._replace(
        return_within=_BACK_WITHIN
    )
    for fault, produced, how in (
        ("recorder killed", "SIGKILL of the recorder", "SIGKILL"),
        ("recorder hangs", "SIGSTOP of the recorder, which is killed after 10 s", "SIGSTOP"),
        ("recorder's disk full", "ENOSPC below the folder of the recordings", "full"),
        ("recorder's disk read-only", "EROFS below that folder", "read-only"),
        ("recorder's disk hangs", "no write and no sync below that folder ends", "hangs"),
    )
)
"""Of the recorder."""
