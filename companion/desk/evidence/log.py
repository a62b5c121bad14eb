"""Reads from the companion's log which faults stood, and when: also where nothing was recorded."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from anytraverse.regular_file import read_regular
from companion.daemon.health import RECOVERED_AFTER
from companion.storage.log_file import FOLDER, LONGEST, NAME

_LINE = re.compile(r"(\d{4}-\d\d-\d\d \d\d:\d\d:\d\d),(\d{3}) [A-Z]+ [\w.]+: (.*)", re.ASCII)
_FAULT = "fault: "
_AUTOPILOT = "autopilot silent"


class LoggedLine(NamedTuple):
    """A line of the log. at: seconds since 1970."""

    at: float
    text: str


class LoggedFault(NamedTuple):
    """A fault that stood. name: as the log has it, with its reason. over: when it was gone, None unknown."""

    at: float
    name: str
    over: float | None


@dataclass(frozen=True)
class LogFacts:
    """What the log tells. lines: of both files. trouble: why it could not be read.

    faults: in their order. starts: how often the companion became ready. unclean: how often it did so again
    without having been told to stop. open: whether it was not told to stop after the last one.
    """

    lines: tuple[LoggedLine, ...] = ()
    faults: tuple[LoggedFault, ...] = ()
    starts: int = 0
    unclean: int = 0
    open: bool = False
    trouble: str = ""

    @property
    def begin(self) -> float | None:
        """When the first line was written, None without one."""
        return self.lines[0].at if self.lines else None

    @property
    def end(self) -> float | None:
        """When the last line was written."""
        return self.lines[-1].at if self.lines else None

    def episodes(self, begins: str, ends: str) -> list[LoggedFault]:
        """Return what began with a line and ended with another: patterns. ends: "", a line stands alone."""
        found = list[LoggedFault]()
        since: float | None = None
        for at, text in self.lines:
            if re.search(begins, text):
                if not ends:
                    found.append(LoggedFault(at, text, None))
                elif since is None:
                    since = at
            elif since is not None and (_is_start(text) or re.search(ends, text)):
                found.append(LoggedFault(since, "", None if _is_start(text) else at))
                since = None
        return found if since is None else [*found, LoggedFault(since, "", None)]


def read_log(folder: Path) -> LogFacts:
    """Read the log in a companion's state folder, both files of it."""
    lines, trouble = list[LoggedLine](), ""
    for name in (f"{NAME}.1", NAME):
        try:
            content = read_regular(folder / FOLDER / name, 4 * LONGEST, follow=False)
        except FileNotFoundError:
            continue
        except OSError as error:
            trouble = f"{FOLDER}/{name}: {(error.strerror or str(error)).lower()}"
            continue
        lines += _lines(content.decode(errors="replace"))
    starts, unclean, began = 0, 0, False
    for _, text in lines:
        if _is_start(text):
            starts, unclean, began = starts + 1, unclean + began, True
        elif text == "told to stop, and stopped":
            began = False
    return LogFacts(tuple(lines), tuple(_faults(lines)), starts, unclean, began, trouble)


def _lines(content: str) -> Iterator[LoggedLine]:
    for line in content.splitlines():
        found = _LINE.fullmatch(line)
        if found is None:  # of a traceback, or torn
            continue
        try:
            at = time.mktime(time.strptime(found[1], "%Y-%m-%d %H:%M:%S")) + int(found[2]) / 1000.0
        except (ValueError, OverflowError):
            continue
        yield LoggedLine(at, found[3])


def _is_start(text: str) -> bool:
    return text.startswith("ready: policy ")


def _faults(lines: Iterable[LoggedLine]) -> Iterator[LoggedFault]:
    """Yield the faults. One that stands as the companion ends is not known to be over."""
    view: LoggedLine | None = None
    silent: LoggedLine | None = None
    for line in lines:
        text = line.text
        if text.startswith(_FAULT + _AUTOPILOT):
            silent = silent or LoggedLine(line.at, _AUTOPILOT)
        elif text.startswith(_FAULT):
            view = view or LoggedLine(line.at, text.removeprefix(_FAULT))
        elif text == "the fault is over" and view is not None:
            yield LoggedFault(view.at, view.text, max(view.at, line.at - RECOVERED_AFTER))
            view = None
        elif text == "the autopilot is heard again" and silent is not None:
            yield LoggedFault(silent.at, silent.text, line.at)
            silent = None
        elif _is_start(text):
            yield from (LoggedFault(one.at, one.text, None) for one in (view, silent) if one is not None)
            view = silent = None
    yield from (LoggedFault(one.at, one.text, None) for one in (view, silent) if one is not None)
