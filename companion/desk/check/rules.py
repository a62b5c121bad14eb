"""Defines the findings of checks, and the rules by which an autopilot's parameters are judged. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple


class Verdict(IntEnum):
    """Says how bad a finding is: the greater, the worse."""

    PASS = 0
    SKIP = 1
    """It could not be checked now; the text says why."""
    WARN = 2
    FAIL = 3


@dataclass(frozen=True)
class CheckFinding:
    """Holds one row of the table. text: what was found and, unless all is well, what to do."""

    check: str
    verdict: Verdict
    text: str

    def line(self, width: int) -> str:
        """Format the row for a person. width: characters of the column with the check's name."""
        return f"{self.verdict.name.lower():<5} {self.check:<{width}}  {self.text}"

    def row(self) -> dict[str, str]:
        """Return the row for JSON."""
        return {"check": self.check, "verdict": self.verdict.name.lower(), "text": self.text}


def passed(check: str, text: str) -> CheckFinding:
    """Make a finding that all is well."""
    return CheckFinding(check, Verdict.PASS, text)


def skipped(check: str, text: str) -> CheckFinding:
    """Make a finding of a check that was not possible now. The text says why, and how it is."""
    return CheckFinding(check, Verdict.SKIP, text)


def warned(check: str, text: str) -> CheckFinding:
    """Make a finding that a person should know of."""
    return CheckFinding(check, Verdict.WARN, text)


def failed(check: str, text: str) -> CheckFinding:
    """Make a finding with which the vehicle must not drive."""
    return CheckFinding(check, Verdict.FAIL, text)


FAIL, WARN = Verdict.FAIL, Verdict.WARN


@dataclass(frozen=True)
class Facts:
    """Holds what the rules need to know.

    values: of the parameters that the autopilot sent. system_id: the vehicle's. allowed: first and last
    system id of [link] allowed_senders. offboard: whether a PX4 is held by OFFBOARD. policy: [call] policy.
    deadman: whether the end of our stream of sticks shall stop a PX4.
    """

    values: Mapping[str, float]
    system_id: int = 1
    allowed: tuple[int, int] = (245, 255)
    offboard: bool = False
    policy: str = "hold"
    deadman: bool = False


Bad = Callable[[float, Facts], bool]


class ParameterRule(NamedTuple):
    """Names a parameter, the test for a bad value, how bad that is, and what to do."""

    name: str
    bad: Bad
    verdict: Verdict
    text: str


class Needed(NamedTuple):
    """Names a parameter that must exist if `other` is not 0 ("": always), and what its absence means."""

    name: str
    other: str
    text: str


class Table(NamedTuple):
    """Holds everything to read from one kind of autopilot, and how to judge it.

    always: of each of these groups every firmware version has one parameter, so that a missing answer is a
    finding. speeds: parameters of the speed of autonomous driving; the first that is above 0 counts.
    also: parameters on which rules depend. for_deadman: as always, needed only for `Facts.deadman`.
    """

    rules: tuple[ParameterRule, ...]
    needed: tuple[Needed, ...]
    always: tuple[tuple[str, ...], ...]
    speeds: tuple[str, ...]
    also: tuple[str, ...]
    for_deadman: tuple[tuple[str, ...], ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of all parameters to read."""
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
