"""What is wrong with a configuration, as a person needs it to mend it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

_LONGEST_VALUE = 40


@dataclass(frozen=True)
class Problem:
    """One thing to mend. line: from 1, or None when the whole file is meant. key: "call.votes", may be empty.

    value: what stands there as Python has it, or None when that does not matter.
    """

    file: Path
    line: int | None
    key: str
    value: object
    reason: str

    def __str__(self) -> str:
        place = str(self.file) if self.line is None else f"{self.file}:{self.line}"
        value = "" if self.value is None else f" = {_short(self.value)}"
        return ": ".join(part for part in (place, f"{self.key}{value}", self.reason) if part)


class ConfigError(Exception):
    """A configuration that cannot be used: all its problems at once, one a line."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(str(problem) for problem in problems))


def _short(value: object) -> str:
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}..."
