"""Reads the recordings that the page shows: which there are, and what was so at a moment of one.

No name comes from a client: files are found by their numbers. It is called by one thread at a time. What it
reads at once is bounded, and so is for how long.
"""

from __future__ import annotations

import os
import time
from collections import OrderedDict
from collections.abc import Callable, Hashable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Generic, TypeVar

from anytraverse.regular_file import open_regular
from companion.observers.recording.ring import FOLDER, RecordingFile, name_of, recordings

if TYPE_CHECKING:
    from mcap.summary import Summary as Index

    from companion.observers.recording.listing import Listed
    from companion.observers.recording.moment import Moments

    _Look = Callable[[Path, Callable[[], object]], Listed]

PAGE = 20
"""Recordings that are listed at once."""
BEGUN_WITHIN, _ONE_WITHIN = 0.8, 1.0
"""Seconds within which looking into recordings is begun, and those for one of them. The others are told of
when it is asked again."""
_AGAIN = 60.0
"""Seconds for which one that took too long is left alone."""
SHOWN_WITHIN = 3.0
"""Seconds for a moment of one."""
_MOST_KNOWN, _MOST_INDEXES = 512, 4
_NS, _MS = 1_000_000_000, 1_000_000
_T = TypeVar("_T")


class _Kept(Generic[_T]):
    """Keeps what was found last, for files that have not changed since."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._found = OrderedDict[Hashable, _T]()

    def __contains__(self, key: Hashable) -> bool:
        return key in self._found

    def get(self, key: Hashable, find: Callable[[], _T]) -> _T:
        if key not in self._found:
            self._found[key] = find()
            if len(self._found) > self._most:
                self._found.popitem(last=False)
        self._found.move_to_end(key)
        return self._found[key]


class RecordingsFolder:
    """Reads the recordings of the daemon's state folder. Each method waits for the disk, and raises OSError,
    TimeoutError where it takes too long, and ImportError without the extra `record`.
    """

    def __init__(self, folder: str, clock: Callable[[], float] = time.monotonic) -> None:
        """clock: monotonic seconds."""
        self._folder = Path(folder, FOLDER)
        self._clock = clock
        self._known: _Kept[Listed] = _Kept(_MOST_KNOWN)
        self._indexes: _Kept[Index] = _Kept(_MOST_INDEXES)
        self._late: dict[Hashable, float] = {}
        """Those that took too long, and when they are tried again."""

    def shown(self, before: int, *, on: bool) -> dict[str, Any]:
        """List the newest recordings, the newest first, and how many there are.

        before: only those up to this number. on: whether it is being recorded.
        """
        from companion.observers.recording.listing import listed

        until = self._clock() + BEGUN_WITHIN
        found = recordings(self._folder)
        older = [one for one in reversed(found) if one.number <= before]
        return {
            "files": len(found),
            "bytes": sum(one.size for one in found),
            "older": len(older) > PAGE,
            "recordings": [self._row(one, on and one is found[-1], until, listed) for one in older[:PAGE]],
        }

    def moment(self, number: int, at: int) -> dict[str, Any]:
        """Tell what was so at a moment. at: ms since the recording's begin."""
        return self._of(number, lambda moments: moments.moment(at))

    def frame(self, number: int, at: int) -> bytes:
        """Return the picture at a moment, as JPEG. Raises FileNotFoundError where there is none."""
        if not (found := self._of(number, lambda moments: moments.frame(at))):
            raise FileNotFoundError
        return found

    def file(self, number: int) -> tuple[str, BinaryIO]:
        """Open a recording. Returns its name, too."""
        for event in (True, False):
            name = name_of(number, event=event)
            with suppress(FileNotFoundError):
                return name, open(open_regular(self._folder / name, follow=False), "rb", buffering=0)
        raise FileNotFoundError(number)

    def _of(self, number: int, ask: Callable[[Moments], _T]) -> _T:
        """Ask about the moments of a recording. Raises FileNotFoundError where nothing in it can be read."""
        from companion.observers.recording.index import index_of
        from companion.observers.recording.moment import Moments
        from companion.observers.recording.seeking import Seeker

        check = self._until(self._clock() + SHOWN_WITHIN)
        _, raw = self.file(number)
        with os.fdopen(os.dup(raw.fileno()), "rb") as file, raw:
            index = self._indexes.get(_key(number, raw), lambda: index_of(file, check))
            if index.statistics is None:
                raise FileNotFoundError(number)
            return ask(Moments(Seeker(file, index, check), index.statistics.message_start_time))

    def _row(self, one: RecordingFile, writing: bool, until: float, look: _Look) -> dict[str, Any]:
        """Tell of one recording, as far as the time reaches."""
        row: dict[str, Any] = {"number": one.number, "name": one.name, "bytes": one.size, "writing": False}
        try:
            return row | _row_of(self._listed(one, until, look), writing)
        except (TimeoutError, FileNotFoundError):  # it has been renamed or deleted since it was listed
            return row | {"unread": True}
        except OSError as error:
            return row | {"trouble": f"it cannot be read: {(error.strerror or str(error)).lower()}"}
        except MemoryError:
            return row | {"trouble": "it cannot be read: it needs too much memory"}

    def _listed(self, one: RecordingFile, until: float, look: _Look) -> Listed:
        """Look into a recording. Raises OSError, TimeoutError where that has to wait for the next time."""
        path, now = self._folder / one.name, self._clock()
        with self.file(one.number)[1] as file:
            key = _key(one.number, file)
        if self._late.get(key, now) > now:
            raise OSError("that takes too long; it is tried again within a minute")
        if now >= until and key not in self._known:
            raise TimeoutError
        check = self._until(now + _ONE_WITHIN)
        try:
            return self._known.get(key, lambda: look(path, check))
        except TimeoutError:
            self._late = {one: at for one, at in self._late.items() if at > now} | {key: now + _AGAIN}
            raise

    def _until(self, until: float) -> Callable[[], None]:
        def check() -> None:
            if self._clock() > until:
                raise TimeoutError("it takes too long to look that up")

        return check


def _key(number: int, file: BinaryIO) -> Hashable:
    """Return what changes whenever a file does."""
    told = os.fstat(file.fileno())
    return number, told.st_ino, told.st_size, told.st_mtime_ns


def _row_of(found: Listed, writing: bool) -> dict[str, Any]:
    """Tell what a recording holds. Times of what happened are in ms since its begin."""
    trouble = ""
    if not found.begin:
        trouble = "nothing in it can be read"
    elif not found.finished and not writing:
        trouble = "it was cut off: what is whole in it is shown"
    return {
        "writing": writing and not found.finished,
        "begin": found.begin / _NS if found.begin else None,
        "seconds": round((found.end - found.begin) / _NS, 1),
        "frames": found.frames,
        "events": [
            {"at": max(0, (one.at - found.begin) // _MS), "what": one.what, "id": one.id}
            for one in found.happened
        ],
        "more": found.more,
        "trouble": "" if writing and not found.finished else trouble,
    }
