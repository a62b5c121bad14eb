"""Tells where a thing before the rover was noticed, as `companion check --zone` measured it."""

from __future__ import annotations

from calendar import timegm
from time import strptime

from companion.desk.check.zone_file import Zone, read_zone_files
from companion.desk.evidence.parts import (
    Basis,
    EvidenceFigure,
    EvidencePart,
    EvidenceTable,
    NotKnown,
    figures,
)
from companion.desk.evidence.sources import Sources

_COMMAND = "companion check --zone"


def zone_part(sources: Sources) -> EvidencePart:
    """Describe the measured zones: a figure of each, and all marks of the newest."""
    unread = list[str]()
    zones = read_zone_files(sources.folder, unread.append)
    unknown = [NotKnown("a measured zone", why, _COMMAND) for why in unread]
    if not zones:
        unknown.append(NotKnown("where a thing before the rover is noticed", "no zone is stored", _COMMAND))
        return EvidencePart("zone", "Detection zone", unknown=tuple(unknown))
    found = tuple(figure for zone in zones for figure in _figures(zone))
    newest = zones[-1]
    if newest.covers is None:
        unknown.append(
            NotKnown(
                "whether the zone covers the stop", "its stopping distance is not known", "companion check"
            )
        )
    missing = sum(
        not any(mark.line == line and mark.distance_m == metres for mark in newest.marks)
        for line in {mark.line for mark in newest.marks}
        for metres in newest.distances
    )
    if missing:
        unknown.append(NotKnown(f"{missing} marks of the newest zone", "they were left out", _COMMAND))
    note = f"The newest: {newest.thing}; {newest.verdict or 'no verdict'}."
    return EvidencePart("zone", "Detection zone", found, _tables(newest), tuple(unknown), note)


def _figures(zone: Zone) -> tuple[EvidenceFigure, ...]:
    at = float(timegm(strptime(zone.at, "%Y%m%dT%H%M%SZ")))
    frames = sum(one.frames for one in (*zone.marks, *zone.arcs))
    noticed = [mark.distance_m for mark in zone.marks if mark.noticed]
    return figures(
        Basis(_COMMAND, frames, at, at),
        (
            (f"{zone.at}: marks at which {zone.thing} was noticed", len(noticed), ""),
            (f"{zone.at}: marks measured", len(zone.marks), ""),
            (f"{zone.at}: farthest mark at which it was noticed", max(noticed, default=None), "m"),
            (f"{zone.at}: what stopping needs", zone.stop.get("needs"), "m"),
            (f"{zone.at}: noticed in time all across the way", zone.covers, ""),
            (f"{zone.at}: frames with nothing there in which something was noticed", _share(zone), "%"),
        ),
    )


def _share(zone: Zone) -> float | None:
    return None if zone.empty is None else 100.0 * zone.empty.share


def _tables(zone: Zone) -> tuple[EvidenceTable, ...]:
    columns = (
        "line",
        "bearing, °",
        "distance, m",
        "noticed",
        "frames",
        "noticed in, %",
        "in picture",
        "brightness",
    )
    rows = [
        (
            mark.line,
            mark.bearing_deg,
            mark.distance_m,
            mark.noticed,
            mark.frames,
            100.0 * mark.share,
            mark.in_picture,
            None if mark.light is None else mark.light.mean,
        )
        for mark in zone.marks
    ]
    tables = [EvidenceTable.of(f"Marks of {zone.at}", columns, rows)]
    if zone.arcs:
        arcs = [
            (arc.distance_m, arc.from_deg, arc.to_deg, arc.frames, 100.0 * arc.share) for arc in zone.arcs
        ]
        walked = ("distance, m", "from, °", "to, °", "frames", "noticed in, %")
        tables.append(EvidenceTable.of(f"Walks of {zone.at}", walked, arcs))
    return tuple(tables)
