"""What makes a parameter of the autopilot bad, and what is said of it. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from companion.check.finding import Verdict

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
