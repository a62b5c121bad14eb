"""Reads from the companion's log which faults stood, and when: also where nothing was recorded."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from anytraverse.regular_file import read_regular
from companion.daemon.health import RECOVERED_AFTER
from companion.storage.log_file import FOLDER, LONGEST, NAME

_LINE = re.compile(r"(\d{4}-\d\d-\d\d \d\d:\d\d:\d\d),(\d{3}) [A-Z]+ [\w.]+: (.*)", re.ASCII)


class LoggedLine(NamedTuple):
    """A line of the log. at: seconds since 1970."""

    at: float
    text: str


class LoggedFault(NamedTuple):
    """A fault that stood. text: the line that began it. over: when it was gone, None where that is not known.

    Times are seconds since 1970.
    """

    at: float
    text: str
    over: float | None = None


@dataclass(frozen=True)
class LogFacts:
    """What the log tells. lines: of both files. trouble: why it could not be read.

    starts: how often the companion became ready. unclean: how often it did so again without having been told
    to stop. open: whether it was not told to stop after the last one.
    """

    lines: tuple[LoggedLine, ...] = ()
    starts: int = 0
    unclean: int = 0
    open: bool = False
    trouble: str = ""

    def faults(self) -> list[LoggedFault]:
        """Return all faults, those of the autopilot's silence last."""
        view = self.episodes("^fault: (?!autopilot silent)", "^the fault is over$")
        silent = self.episodes("^fault: autopilot silent", "^the autopilot is heard again$")
        return [*map(_until_recovered, view), *silent]

    def episodes(self, begins: str, ends: str) -> list[LoggedFault]:
        """Return what began with a line and ended with another: patterns. ends: "", a line stands alone.

        What stands as the companion ends is not known to be over.
        """
        found, stands = list[LoggedFault](), False
        for at, text in self.lines:
            if re.search(begins, text):
                if not stands:
                    found.append(LoggedFault(at, text))
                    stands = bool(ends)
            elif stands and _is_start(text):
                stands = False
            elif stands and re.search(ends, text):
                found[-1] = found[-1]._replace(over=at)
                stands = False
        return found


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
    return LogFacts(tuple(lines), starts, unclean, began, trouble)


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


def _until_recovered(fault: LoggedFault) -> LoggedFault:
    """Take off the time for which pictures must have been good again: the fault was gone before that."""
    over = None if fault.over is None else max(fault.at, fault.over - RECOVERED_AFTER)
    return fault._replace(over=over)
