"""Drives past one unknown thing after the other, and records what became of the calls for them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from bench.link.operator import Operator, expired
from bench.link.rover import CountedCalls, Rover
from companion.wire.answers import Answer
from companion.wire.ids import Result

PATIENCE = 600.0
"""s after which a call counts as lost."""
_GAP = 1.0
"""s that a thing stays in view after its call is closed."""
_COUNTS = (Result.APPLIED, Result.APPLIED_NOT_REMEMBERED)


@dataclass
class DriveOutcome:
    """What became of `calls` calls.

    lost: not answered, or the operator never knew. twice: more than one answer counted. anew: answers that
    the operator gave again after 60 s without a reply. The lists are in s since a call was opened on the
    rover. told: until the operator knew of it. answered: until an answer counted. known: until the operator
    knew that.
    """

    calls: int = 0
    lost: int = 0
    twice: int = 0
    anew: int = 0
    told: list[float] = field(default_factory=list)
    answered: list[float] = field(default_factory=list)
    known: list[float] = field(default_factory=list)

    @property
    def good(self) -> bool:
        """Whether every call was answered exactly once, and the operator knows it."""
        return self.calls > 0 and self.lost == self.twice == 0

    def __str__(self) -> str:
        told = f"{self.calls} calls, {self.lost} lost, {self.twice} answered twice, {self.anew} answered anew"
        for name, times in (("told", self.told), ("answered", self.answered), ("known", self.known)):
            told += f"; {name} p50 {at(times, 0.5)} s, p99 {at(times, 0.99)} s"
        return told

    def figures(self) -> dict[str, Any]:
        """Returns the figures for the report."""
        counted = {"calls": self.calls, "lost": self.lost, "twice": self.twice, "anew": self.anew}
        times = {"told": self.told, "answered": self.answered, "known": self.known}
        return {
            **counted,
            **{f"{name}_s": {"p50": at(all_, 0.5), "p99": at(all_, 0.99)} for name, all_ in times.items()},
        }


def at(values: Iterable[float], share: float) -> float | None:
    """Returns the smallest value that a `share` of the values do not exceed (a quantile)."""
    ordered = sorted(values)
    if not ordered:
        return None
    return round(ordered[max(0, -int(-share * len(ordered) // 1) - 1)], 2)


def drive(rover: Rover, operator: Operator, calls: int, step: Callable[[], None]) -> DriveOutcome:
    """Drives past things 1 to `calls`; `step` lets a moment pass at both ends."""
    outcome = DriveOutcome()
    for number in range(1, calls + 1):
        _wait(step, lambda: rover.clear and bool(operator.client.rovers))
        rover.shows = number
        _wait(step, lambda: rover.calls.call is not None)
        call = rover.calls.call
        if call is None:
            outcome.lost += 1
            continue
        current = call.id
        closed = _wait(step, lambda: rover.calls.current_id != current)  # noqa: B023
        _let(step, _GAP)
        rover.shows = 0
        knows = _wait(step, lambda: operator.settled(current))  # noqa: B023
        outcome.calls += 1
        _count(outcome, rover.calls, operator, current, call.opened_at, whole=closed and knows)
    outcome.twice += _taught_twice(rover)
    return outcome


def _count(
    outcome: DriveOutcome, calls: CountedCalls, operator: Operator, number: int, opened: float, *, whole: bool
) -> None:
    applied = [one for one in calls.applied if one.target == number and one.result in _COUNTS]
    known = operator.calls.get(number)
    outcome.twice += len(applied) > 1
    if known is None or known.answered_at is None or not applied or not whole:
        outcome.lost += 1
        return
    outcome.anew += expired(known)
    outcome.told.append(known.heard_at - opened)
    outcome.answered.append(applied[0].at - opened)
    outcome.known.append(known.answered_at - opened)


def _taught_twice(rover: Rover) -> int:
    """Counts the answers with words that reached the vision process more than once."""
    requests = [getattr(token, "answer", None) for token in rover.vision.asked]
    asked = [one.transaction for one in requests if isinstance(one, Answer)]
    return len(asked) - len(set(asked))


def _wait(step: Callable[[], None], fits: Callable[[], bool]) -> bool:
    """Waits `PATIENCE` s at most for a condition; returns whether it became true."""
    until = time.monotonic() + PATIENCE
    while not fits():
        if time.monotonic() > until:
            return False
        step()
    return True


def _let(step: Callable[[], None], seconds: float) -> None:
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        step()
