"""Tells how often it called and held, what an operator gave for it, and where a human's mode won."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from companion.desk.evidence.drives import DecisionSample, DrivenFacts
from companion.desk.evidence.parts import (
    Basis,
    EvidenceFigure,
    EvidencePart,
    NotKnown,
    between,
    figures,
    spread,
)
from companion.desk.evidence.sources import Sources
from companion.wire.call_report import CallReport

_SHORTEST_WAY = 100.0
"""Metres of recorded way below which nothing is told per kilometre."""
_ANSWERS = frozenset({"applied", "applied_not_remembered", "not_covered"})
"""Results of answers that changed something."""
_AGAIN = 2.0
"""Seconds after a takeover in which a command of ours would override it."""


class CallTimes(NamedTuple):
    """A recorded call. first: seconds to the first answer that counted, None where that is not known."""

    answered: bool
    first: float | None


def calls_part(sources: Sources) -> EvidencePart:
    """Describe calls, holds and takeovers."""
    driven, journal, unknown = sources.driven, sources.journal, list[NotKnown]()
    found: tuple[EvidenceFigure, ...] = ()
    if journal is None:
        unknown.append(NotKnown("calls in the journal", sources.no_journal, "sudo companion evidence"))
    else:
        found = _of_journal(journal)
    if not driven.files:
        why = driven.trouble or "nothing is recorded"
        unknown.append(
            NotKnown(
                "calls and operator's seconds per kilometre", why, "companion config set recording.size=1000"
            )
        )
        return EvidencePart("calls", "Calls and holds", found, (), tuple(unknown))
    calls = call_times(driven)
    basis = Basis("recordings", len(calls), driven.begin, driven.end)
    waited = [one.first for one in calls if one.first is not None]
    found += figures(
        Basis("recordings", driven.files, driven.begin, driven.end),
        (
            ("time recorded", driven.seconds / 60.0, "min"),
            ("way driven", driven.metres, "m"),
            ("time in motion", driven.moved / 60.0, "min"),
            ("calls", len(calls), ""),
            ("calls answered", sum(one.answered for one in calls), ""),
        ),
    )
    found += spread("from call to first answer", waited, "s", basis._replace(samples=len(waited)))
    if driven.metres >= _SHORTEST_WAY and not driven.lacking:
        way = driven.metres / 1000.0
        found += figures(
            basis,
            (
                ("calls per km", len(calls) / way, "1/km"),
                ("operator's seconds per km, of answered calls", sum(waited) / way, "s/km"),
            ),
        )
    elif driven.lacking:
        why = f"{driven.lacking} recordings between these were deleted, those without a call first"
        unknown.append(NotKnown("calls per kilometre", why, "a larger recording.size"))
    else:
        why = f"only {driven.metres:.0f} m are recorded, at least {_SHORTEST_WAY:.0f} are needed"
        unknown.append(
            NotKnown("calls and operator's seconds per kilometre", why, "drive on, and type this again")
        )
    found += _holds(driven)
    note = (
        "Operator's seconds: from a call until its first answer that counted, with the way of both by radio."
    )
    return EvidencePart("calls", "Calls and holds", found, (), tuple(unknown), note)


def _of_journal(journal: Sequence[CallReport]) -> tuple[EvidenceFigure, ...]:
    closed = [one.closed for one in journal if one.closed is not None]
    basis = Basis("journal", len(journal), min(closed, default=None), max(closed, default=None))
    outcomes = Counter(one.outcome.name.lower().replace("_", " ") for one in journal)
    told: list[tuple[str, int, str]] = [("calls that are closed", len(journal), "")]
    told += [(f"closed: {outcome}", count, "") for outcome, count in sorted(outcomes.items())]
    spans = (between(one.time, one.answers[0].at) for one in journal if one.answers)
    waited = [seconds for seconds in spans if seconds is not None]
    over = basis._replace(samples=len(waited))
    return figures(basis, told) + spread("from call to first answer, journal", waited, "s", over)


def call_times(driven: DrivenFacts) -> list[CallTimes]:
    """Return the calls that opened in the recordings, in their order."""
    answers = [one for one in driven.answers if one.result in _ANSWERS]
    found = []
    for one in driven.decisions:
        if one.what == "call opened":
            until = _closed_at(driven.decisions, one)
            at = next(
                (each.at for each in answers if each.target == one.id and one.at <= each.at <= until), None
            )
            found.append(CallTimes(at is not None, between(one.at, at)))
    return found


def _closed_at(decisions: Sequence[DecisionSample], opened: DecisionSample) -> float:
    closed = (
        one.at
        for one in decisions
        if one.what == "call closed" and one.id == opened.id and one.at >= opened.at
    )
    return next(closed, float("inf"))


def _holds(driven: DrivenFacts) -> tuple[EvidenceFigure, ...]:
    decisions = driven.decisions
    started = {one.id: one.at for one in decisions if one.what == "hold started"}
    moved = [one for one in decisions if one.what == "hold moved"]
    events = Counter(one.event for one in moved)
    spans = (between(started.get(one.id), one.at) for one in moved if one.event == "confirmed")
    confirmed = [seconds for seconds in spans if seconds is not None]
    taken = [one for one in moved if one.event == "taken_over"]
    commands = [one for one in decisions if one.what == "set mode"]
    lost = sum(any(0.0 <= one.at - human.at <= _AGAIN for one in commands) for human in taken)
    basis = Basis("recordings", len(started), driven.begin, driven.end)
    told = figures(
        basis,
        (
            ("holds", len(started), ""),
            ("holds that the autopilot did not take", events["failed"], ""),
            ("holds that ended by a go", events["resumed"], ""),
            ("holds that a human's mode ended", len(taken), ""),
            (f"of these, a mode of ours within {_AGAIN:g} s", lost, ""),
        ),
    )
    over = Basis("recordings", len(confirmed), driven.begin, driven.end)
    return told + spread("from order to hold until the autopilot shows it", confirmed, "s", over)
