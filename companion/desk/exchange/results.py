"""Counts what exchanged regions of interest led to, and tells it as a table and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

from companion.desk.exchange.drive import RegionTally
from companion.desk.exchange.vehicles import ExchangeVehicle


@dataclass(frozen=True, eq=False)
class Pair:
    """A vehicle with the region of one of the vehicles. far: where that ends, m before its front."""

    vehicle: ExchangeVehicle
    region: str
    near: float
    far: float
    tally: RegionTally

    @property
    def own(self) -> bool:
        """Whether the region is the vehicle's own."""
        return self.region == self.vehicle.name

    @property
    def calls(self) -> list[float]:
        """Distances of the calls for things on the trail."""
        return [one.call for one in self.tally.approaches if one.call is not None]

    @property
    def firsts(self) -> list[float]:
        """Distances at which a single frame first showed such a thing."""
        return [one.first for one in self.tally.approaches if one.first is not None]

    @property
    def never(self) -> int:
        """How many things on the trail were reached without a call."""
        return len(self.tally.approaches) - len(self.calls)

    @property
    def late(self) -> int:
        """How many things were called for nearer than the vehicle still needs to stop, or never."""
        return self.never + sum(call < self.vehicle.still_needs for call in self.calls)

    @property
    def needless(self) -> float:
        """Calls for nothing in the vehicle's way, in 100 m of free way."""
        return 100.0 * self.tally.needless / self.tally.free if self.tally.free else 0.0

    def told(self) -> dict[str, Any]:
        """Return it for JSON. Distances in m."""
        return {
            "vehicle": self.vehicle.name,
            "region": self.region,
            "near": round(self.near, 2),
            "far": round(self.far, 2),
            "still_needs": round(self.vehicle.still_needs, 2),
            "things": len(self.tally.approaches),
            "late": self.late,
            "never": self.never,
            "call": _spread(self.calls),
            "first": _spread(self.firsts),
            "needless": self.tally.needless,
            "free": round(self.tally.free, 1),
            "needless_per_100_m": round(self.needless, 2),
            "approaches": [
                {name: round(one, 3) if isinstance(one, float) else one for name, one in asdict(each).items()}
                for each in self.tally.approaches
            ],
        }


def vehicle_told(vehicle: ExchangeVehicle) -> dict[str, Any]:
    """Return a vehicle with its own region for JSON. Distances in m, speed in m/s."""
    region = vehicle.region
    figures = {
        "speed": vehicle.speed,
        "width": region.vehicle,
        "height": region.camera.height,
        "tilt": region.camera.tilt,
        "front": region.camera.front,
        "needs": vehicle.stopping.needs,
        "still_needs": vehicle.still_needs,
        "reckoned_to_see": vehicle.stopping.sees,
        "near": region.near,
        "far": region.far,
        "region_width": region.width,
    }
    return {"name": vehicle.name, **{name: round(one, 2) for name, one in figures.items()}}


def table(vehicles: Sequence[ExchangeVehicle], pairs: Sequence[Pair]) -> str:
    """Return the table for a terminal."""
    lines = [
        f"{'vehicle':<14}{'drives':>10}{'needs':>8}{'after the votes':>17}{'own region':>25}",
        *(
            f"{one.name:<14}{one.speed:>6.1f} m/s{one.stopping.needs:>6.1f} m{one.still_needs:>15.1f} m"
            f"{f'{one.region.near:.1f} to {one.region.far:.1f} m, {one.region.width:.1f} wide':>25}"
            for one in vehicles
        ),
        "",
        f"{'vehicle':<14}{'region of':<14}{'ends':>7}{'sees':>7}{'calls':>8}{'nearest':>9}{'too late':>10}"
        f"{'needless/100 m':>16}",
    ]
    for one in pairs:
        seen, calls = (f"{median(found):.1f} m" if found else "-" for found in (one.firsts, one.calls))
        nearest = f"{min(one.calls):.1f} m" if one.calls else "-"
        late = f"{one.late}/{len(one.tally.approaches)}"
        lines.append(
            f"{one.vehicle.name:<14}{one.region:<14}{f'{one.far:.1f} m':>7}{seen:>7}{calls:>8}{nearest:>9}"
            f"{late:>10}{one.needless:>16.1f}"
        )
    return "\n".join(lines)


def _spread(values: Sequence[float]) -> dict[str, float] | None:
    if not values:
        return None
    return {
        "least": round(min(values), 2),
        "median": round(median(values), 2),
        "most": round(max(values), 2),
    }
