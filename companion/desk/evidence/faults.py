"""Says which faults of docs/faults.md were seen on this rover, beside their limits, and which never were."""

from __future__ import annotations

import re
from bisect import bisect_right
from typing import NamedTuple

from companion.desk.evidence.log import LoggedFault
from companion.desk.evidence.parts import Basis, EvidencePart, EvidenceTable, NotKnown, figures, utc
from companion.desk.evidence.sources import Sources

_BEFORE = 60.0
"""Seconds before a fault in which its last good frame is looked for."""


class FaultKind(NamedTuple):
    """Some rows of docs/faults.md that a rover's log cannot tell apart.

    name: for a person. rows: of docs/faults.md. logged: what its line in the log looks like, less "fault: ".
    ends: the line that ends it, "" where none does, None for a fault that the log itself pairs.
    noticed, back: limits there, s; None without one.
    """

    name: str
    rows: tuple[str, ...]
    logged: str
    noticed: float | None = None
    back: float | None = None
    ends: str | None = None


FAULTS = (
    FaultKind(
        "no pictures from the camera",
        ("camera absent at boot", "camera unplugged while driving", "camera silent"),
        r"camera (silent|failed|ended)",
        2.0,
        10.0,
    ),
    FaultKind(
        "camera frozen",
        ("camera frozen", "camera frozen, with a clock in the picture"),
        r"camera frozen",
        2.0,
        10.0,
    ),
    FaultKind(
        "picture black, or badly exposed",
        ("camera black",),
        r"(the )?picture (is )?(black|underexposed|overexposed)",
        2.0,
        10.0,
    ),
    FaultKind(
        "frames too old",
        ("camera slow", "frames judged too slowly"),
        r"the frame is [0-9.]+ s (old|ahead)|no fresh frame",
        7.0,
        15.0,
    ),
    FaultKind("vision hangs", ("vision hung", "vision hung in native code"), r"vision hangs", 2.0, 12.0),
    FaultKind(
        "vision died",
        ("vision segfault, again and again", "vision out of memory: killed"),
        r"vision died",
        2.0,
        12.0,
    ),
    FaultKind(
        "maps that are no maps",
        ("maps of NaN", "maps or embedding of a wrong shape"),
        r"(pooled|attention) maps |scene not comparable",
        2.0,
        12.0,
    ),
    FaultKind(
        "drives where the camera does not look",
        ("drives backwards in AUTO",),
        r"drives (backwards|out of view)",
        3.0,
        12.0,
    ),
    FaultKind(
        "autopilot silent", ("companion does not hear the autopilot",), r"autopilot silent", None, 12.0
    ),
    FaultKind("link lost", ("link lost",), r"^link\b.* lost: ", None, 12.0, r"^link is back$"),
    FaultKind(
        "main loop stopped", ("main loop stopped",), r"^the companion was stalled for ", None, None, ""
    ),
    FaultKind(
        "the disk is not written",
        ("slow disk", "disk full", "disk becomes read-only", "disk hangs in a write"),
        r" cannot be written: |^the disk fails or hangs",
        None,
        12.0,
        r" is written again$",
    ),
    FaultKind(
        "recorder died or hangs",
        ("recorder killed", "recorder hangs"),
        r"^the recorder .*; it is started again in",
        None,
        15.0,
        r"^recording into ",
    ),
)
"""In the order of docs/faults.md."""


def faults_part(sources: Sources) -> EvidencePart:
    """List what was seen, and what never was."""
    logged, driven = sources.logged, sources.driven
    basis = Basis("log", len(logged.lines), logged.begin, logged.end)
    if not logged.lines:
        why = logged.trouble or "there is no log"
        lacking = NotKnown("which faults were seen", why, "companion run, and drive")
        return EvidencePart("faults", "Faults", unknown=(lacking,))
    summed, each = list[tuple[str | float | int | None, ...]](), list[tuple[str | float | None, ...]]()
    known = 0
    for kind in FAULTS:
        seen = _seen(sources, kind)
        known += len(seen) if kind.ends is None else 0
        rows = [
            (one, _noticed(sources, one) if kind.noticed is not None else None, _stood(one)) for one in seen
        ]
        summed.append(
            (
                kind.name,
                len(seen) or "never",
                max((one for _, one, _ in rows if one is not None), default=None),
                kind.noticed,
                max((one for _, _, one in rows if one is not None), default=None),
                kind.back,
                "; ".join(kind.rows),
            )
        )
        each += [(utc(one.at), kind.name, noticed, stood) for one, noticed, stood in rows]
    others = len(logged.faults) - known
    unclean = max(0, len(logged.starts) - logged.stops - sources.running)
    found = figures(
        basis,
        (
            ("faults of other kinds", others, ""),
            ("starts of the companion", len(logged.starts), ""),
            ("ends without being told to stop: killed, crashed, or without power", unclean, ""),
            ("reboots of the autopilot while it was recorded", driven.reboots if driven.files else None, ""),
        ),
    )
    columns = (
        "fault",
        "seen",
        "noticed, at most, s",
        "limit, s",
        "stood, at most, s",
        "limit from its end to well, s",
        "rows of docs/faults.md",
    )
    tables = (
        EvidenceTable.of("Kinds of faults", columns, summed),
        EvidenceTable.of("Each fault", ("at", "fault", "noticed, s", "stood, s"), sorted(each, key=str)),
    )
    unknown = (
        NotKnown(
            "what the autopilot's script did while the companion was dead or not heard",
            "the companion cannot have seen it",
            "read the autopilot's own log",
        ),
        NotKnown(
            "the other rows of docs/faults.md",
            "a rover's log does not show them",
            "make faults, in simulation, or read what is known of them there",
        ),
    )
    note = (
        "Noticed: from the capture of the last frame that was judged well to the line in the log; empty "
        "where that was not recorded. Stood: until the log says that it is over, with the time in which its "
        "cause lasted. What is never seen was not tried on this rover, and is not proven on it."
    )
    return EvidencePart("faults", "Faults", found, tables, unknown, note)


def _seen(sources: Sources, kind: FaultKind) -> list[LoggedFault]:
    if kind.ends is not None:
        return sources.logged.episodes(kind.logged, kind.ends)
    return [one for one in sources.logged.faults if re.match(kind.logged, one.name)]


def _stood(fault: LoggedFault) -> float | None:
    return None if fault.over is None else fault.over - fault.at


def _noticed(sources: Sources, fault: LoggedFault) -> float | None:
    """Return the seconds from the last good frame's capture to the fault; None where none is recorded."""
    driven = sources.driven
    since = max((one for one in sources.logged.starts if one <= fault.at), default=0.0)
    since = max(since, fault.at - _BEFORE)
    for number in range(bisect_right(driven.judged, fault.at) - 1, -1, -1):
        captured = driven.judged[number]
        if captured < since:
            return None
        # What was judged only after the fault was not known by then.
        if not driven.faulty[number] and captured + driven.ages[number] <= fault.at:
            return fault.at - captured
    return None
