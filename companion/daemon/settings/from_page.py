"""Has the file changed for who uses the page: proposes, shows what would change, and asks root's helper.

Nothing here waits. The page's process is believed nothing: of it come changes, which are checked here, in the
process that proposes, and by the helper, and the name of a proposal that was made here.
"""

from __future__ import annotations

import logging
import secrets
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from companion.config import Config
from companion.config.guards import Guard, guard_of
from companion.config.request import ConfigAnswer, Value
from companion.config.rows import all_settings
from companion.config.stopping import ground_region
from companion.daemon.settings.file_change import FileChange
from companion.daemon.settings.proposing import Asked, Proposed, ProposingChild, table_words
from companion.system.error_guard import ErrorGuard
from companion.vehicle.state import Vehicle
from companion.wire.packing import clean

log = logging.getLogger(__name__)

PROPOSED_WITHIN = 30.0
"""Seconds after which the process that proposes is killed. A slow computer needs a few."""
GOOD_FOR = 600.0
"""Seconds for which a proposal may be written."""
_MOST_CHANGES = 64
_LONGEST_KEY = 128
_BY_HAND = (
    "this companion was not started by its service, whose helper writes the file: "
    "change settings in the shell, and start it again"
)


class PageRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the page asks: a proposal of `changes`, or to write the one that is named `write`.

    id: of the request. asked_from: the address of the browser, as the page's process says.
    """

    id: str
    asked_from: str
    changes: dict[str, Value] = {}
    write: str = ""


class _Kept(NamedTuple):
    """A proposal without a problem or a guarded key. until: monotonic seconds."""

    name: str
    changes: dict[str, Value]
    sha256: str
    until: float


class SettingsFromPage:
    """Does what the page asks, one request at a time. The main loop calls `poll` in every turn.

    tell: tells the page {"id", and "problem" or what became of it}. Times are monotonic seconds.
    """

    def __init__(
        self,
        config: Config,
        file: Path | None,
        change: FileChange | None,
        launch: Callable[[], ProposingChild] = ProposingChild,
    ) -> None:
        """config: in force. file: of it, None where there is none. change: None without root's helper."""
        self._config = config
        self._file = file
        self._change = change
        self._launch = launch
        self._waiting: PageRequest | None = None
        """Asked for since the last turn."""
        self._proposing: PageRequest | None = None
        self._writing = ""
        """The id of the request to write for which the helper works."""
        self._child: ProposingChild | None = None
        self._began = 0.0
        self._kept: _Kept | None = None
        self._started = secrets.token_hex(8)
        self._guard = ErrorGuard(lambda _now: None)
        self.tell: Callable[[Mapping[str, Any]], None] = lambda _content: None

    def document(self) -> dict[str, Any]:
        """Return what the page shows: file, rows of `all_settings`, and why none can be changed, or "".

        in_metres: whether the region of interest is computed. started: another text after each start.
        """
        file = "" if self._file is None else str(self._file.absolute())
        problem = "" if self._change is not None and file else _BY_HAND
        return {
            "file": file,
            "problem": problem,
            "rows": all_settings(self._config, {}),
            "in_metres": ground_region(self._config) is not None,
            "started": self._started,
        }

    def ask(self, content: Mapping[str, Any]) -> None:
        """Take what the page's process says. Raises ValueError for what is no request."""
        try:
            request = msgspec.convert(content, PageRequest)
        except (msgspec.ValidationError, RecursionError) as error:
            raise ValueError(str(error)) from error
        if not (request.id.isascii() and request.id.isalnum() and len(request.id) <= 32):
            raise ValueError("no id of a request")
        if self._waiting or self._proposing or self._writing:
            self._refuse(request, "another change is being looked at or made: wait for it")
        else:
            self._waiting = request

    def poll(self, vehicle: Vehicle | None, now: float) -> None:
        """Go on with what was asked for. vehicle: its newest state."""
        with self._guard.survived("settings from the page", now):
            request, self._waiting = self._waiting, None
            if request is not None:
                if problem := self._begin(request, vehicle, now):
                    self._refuse(request, problem)
            elif self._proposing is not None:
                self._hear(self._proposing, now)
            elif self._writing and self._change is not None:
                self._finish(self._change.answer(vehicle, now))
            if self._change is not None:
                self._change.watch(vehicle, now)

    def close(self) -> None:
        """Kill the process that proposes."""
        if self._child is not None:
            self._child.close()
        self._child = self._proposing = None

    def _begin(self, request: PageRequest, vehicle: Vehicle | None, now: float) -> str:
        """Begin what is asked for; return why not, or ""."""
        if self._change is None or self._file is None:
            return _BY_HAND
        if request.write:
            return self._write(request, self._change, vehicle, now)
        self._kept = None
        if problem := wrong_keys(request.changes):
            return problem
        try:
            asked = msgspec.json.encode(
                Asked(str(self._file.absolute()), request.changes, table_words(self._config, request.changes))
            )
            self._child = self._launch()
        except (ValueError, OverflowError):  # half of a character, or a number without end
            return "that is no value of a setting"
        except OSError as error:
            return f"it cannot be looked at: {(error.strerror or str(error)).lower()}"
        self._proposing, self._began = request, now
        if not self._child.send(asked):
            self.close()
            return "that is too much at once: change less, or in the shell"
        return ""

    def _write(self, request: PageRequest, change: FileChange, vehicle: Vehicle | None, now: float) -> str:
        kept = self._kept
        if request.changes or kept is None or kept.name != request.write or now >= kept.until:
            return "nothing was written: look again at what would change"
        if problem := change.ask(kept.changes, kept.sha256, clean(request.asked_from[:64]), vehicle, now):
            return problem
        log.info("settings are changed from the page: %s", ", ".join(kept.changes))
        self._writing = request.id
        return ""

    def _finish(self, answer: ConfigAnswer | None) -> None:
        """Tell what became of a change, once it is known."""
        if answer is not None:
            became = {"written": True, "restarts": answer.restarts, "text": answer.text}
            told = {"problem": "", **became} if answer.written else {"problem": answer.text}
            asked, self._writing, self._kept = self._writing, "", None  # also where telling fails
            self.tell({"id": asked, **told})

    def _hear(self, request: PageRequest, now: float) -> None:
        """Take what the process says of a proposal, and end one that takes too long."""
        assert self._child is not None
        why, said = "", list[bytes]()
        try:
            ended, said = self._child.ended(), self._child.receive()
            if not said and ended:
                why = f"the check of the file ended with {ended}: see the log"
        except OSError as error:
            why = f"the check of the file cannot be started: {(error.strerror or str(error)).lower()}"
        if not said and not why and now - self._began > PROPOSED_WITHIN:
            why = f"the check of the file took longer than {PROPOSED_WITHIN:.0f} s: is the disk well?"
        if not said and not why:
            return
        self.close()
        if why:
            self._refuse(request, why)
            return
        try:
            found = msgspec.json.decode(said[0], type=Proposed)
        except (msgspec.DecodeError, UnicodeDecodeError):
            self._refuse(request, "the check of the file said nonsense: see the log")
            return
        self._show(request, found, now)

    def _show(self, request: PageRequest, found: Proposed, now: float) -> None:
        if found.guarded:
            self._refuse(request, in_the_shell(found.guarded))
        elif found.problems:
            self.tell({"id": request.id, "problem": "the file would be refused", "problems": found.problems})
        elif not found.diff:
            self._refuse(request, "nothing would change: the file says so already")
        else:
            name = secrets.token_hex(8)
            self._kept = _Kept(name, request.changes, found.sha256, now + GOOD_FOR)
            self.tell({"id": request.id, "problem": "", "diff": found.diff, "proposal": name})

    def _refuse(self, request: PageRequest, why: str) -> None:
        self.tell({"id": request.id, "problem": clean(why)})


def wrong_keys(changes: Mapping[str, object]) -> str:
    """Say what may not be asked for on a page, before any file is read for it; "" where all may."""
    if not 0 < len(changes) <= _MOST_CHANGES:
        return f"{len(changes)} settings at once: from 1 to {_MOST_CHANGES} are taken"
    guarded = list[str]()
    for key, value in changes.items():
        if len(key) > _LONGEST_KEY:
            return f"{key[:16]}... is no setting"
        try:
            if guard_of(key, value) is Guard.LOOPBACK:
                guarded.append(key)
        except ValueError as error:
            return f"{key}: {error}"
    return in_the_shell(guarded) if guarded else ""


def in_the_shell(keys: list[str]) -> str:
    """Say that these are set in the shell only."""
    return f"only in the shell, by `companion config set`: {', '.join(keys)}"
