"""Tells how often it called and held, what an operator gave for it, and where a human's mode won."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from companion.desk.evidence.drives import DrivenFacts
from companion.desk.evidence.parts import Basis, EvidencePart, between
from companion.desk.evidence.sources import Sources
from companion.wire.call_report import CallReport

_SHORTEST_WAY = 100.0
"""Metres of recorded way below which nothing is told per kilometre."""
_ANSWERS = frozenset({"applied", "applied_not_remembered", "not_covered"})
"""Results of answers that changed something."""
_PER_KM = "calls and operator's seconds per kilometre"
_AGAIN = 2.0
"""Seconds after a takeover in which a command of ours would override it."""


class CallTimes(NamedTuple):
    """A recorded call. first: seconds to the first answer that counted, None where that is not known."""

    answered: bool
    first: float | None


def calls_part(sources: Sources) -> EvidencePart:
    """Describe calls, holds and takeovers."""
    part, driven = EvidencePart("Calls and holds"), sources.driven
    if sources.journal is None:
        part.lack("calls in the journal", sources.no_journal, "sudo companion evidence")
    else:
        _tell_journal(part, sources.journal)
    if driven.files:
        _tell_calls(part, driven)
        _tell_holds(part, driven)
        part.note = (
            "Operator's seconds: from a call until its first answer that counted, with the way of both by "
            "radio."
        )
    else:
        why = driven.trouble or "nothing is recorded"
        part.lack(_PER_KM, why, "companion config set recording.size=1000")
    return part


def _tell_journal(part: EvidencePart, journal: Sequence[CallReport]) -> None:
    closed = [one.closed for one in journal if one.closed is not None]
    basis = Basis("journal", len(journal), min(closed, default=None), max(closed, default=None))
    outcomes = Counter(one.outcome.name.lower().replace("_", " ") for one in journal)
    part.tell(basis, ("calls that are closed", len(journal), ""))
    part.tell(basis, *((f"closed: {outcome}", count, "") for outcome, count in sorted(outcomes.items())))
    waited = (between(one.time, one.answers[0].at) for one in journal if one.answers)
    part.tell_spread(basis, "from call to first answer, journal", _known(waited), "s")


def _tell_calls(part: EvidencePart, driven: DrivenFacts) -> None:
    calls = call_times(driven)
    waited = _known(one.first for one in calls)
    part.tell(
        driven.basis(driven.files),
        ("time recorded", driven.seconds / 60.0, "min"),
        ("way driven", driven.metres, "m"),
        ("time in motion", driven.moved / 60.0, "min"),
        ("calls", len(calls), ""),
        ("calls answered", sum(one.answered for one in calls), ""),
    )
    part.tell_spread(driven.basis(len(waited)), "from call to first answer", waited, "s")
    if driven.lacking:
        why = f"{driven.lacking} recordings between these were deleted, those without a call first"
        part.lack("calls per kilometre", why, "a larger recording.size")
    elif driven.metres < _SHORTEST_WAY:
        why = f"only {driven.metres:.0f} m are recorded, at least {_SHORTEST_WAY:.0f} are needed"
        part.lack(_PER_KM, why, "drive on, and type this again")
    else:
        way = driven.metres / 1000.0
        part.tell(
            driven.basis(len(calls)),
            ("calls per km", len(calls) / way, "1/km"),
            ("operator's seconds per km, of answered calls", sum(waited) / way, "s/km"),
        )


def call_times(driven: DrivenFacts) -> list[CallTimes]:
    """Return the calls that opened in the recordings, in their order."""
    counted = [one for one in driven.answers if one.result in _ANSWERS]
    closed = [one for one in driven.decisions if one.what == "call closed"]
    found = []
    for call in driven.decisions:
        if call.what == "call opened":
            ends = (one.at for one in closed if one.id == call.id and one.at >= call.at)
            until = next(ends, math.inf)
            answers = (one.at for one in counted if one.target == call.id and call.at <= one.at <= until)
            at = next(answers, None)
            found.append(CallTimes(at is not None, between(call.at, at)))
    return found


def _tell_holds(part: EvidencePart, driven: DrivenFacts) -> None:
    decisions = driven.decisions
    started = {one.id: one.at for one in decisions if one.what == "hold started"}
    moved = [one for one in decisions if one.what == "hold moved"]
    events = Counter(one.event for one in moved)
    taken = [one for one in moved if one.event == "taken_over"]
    commands = [one for one in decisions if one.what == "set mode"]
    lost = sum(any(0.0 <= one.at - human.at <= _AGAIN for one in commands) for human in taken)
    basis = driven.basis(len(started))
    part.tell(
        basis,
        ("holds", len(started), ""),
        ("holds that the autopilot did not take", events["failed"], ""),
        ("holds that ended by a go", events["resumed"], ""),
        ("holds that a human's mode ended", len(taken), ""),
        (f"of these, a mode of ours within {_AGAIN:g} s", lost, ""),
    )
    shown = (between(started.get(one.id), one.at) for one in moved if one.event == "confirmed")
    part.tell_spread(basis, "from order to hold until the autopilot shows it", _known(shown), "s")


def _known(spans: Iterable[float | None]) -> list[float]:
    return [seconds for seconds in spans if seconds is not None]
