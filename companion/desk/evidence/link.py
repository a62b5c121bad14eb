"""Tells who was heard on the link, with which gaps, and what was sent and lost."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from companion.desk.evidence.parts import (
    Basis,
    EvidenceFigure,
    EvidencePart,
    EvidenceTable,
    NotKnown,
    figures,
    spread,
)
from companion.desk.evidence.sources import Sources
from companion.vehicle import known_autopilot
from companion.wire.json_values import mapping_of, whole_of

_COUNTED = ("lost", "bad", "unsaid", "dropped_summaries")
_NAMES = {
    "lost": "frames that waited too long, or found the queue full",
    "bad": "broken frames received",
    "unsaid": "texts that were not sent",
    "dropped_summaries": "summaries left out, for the budget",
}
_MOST = 1e15


def link_part(sources: Sources) -> EvidencePart:
    """Describe the link."""
    found, unknown, tables = _heard(sources), list[NotKnown](), list[EvidenceTable]()
    if not found:
        unknown.append(
            NotKnown("which autopilot was heard", "nothing is recorded of one", "companion check, and drive")
        )
    runs = dict(sources.driven.statuses)
    pid = whole_of(sources.status.get("pid"), 1, 2**31)
    if pid is not None and sources.written is not None:
        runs[pid] = sources.written, sources.status
    links = [mapping_of(said.get("link")) for _, said in runs.values()]
    if links:
        times = [at for at, _ in runs.values()]
        basis = Basis("status, the last of each run", len(links), min(times), max(times))
        found += figures(basis, _sums(links))
        tables.append(EvidenceTable.of("Sent by budget", ("budget", "bytes"), _budgets(links)))
        refused = _refused(links)
        if refused:
            tables.append(EvidenceTable.of("Requests refused", ("why", "times"), refused))
    else:
        unknown.append(NotKnown("what was sent and lost", "no status is stored", "companion run"))
    unknown += (
        NotKnown(
            "messages received, and lost on the way by their sequence numbers",
            "the companion does not count them",
            "type link in MAVProxy beside it",
        ),
        NotKnown(
            "the link's round trip",
            "it is not stored; the part on calls has how long an order to hold took to show",
            "companion check --dry-run",
        ),
    )
    return EvidencePart("link", "Link", found, tuple(tables), tuple(unknown))


def _heard(sources: Sources) -> tuple[EvidenceFigure, ...]:
    driven = sources.driven
    basis = Basis("recordings", driven.files, driven.begin, driven.end)
    found = figures(basis, (("autopilot", _vehicle(one), "") for one in sorted(driven.vehicles)))
    if driven.senders:
        who = ", ".join(f"{system}/{component}" for system, component in sorted(driven.senders))
        found += figures(basis, [("who sent answers and settings", who, "")])
    gaps = [later - earlier for earlier, later in zip(driven.heard, driven.heard[1:], strict=False)]
    gaps = [gap for gap in gaps if gap > 0.0]  # the clock begins anew when the computer starts
    over = Basis("recordings", len(gaps), driven.begin, driven.end)
    return found + spread("between two heartbeats of the autopilot", gaps, "s", over)


def _vehicle(one: tuple[int, int, int]) -> str:
    system, autopilot, kind = one
    known = known_autopilot(autopilot, kind)
    name = known.name if known is not None else f"MAV_AUTOPILOT {autopilot}, MAV_TYPE {kind}"
    return f"system {system}, {name}"


def _sums(links: list[Mapping[str, Any]]) -> list[tuple[str, int, str]]:
    return [
        (_NAMES[name], sum(whole_of(one.get(name), 0, _MOST) or 0 for one in links), "") for name in _COUNTED
    ]


def _budgets(links: list[Mapping[str, Any]]) -> list[tuple[str, int]]:
    return _added(links, "sent")


def _refused(links: list[Mapping[str, Any]]) -> list[tuple[str, int]]:
    return _added(links, "rejected")


def _added(links: list[Mapping[str, Any]], name: str) -> list[tuple[str, int]]:
    totals = dict[str, int]()
    for one in links:
        for key, count in mapping_of(one.get(name)).items():
            totals[key] = totals.get(key, 0) + (whole_of(count, 0, _MOST) or 0)
    return sorted(totals.items())
