"""Tells where a thing before the rover was noticed, as `companion check --zone` measured it."""

from __future__ import annotations

from calendar import timegm
from time import strptime

from companion.desk.check.zone_file import Zone, read_zone_files
from companion.desk.evidence.parts import Basis, EvidencePart
from companion.desk.evidence.sources import Sources

_COMMAND = "companion check --zone"


def zone_part(sources: Sources) -> EvidencePart:
    """Describe the measured zones: figures of each, and all marks of the newest."""
    part = EvidencePart("Detection zone")
    zones, left_out = read_zone_files(sources.folder)
    for why in left_out:
        part.lack("a measured zone", why, _COMMAND)
    if not zones:
        part.lack("where a thing before the rover is noticed", "no zone is stored", _COMMAND)
        return part
    for zone in zones:
        _tell_zone(part, zone)
    newest = zones[-1]
    if newest.covers is None:
        why = "its stopping distance is not known"
        part.lack("whether the zone covers the stop", why, "companion check")
    measured = {(mark.line, mark.distance_m) for mark in newest.marks}
    planned = {(line, metres) for line, _ in measured for metres in newest.distances}
    if missing := len(planned - measured):
        part.lack(f"{missing} marks of the newest zone", "they were left out", _COMMAND)
    _tabulate(part, newest)
    part.note = f"The newest: {newest.thing}; {newest.verdict or 'no verdict'}."
    return part


def _tell_zone(part: EvidencePart, zone: Zone) -> None:
    at = float(timegm(strptime(zone.at, "%Y%m%dT%H%M%SZ")))
    frames = sum(one.frames for one in (*zone.marks, *zone.arcs))
    noticed = [mark.distance_m for mark in zone.marks if mark.noticed]
    empty = None if zone.empty is None else 100.0 * zone.empty.share
    part.tell(
        Basis(_COMMAND, frames, at, at),
        (f"{zone.at}: marks at which {zone.thing} was noticed", len(noticed), ""),
        (f"{zone.at}: marks measured", len(zone.marks), ""),
        (f"{zone.at}: farthest mark at which it was noticed", max(noticed, default=None), "m"),
        (f"{zone.at}: what stopping needs", zone.stop.get("needs"), "m"),
        (f"{zone.at}: noticed in time all across the way", zone.covers, ""),
        (f"{zone.at}: frames with nothing there in which something was noticed", empty, "%"),
    )


def _tabulate(part: EvidencePart, zone: Zone) -> None:
    marks = [
        {
            "line": mark.line,
            "bearing, °": mark.bearing_deg,
            "distance, m": mark.distance_m,
            "noticed": mark.noticed,
            "frames": mark.frames,
            "noticed in, %": 100.0 * mark.share,
            "in picture": mark.in_picture,
            "brightness": None if mark.light is None else mark.light.mean,
        }
        for mark in zone.marks
    ]
    walks = [
        {
            "distance, m": arc.distance_m,
            "from, °": arc.from_deg,
            "to, °": arc.to_deg,
            "frames": arc.frames,
            "noticed in, %": 100.0 * arc.share,
        }
        for arc in zone.arcs
    ]
    part.tabulate(f"Marks of {zone.at}", marks)
    if walks:
        part.tabulate(f"Walks of {zone.at}", walks)
