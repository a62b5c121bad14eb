"""What a check found."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Verdict(IntEnum):
    """The greater, the worse."""

    PASS = 0
    WARN = 1
    FAIL = 2


@dataclass(frozen=True)
class Finding:
    """One row of the table. text: what was found and, unless all is well, what to do."""

    check: str
    verdict: Verdict
    text: str

    def line(self, width: int) -> str:
        """As a person reads it; width: of the column with the check's name."""
        return f"{self.verdict.name.lower():<5} {self.check:<{width}}  {self.text}"

    def row(self) -> dict[str, str]:
        """As a program reads it."""
        return {"check": self.check, "verdict": self.verdict.name.lower(), "text": self.text}


def passed(check: str, text: str) -> Finding:
    """All is well."""
    return Finding(check, Verdict.PASS, text)


def warned(check: str, text: str) -> Finding:
    """Worth knowing."""
    return Finding(check, Verdict.WARN, text)


def failed(check: str, text: str) -> Finding:
    """Do not drive like this."""
    return Finding(check, Verdict.FAIL, text)
