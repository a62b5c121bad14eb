"""Reads a grid of thresholds and regions of interest, and makes all combinations of it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

from anytraverse.errors import AnyTraverseError
from anytraverse.judging import Settings
from anytraverse.regions import Box
from companion.desk.tuning.trial import Combination

MOST = 10_000
MOST_REGIONS = 10


class GridError(AnyTraverseError):
    """Reports a grid that cannot be used. The text says what to write."""


@dataclass(frozen=True)
class Grid:
    """Holds the values of each threshold, and regions. tile None: tiles are not judged.

    misfit_allowed: whether the vehicle may be wider than a region, see `Settings`.
    """

    scene: tuple[float, ...]
    roi: tuple[float, ...]
    tile: tuple[float | None, ...]
    regions: tuple[Box, ...]
    misfit_allowed: bool = False

    def combinations(self, base: Settings) -> list[Combination]:
        """Return all combinations. Raises GridError for too many, SettingsError for a number out of range."""
        values = product(self.scene, self.roi, self.tile, self.regions, (self.misfit_allowed,))
        found = [Combination(*one) for one in values]
        if len(self.regions) > MOST_REGIONS:
            raise GridError(f"{len(self.regions)} regions: {MOST_REGIONS} at most can be compared")
        if len(found) > MOST:
            raise GridError(f"{len(found)} combinations: {MOST} at most can be compared")
        for one in found:
            one.applied(base)
        return found


def read_values(text: str, name: str) -> tuple[float, ...]:
    """Read `0.8,0.85,0.9`, or `0.8:0.95:0.05` for values from one to another by a step. Raises GridError."""
    try:
        if ":" in text:
            first, last, step = (float(part) for part in text.split(":"))
            count = round((last - first) / step)
            if not (step > 0 and 0 <= count < MOST):
                raise ValueError
            values = [round(first + number * step, 6) for number in range(count + 1)]
        else:
            values = [float(part) for part in text.split(",")]
    except (ValueError, ZeroDivisionError, OverflowError):
        raise GridError(f'--{name} "{text}": write 0.8,0.85,0.9 or 0.8:0.95:0.05') from None
    return tuple(dict.fromkeys(values))


def read_tiles(text: str) -> tuple[float | None, ...]:
    """Read values as `read_values` does; `off` among them: tiles are not judged. Raises GridError."""
    parts = [part.strip() for part in text.split(",")]
    named = [part for part in parts if part != "off"]
    values: tuple[float | None, ...] = read_values(",".join(named), "tile") if named else ()
    return (*values, None) if len(named) < len(parts) else values


def read_region(text: str) -> Box:
    """Read `0.33,0.6,0.67,0.95`: left, top, right, bottom. Raises GridError, RegionError."""
    try:
        left, top, right, bottom = (float(part) for part in text.split(","))
    except ValueError:
        raise GridError(
            f'--region "{text}": write left,top,right,bottom in fractions of the picture, 0.33,0.6,0.67,0.95'
        ) from None
    return Box(left, top, right, bottom)


def around(settings: Settings) -> Grid:
    """Return a small grid around settings: for a first look, as in the paper's figure."""
    limits = settings.thresholds
    scene = tuple(round(limits.scene + step, 4) for step in (-0.1, -0.05, 0.0) if limits.scene + step >= -1.0)
    roi = tuple(round(min(1.0, limits.roi * factor), 4) for factor in (0.5, 1.0, 1.5))
    return Grid(scene, roi, (limits.tile,), (settings.region.bounds,))
