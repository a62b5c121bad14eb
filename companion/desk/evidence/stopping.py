"""Tells how far the rover rolls after HOLD, as it was measured."""

from __future__ import annotations

from companion.desk.check.stop_file import MeasuredStops, read_stops
from companion.desk.evidence.parts import (
    Basis,
    EvidenceFigure,
    EvidencePart,
    EvidenceTable,
    NotKnown,
    figures,
    utc,
)
from companion.desk.evidence.sources import Sources
from companion.vehicle.brakes import fit

_MEASURE = "companion check --measure"


def stopping_part(sources: Sources) -> EvidencePart:
    """Describe the measured stops."""
    found: tuple[EvidenceFigure, ...] = ()
    measured, unread = read_stops(sources.folder)
    unknown = [NotKnown(f"the stops in {name}", why, _MEASURE) for name, why in unread]
    tables = list[EvidenceTable]()
    for one in measured:
        found += _fitted(one)
        rows = [(stop.speed, stop.way) for stop in one.stops]
        tables.append(
            EvidenceTable.of(
                f"Stops by {one.mode}, {utc(one.at)}", ("speed, m/s", "way to standstill, m"), rows
            )
        )
    if not measured:
        unknown.append(NotKnown("how far it rolls after HOLD", "no measured stop is stored", _MEASURE))
    note = "Speed at the order, and way from the order to standstill, both by the autopilot's speeds."
    return EvidencePart(
        "stopping", "Stopping", found, tuple(tables), tuple(unknown), note if measured else ""
    )


def _fitted(one: MeasuredStops) -> tuple[EvidenceFigure, ...]:
    basis = Basis(f"companion check --measure, {one.mode}", len(one.stops), one.at, one.at)
    speeds = [stop.speed for stop in one.stops]
    told = [
        (f"slowest stop measured by {one.mode}", min(speeds), "m/s"),
        (f"fastest stop measured by {one.mode}", max(speeds), "m/s"),
    ]
    try:
        fitted = fit(one.stops, one.mode)
    except ValueError:
        return figures(basis, told)
    told += [
        (f"time constant fitted, {one.mode}", fitted.time_constant, "s"),
        (f"deceleration fitted, {one.mode}", fitted.braking, "m/s2"),
        (f"longer than measured, at most, {one.mode}", 100.0 * fitted.excess, "%"),
    ]
    return figures(basis, told)
