"""Says which faults of docs/faults.md this rover's log has, and which it does not have."""

from __future__ import annotations

import re
from typing import NamedTuple

from companion.desk.evidence.parts import Basis, EvidencePart, Value, between, utc
from companion.desk.evidence.sources import Sources


class FaultKind(NamedTuple):
    """Some rows of docs/faults.md that a rover's log cannot tell apart.

    name: for a person. rows: of docs/faults.md. logged: what its line in the log looks like, less "fault: ".
    ends: the line that ends it, "" where none does, None for a fault that the log itself pairs.
    """

    name: str
    rows: tuple[str, ...]
    logged: str
    ends: str | None = None


FAULTS = (
    FaultKind(
        "no pictures from the camera",
        ("camera absent at boot", "camera unplugged while driving", "camera silent"),
        r"camera (silent|failed|ended)",
    ),
    FaultKind(
        "camera frozen", ("camera frozen", "camera frozen, with a clock in the picture"), r"camera frozen"
    ),
    FaultKind(
        "picture black, or badly exposed",
        ("camera black",),
        r"(the )?picture (is )?(black|underexposed|overexposed)",
    ),
    FaultKind(
        "frames too old",
        ("camera slow", "frames judged too slowly"),
        r"the frame is [0-9.]+ s (old|ahead)|no fresh frame",
    ),
    FaultKind("vision hangs", ("vision hung", "vision hung in native code"), r"vision hangs"),
    FaultKind(
        "vision died", ("vision segfault, again and again", "vision out of memory: killed"), r"vision died"
    ),
    FaultKind(
        "maps that are no maps",
        ("maps of NaN", "maps or embedding of a wrong shape"),
        r"(pooled|attention) maps |scene not comparable",
    ),
    FaultKind(
        "drives where the camera does not look",
        ("drives backwards in AUTO",),
        r"drives (backwards|out of view)",
    ),
    FaultKind("autopilot silent", ("companion does not hear the autopilot",), r"autopilot silent"),
    FaultKind("link lost", ("link lost",), r"^link\b.* lost: ", r"^link is back$"),
    FaultKind("main loop stopped", ("main loop stopped",), r"^the companion was stalled for ", ""),
    FaultKind(
        "the disk is not written",
        ("slow disk", "disk full", "disk becomes read-only", "disk hangs in a write"),
        r" cannot be written: |^the disk fails or hangs",
        r" is written again$",
    ),
    FaultKind(
        "recorder died or hangs",
        ("recorder killed", "recorder hangs"),
        r"^the recorder .*; it is started again in",
        r"^recording into ",
    ),
)
"""In the order of docs/faults.md."""


def faults_part(sources: Sources) -> EvidencePart:
    """List what was seen, and what was not."""
    part, logged = EvidencePart("Faults"), sources.logged
    if logged.lines:
        _tell_faults(part, sources)
    else:
        part.lack("which faults were seen", "there is no log", "companion run, and drive")
    if logged.trouble:
        part.lack("a part of the log", logged.trouble, "sudo companion evidence")
    return part


def _tell_faults(part: EvidencePart, sources: Sources) -> None:
    logged, driven = sources.logged, sources.driven
    rows, faults, known = list[dict[str, Value | None]](), logged.faults(), 0
    for kind in FAULTS:
        if kind.ends is None:
            seen = [one for one in faults if re.match(f"fault: ({kind.logged})", one.text)]
            known += len(seen)
        else:
            seen = logged.episodes(kind.logged, kind.ends)
        stood = [span for one in seen if (span := between(one.at, one.over)) is not None]
        rows.append(
            {
                "fault": kind.name,
                "seen": len(seen) or "not in this log",
                "stood, at most, s": max(stood, default=None),
                "rows of docs/faults.md": "; ".join(kind.rows),
            }
        )
    part.tabulate("Kinds of faults", rows)
    begin, end = logged.lines[0].at, logged.lines[-1].at
    unclean = logged.unclean + (logged.open and not sources.running)
    part.tell(
        Basis("log", len(logged.lines), begin, end),
        ("faults of other kinds", len(faults) - known, ""),
        ("starts of the companion", logged.starts, ""),
        ("ends without being told to stop: killed, crashed, or without power", unclean, ""),
        ("reboots of the autopilot while it was recorded", driven.reboots if driven.files else None, ""),
    )
    part.lack(
        "what the autopilot's script did while the companion was dead or not heard",
        "the companion cannot have seen it",
        "read the autopilot's own log",
    )
    part.lack(
        "the other rows of docs/faults.md",
        "a rover's log does not show them",
        "make faults, in simulation, or read what is known of them there",
    )
    part.note = (
        f"This log begins {utc(begin)}: what is not in it is not proven on this rover. "
        "Stood: until the log says that it is over, with the time in which its cause lasted."
    )
