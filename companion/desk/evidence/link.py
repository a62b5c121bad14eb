"""Tells which autopilot was heard on the link, and with which gaps."""

from __future__ import annotations

from companion.desk.evidence.parts import Basis, EvidencePart, NotKnown, figures, spread
from companion.desk.evidence.sources import Sources
from companion.vehicle import known_autopilot


def link_part(sources: Sources) -> EvidencePart:
    """Describe the link."""
    driven = sources.driven
    basis = Basis("recordings", driven.files, driven.begin, driven.end)
    found = figures(basis, (("autopilot", _vehicle(one), "") for one in sorted(driven.vehicles)))
    over = basis._replace(samples=len(driven.gaps))
    found += spread("between two heartbeats of the autopilot, in one recording", driven.gaps, "s", over)
    unknown = [
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
    ]
    if not found:
        unknown.insert(
            0,
            NotKnown("which autopilot was heard", "nothing is recorded of one", "companion check, and drive"),
        )
    return EvidencePart("link", "Link", found, (), tuple(unknown))


def _vehicle(one: tuple[int, int, int]) -> str:
    system, autopilot, kind = one
    known = known_autopilot(autopilot, kind)
    name = known.name if known is not None else f"MAV_AUTOPILOT {autopilot}, MAV_TYPE {kind}"
    return f"system {system}, {name}"
