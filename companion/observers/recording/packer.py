"""Has incidents packed on request, one at a time, by a process of lowest priority: the supervisor's end.

Nothing here waits, and no failure of packing reaches the rest of the daemon.
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from companion.config import Config, format_config
from companion.observers.recording.packing import CANCELLED, LONGEST, PackingRequest, kept
from companion.observers.recording.recorder import SWITCHED_OFF, missing
from companion.system.error_guard import ErrorGuard
from companion.system.side_process import SideChild
from companion.wire.ids import Result
from companion.wire.incidents import MOST_KEPT, Incidents, about, packed_from
from companion.wire.json_values import DocumentError, read_object, text_of

log = logging.getLogger(__name__)

COMMAND = (sys.executable, "-m", "companion.observers.recording.packing_process")
STALLED = 120.0
"""Seconds without progress after which the process is killed."""
LONGEST_RUN = 900.0
"""Seconds after which it is killed in any case. On a computer that has nothing else to do it needs a few."""
_ENDS_WITHIN = 10.0
"""Seconds after which one that was cancelled is killed. The next one deletes what it had written."""
PAUSE = 10.0
"""Seconds between two incidents, so that a flood of requests wears no disk out."""


class PackingChild(SideChild):
    """Runs `python -m companion.observers.recording.packing_process`."""

    def __init__(self, command: Sequence[str] = COMMAND) -> None:
        """Start the process. Raises OSError."""
        super().__init__(command, buffer=2 * LONGEST, longest=LONGEST)


class IncidentPacker:
    """Owns the process that packs. The main loop calls `poll` in every turn. Times are monotonic seconds."""

    def __init__(
        self,
        config: Config,
        launch: Callable[[], PackingChild] = PackingChild,
        stalled: float = STALLED,
        longest: float = LONGEST_RUN,
    ) -> None:
        """launch: starts the process or raises OSError. stalled, longest: see `STALLED`, `LONGEST_RUN`."""
        self._folder = Path(os.path.abspath(config.journal.path))
        self._config = format_config(config)
        self._not_recorded = missing() if config.recording.most else SWITCHED_OFF
        self._launch = launch
        self._stalled, self._longest = stalled, longest
        self._child: PackingChild | None = None
        self._began = self._looked_at = self._ended = float("-inf")
        self._cancelled_at: float | None = None
        self._worked = 0.0
        """CPU seconds of the process at the last look."""
        self._guard = ErrorGuard(lambda _now: None)
        self.told = Incidents()
        """What the ground and the page are told."""
        try:
            self.told = Incidents(packed=tuple(kept(self._folder)))
        except OSError as error:
            log.warning("the incidents packed before are not known: %s", error)

    def ask(self, call: int, now: float) -> tuple[Result, str]:
        """Have an incident packed; one that was packed just now counts. Returns what a requester is told.

        call: as of `Packed`.
        """
        last = self.told.packed[0] if self.told.packed else None
        if self.told.packing is not None:
            if self._cancelled_at is not None:
                return Result.REFUSED, f"{_named(self.told.packing)} is being cancelled: ask again in 10 s"
            if self.told.packing == call:
                return Result.APPLIED, f"{_named(call)} is being packed"
            return Result.REFUSED, f"{_named(self.told.packing)} is being packed: ask again when it is done"
        wait = self._ended + PAUSE - now
        if wait > 0 and self.told.failed is None and last is not None and last.call == call:
            return Result.APPLIED, f"{_named(call)} was packed just now"
        if wait > 0:
            return Result.REFUSED, f"one was asked for just now: ask again in {wait:.0f} s"
        return self._start(call, now)

    def cancel(self, call: int, now: float) -> tuple[Result, str]:
        """Have an incident packed no more. Returns what a requester is told. call: as for `ask`."""
        packing = self.told.packing
        if self._child is None or packing is None:
            return Result.REFUSED, "nothing is being packed"
        if packing != call:
            return Result.REFUSED, f"{_named(packing)} is being packed, not {_named(call)}"
        if self._cancelled_at is None:
            self._cancelled_at = now
            self._child.terminate()
        return Result.APPLIED, f"{_named(call)} is being cancelled"

    def poll(self, now: float) -> None:
        """Take what the process says, and end one that takes too long."""
        if self._child is None:
            return
        with self._guard.survived("packing an incident", now):
            try:
                ended = self._child.ended()
            except OSError as error:
                self._fail(_not_started(error), now)
                return
            said = self._child.receive()
            if said:
                self._finish(said[0], now)
            elif ended:
                self._fail(f"packing ended with {ended}", now)
            elif self._cancelled_at is not None and now - self._cancelled_at > _ENDS_WITHIN:
                self._fail(CANCELLED, now)
            elif now - self._began > self._longest:
                self._fail(f"it took longer than {self._longest:.0f} s: use `companion incident`", now)
            elif now - self._looked_at > self._stalled and not self._progresses(self._child, now):
                busy = "the disk hangs, or the computer is busy"
                self._fail(f"it made no progress for {self._stalled:.0f} s: {busy}", now)

    def document(self) -> dict[str, Any]:
        """Return the content of /incidents.json."""
        return self.told.document()

    def close(self) -> None:
        """Kill the process."""
        if self._child is not None:
            self._child.close()
            self._child = None

    def _progresses(self, child: PackingChild, now: float) -> bool:
        """Whether the process has worked since the last look. One that waits for a disk has not."""
        before, self._worked, self._looked_at = self._worked, child.cpu_seconds(), now
        return self._worked > before

    def _start(self, call: int, now: float) -> tuple[Result, str]:
        try:
            asked = PackingRequest(str(self._folder), self._config, call, self._not_recorded).encoded()
            child = self._launch()
            if not child.send(asked):
                child.close()
                raise OSError("it does not listen")
        except (OSError, ValueError) as error:
            self._ended = now
            return Result.REFUSED, _not_started(error)
        self._child, self._began, self._looked_at, self._worked = child, now, now, 0.0
        self._cancelled_at = None
        self.told = self.told._replace(packing=call, failed=None)
        log.info("%s is being packed", _named(call))
        return Result.APPLIED, f"{_named(call)} is being packed"

    def _finish(self, said: bytes, now: float) -> None:
        try:
            told = read_object(said)
        except DocumentError:
            told = {}
        packed = packed_from(told)
        if packed is None:
            self._fail(text_of(told.get("why")) or "packing failed", now)
            return
        log.info("%s is packed: %s, %d bytes", _named(packed.call), packed.name, packed.size)
        self._end(Incidents(packed=(packed, *self.told.packed)[:MOST_KEPT]), now)

    def _fail(self, why: str, now: float) -> None:
        call = self.told.packing or 0
        if self._cancelled_at is not None:
            why = CANCELLED
        log.warning("%s is not packed: %s", _named(call), why)
        self._end(Incidents(None, (call, why), self.told.packed), now)

    def _end(self, told: Incidents, now: float) -> None:
        self.close()
        self.told, self._ended = told, now


def _not_started(error: Exception) -> str:
    return f"packing cannot be started: {str(error).lower()}"


def _named(call: int) -> str:
    return f"recording {-call}" if call < 0 else about(call) if call else "the last minute"
