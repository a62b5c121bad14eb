"""Tells how often it called and held, what an operator gave for it, and where a human's mode won."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from companion.desk.evidence.drives import DecisionSample, DrivenFacts
from companion.desk.evidence.parts import (
    Basis,
    EvidenceFigure,
    EvidencePart,
    EvidenceTable,
    NotKnown,
    figures,
    spread,
    utc,
)
from companion.desk.evidence.sources import Sources
from companion.wire.call_report import CallReport

_SHORTEST_WAY = 100.0
"""Metres of recorded way below which nothing is told per kilometre."""
_OURS = 10.0
"""Seconds within which a mode that the companion commanded may show."""
_ANSWERS = frozenset({"applied", "applied_not_remembered", "not_covered"})
"""Results of answers that changed something."""
_AGAIN = 2.0
"""Seconds after a takeover in which a command of ours would override it."""


class CallTimes(NamedTuple):
    """A recorded call. opened: seconds since 1970. first: seconds to the first answer that counted."""

    opened: float
    first: float | None


def calls_part(sources: Sources) -> EvidencePart:
    """Describe calls, holds and takeovers."""
    driven, journal, unknown = sources.driven, sources.journal, list[NotKnown]()
    found: tuple[EvidenceFigure, ...] = ()
    tables = list[EvidenceTable]()
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
    answered = [one.first for one in calls if one.first is not None]
    found += figures(
        Basis("recordings", driven.files, driven.begin, driven.end),
        (
            ("time recorded", driven.seconds / 60.0, "min"),
            ("way driven", driven.metres, "m"),
            ("time in motion", driven.moved / 60.0, "min"),
            ("calls", len(calls), ""),
            ("calls answered", len(answered), ""),
        ),
    )
    found += spread("from call to first answer", answered, "s", basis)
    if driven.metres >= _SHORTEST_WAY:
        way = driven.metres / 1000.0
        found += figures(
            basis,
            (
                ("calls per km", len(calls) / way, "1/km"),
                ("operator's seconds per km", sum(answered) / way, "s/km"),
            ),
        )
    else:
        why = f"only {driven.metres:.0f} m are recorded, at least {_SHORTEST_WAY:.0f} are needed"
        unknown.append(
            NotKnown("calls and operator's seconds per kilometre", why, "drive on, and type this again")
        )
    found += _holds(driven)
    rows = [(utc(one.opened), one.first) for one in calls]
    if rows:
        tables.append(EvidenceTable.of("Calls in the recordings", ("opened", "first answer after, s"), rows))
    note = (
        "Operator's seconds: from a call until its first answer that counted, with the way of both by radio."
    )
    return EvidencePart("calls", "Calls and holds", found, tuple(tables), tuple(unknown), note)


def _of_journal(journal: Sequence[CallReport]) -> tuple[EvidenceFigure, ...]:
    closed = [one.closed for one in journal if one.closed is not None]
    basis = Basis("journal", len(journal), min(closed, default=None), max(closed, default=None))
    outcomes = Counter(one.outcome.name.lower().replace("_", " ") for one in journal)
    told: list[tuple[str, int, str]] = [("calls that are closed", len(journal), "")]
    told += [(f"closed: {outcome}", count, "") for outcome, count in sorted(outcomes.items())]
    waited = [
        one.answers[0].at - one.time
        for one in journal
        if one.answers and one.time is not None and one.answers[0].at is not None
    ]
    waited = [seconds for seconds in waited if seconds >= 0.0]  # the clock may have been set meanwhile
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
            found.append(CallTimes(one.at, None if at is None else at - one.at))
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
    events = Counter(str(one.content.get("event")) for one in moved)
    confirmed = [
        one.at - started[one.id]
        for one in moved
        if one.content.get("event") == "confirmed" and one.id in started and one.at >= started[one.id]
    ]
    taken = [one for one in moved if one.content.get("event") == "taken_over"]
    commands = [one for one in decisions if one.what == "set mode"]
    lost = sum(any(0.0 <= one.at - human.at <= _AGAIN for one in commands) for human in taken)
    by_others = sum(
        one.mode != before.mode and not _is_ours(one.at, one.mode, commands)
        for before, one in pairwise(driven.modes)
    )
    would = sum(one.what == "would hold" for one in decisions)
    basis = Basis("recordings", len(started), driven.begin, driven.end)
    told = figures(
        basis,
        (
            ("holds", len(started), ""),
            ("holds that shadow policy would have made", would, ""),
            ("holds that the autopilot did not take", events["failed"], ""),
            ("holds that ended by a go", events["resumed"], ""),
            ("holds that a human's mode ended", len(taken), ""),
            (f"of these, a mode of ours within {_AGAIN:g} s", lost, ""),
            ("changes of mode that the companion had not commanded", by_others, ""),
        ),
    )
    over = Basis("recordings", len(confirmed), driven.begin, driven.end)
    return told + spread("from order to hold until the autopilot shows it", confirmed, "s", over)


def _is_ours(at: float, mode: int, commands: Sequence[DecisionSample]) -> bool:
    return any(0.0 <= at - one.at <= _OURS and one.content.get("mode") == mode for one in commands)
