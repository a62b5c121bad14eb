"""Tells which autopilot was heard on the link, and with which gaps."""

from __future__ import annotations

from companion.desk.evidence.parts import EvidencePart
from companion.desk.evidence.sources import Sources
from companion.vehicle import known_autopilot


def link_part(sources: Sources) -> EvidencePart:
    """Describe the link."""
    part, driven = EvidencePart("Link"), sources.driven
    basis = driven.basis(driven.files)
    part.tell(basis, *(("autopilot", _vehicle(*one), "") for one in sorted(driven.vehicles)))
    part.tell_spread(basis, "between two heartbeats of the autopilot, in one recording", driven.gaps, "s")
    if not part.figures:
        part.lack("which autopilot was heard", "nothing is recorded of one", "companion check, and drive")
    part.lack(
        "messages received, and lost on the way by their sequence numbers",
        "the companion does not count them",
        "type link in MAVProxy beside it",
    )
    part.lack(
        "the link's round trip",
        "it is not stored; the part on calls has how long an order to hold took to show",
        "companion check --dry-run",
    )
    return part


def _vehicle(system: int, autopilot: int, kind: int) -> str:
    known = known_autopilot(autopilot, kind)
    name = known.name if known is not None else f"MAV_AUTOPILOT {autopilot}, MAV_TYPE {kind}"
    return f"system {system}, {name}"
