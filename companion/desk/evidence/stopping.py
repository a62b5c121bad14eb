"""Tells how far the rover rolls after HOLD, as it was measured."""

from __future__ import annotations

from companion.desk.check.stop_file import MeasuredStops, read_stops
from companion.desk.evidence.parts import Basis, EvidencePart, utc
from companion.desk.evidence.sources import Sources
from companion.vehicle.brakes import fit

_MEASURE = "companion check --measure"


def stopping_part(sources: Sources) -> EvidencePart:
    """Describe the measured stops."""
    part = EvidencePart("Stopping")
    measured, unread = read_stops(sources.folder)
    for name, why in unread:
        part.lack(f"the stops in {name}", why, _MEASURE)
    for one in measured:
        _tell_fitted(part, one)
        rows = [{"speed, m/s": stop.speed, "way to standstill, m": stop.way} for stop in one.stops]
        part.tabulate(f"Stops by {one.mode}, {utc(one.at)}", rows)
    if measured:
        part.note = (
            "Speed at the order, and way from the order to standstill, both by the autopilot's speeds."
        )
    else:
        part.lack("how far it rolls after HOLD", "no measured stop is stored", _MEASURE)
    return part


def _tell_fitted(part: EvidencePart, one: MeasuredStops) -> None:
    basis = Basis(f"{_MEASURE}, {one.mode}", len(one.stops), one.at, one.at)
    speeds = [stop.speed for stop in one.stops]
    part.tell(
        basis,
        (f"slowest stop measured by {one.mode}", min(speeds), "m/s"),
        (f"fastest stop measured by {one.mode}", max(speeds), "m/s"),
    )
    try:
        fitted = fit(one.stops, one.mode)
    except ValueError:
        return
    part.tell(
        basis,
        (f"time constant fitted, {one.mode}", fitted.time_constant, "s"),
        (f"deceleration fitted, {one.mode}", fitted.braking, "m/s2"),
        (f"longer than measured, at most, {one.mode}", 100.0 * fitted.excess, "%"),
    )
