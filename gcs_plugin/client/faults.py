"""Tells the faults of one call or hold in one line, however often they take turns. No I/O, no clock."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

MOST_NAMES = 6
MOST_SUBJECTS = 16
_FIGURE = re.compile(r"\d+(?:\.\d+)?", re.ASCII)
_FAULT = re.compile(r"([CH][0-9]{1,5}|Companion) FAULT:? (\S.*)", re.ASCII)


@dataclass
class _Told:
    since: float
    names: dict[str, str] = field(default_factory=dict)
    """By the name without its figures: "frame 1.4 s old" and "frame 1.5 s old" are one fault."""
    newest: str = ""
    times: int = 0


class FaultTally:
    """Counts how often the fault that a rover's texts name changed, for each call, hold, or none."""

    def __init__(self) -> None:
        self._by_subject: dict[str, _Told] = {}

    def take(self, text: str, now: float) -> tuple[str, str, bool] | None:
        """Take in a text. None for one that names no fault.

        Else returns whose fault it is ("H9"), the line ("H9 FAULT camera silent, vision hangs: 8 times in
        70 s", the text itself for one that came once), and whether it names a fault for the first time. A
        repeat of the text before is not counted: a fault that stays is told again and again, with other
        figures. Of more than `MOST_NAMES` faults the oldest is left out.
        """
        found = _FAULT.fullmatch(text)
        if found is None:
            return None
        subject, name = found[1], found[2]
        told = self._by_subject.setdefault(subject, _Told(now))
        while len(self._by_subject) > MOST_SUBJECTS:
            del self._by_subject[next(iter(self._by_subject))]
        kind = _FIGURE.sub("%", name)
        fresh = kind not in told.names
        told.names[kind] = name
        if len(told.names) > MOST_NAMES:
            del told.names[next(iter(told.names))]
        if kind != told.newest:
            told.newest, told.times = kind, told.times + 1
        if told.times == 1:
            return subject, text, fresh
        names = ", ".join(told.names.values())
        line = f"{subject} FAULT {names}: {told.times} times in {now - told.since:.0f} s"
        return subject, line, fresh

    def forget(self, subject: str) -> None:
        """Begin anew with this call, hold or "Companion": it is over, or its id is used again."""
        self._by_subject.pop(subject, None)
