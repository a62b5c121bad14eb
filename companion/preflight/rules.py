"""What a check found, and what makes a parameter of the autopilot bad. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple


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


FAIL, WARN = Verdict.FAIL, Verdict.WARN


@dataclass(frozen=True)
class Facts:
    """values: of the parameters that are there. system_id: the vehicle's. allowed: first and last sender.

    offboard: whether a PX4 is held by OFFBOARD. policy: the companion's, [call] policy.
    """

    values: Mapping[str, float]
    system_id: int = 1
    allowed: tuple[int, int] = (245, 255)
    offboard: bool = False
    policy: str = "hold"


Bad = Callable[[float, Facts], bool]


class Rule(NamedTuple):
    """A parameter, when it is bad where it is there, how bad, and what to do."""

    name: str
    bad: Bad
    verdict: Verdict
    text: str


class Needed(NamedTuple):
    """A parameter that must be there where `other` is not 0, and what its absence means."""

    name: str
    other: str
    text: str


class Table(NamedTuple):
    """All that is asked of one kind of autopilot.

    always: every version has one of each of these, so that silence is no answer. speeds: names of what says
    how fast it drives by itself, the first that is above 0 counts. also: asked for what others depend on.
    """

    rules: tuple[Rule, ...]
    needed: tuple[Needed, ...]
    always: tuple[tuple[str, ...], ...]
    speeds: tuple[str, ...]
    also: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """What to ask for."""
        judged = [rule.name for rule in self.rules] + [one.name for one in self.needed]
        return tuple(dict.fromkeys((*judged, *self.speeds, *self.also)))


def one_of(*bad: float) -> Bad:
    return lambda value, _: value in bad


def other_than(*good: float) -> Bad:
    return lambda value, _: value not in good


def below(least: float) -> Bad:
    return lambda value, _: value < least


def above(most: float) -> Bad:
    return lambda value, _: value > most


def with_bit(bit: int) -> Bad:
    return lambda value, _: int(value) & bit != 0


def without_bits(bits: int) -> Bad:
    return lambda value, _: int(value) & bits != bits


DIES = "nothing stops the vehicle when the companion dies"
HOME = "drives the vehicle home, and over that the companion never holds"
