"""Defines the settings by which frames are judged: thresholds, region of interest, tiles, pooling."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, field, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from anytraverse.errors import SettingsError
from anytraverse.ground import NOWHERE, GroundRegion
from anytraverse.perception import DefaultThresholds
from anytraverse.pooling import POOLINGS, UNCERTAINTIES
from anytraverse.regions import Box, Region, TileScale
from anytraverse.roi import Corridor

_SAME = 1e-5
"""By so little the sides of a region may differ that went to a ground station and back."""
LARGEST_TILE = 0.25
"""Over the ROI's width. A tile that is calculated from the camera's mount is no larger: see `Settings`."""


@dataclass(frozen=True)
class Thresholds:
    """Holds the thresholds from which a figure is bad, and the margins by which it must be good again.

    roi, tile: uncertainty, (0, 1]; tile None: not judged. scene: cosine, [-1, 1].
    trav: drivable share of the known pixels, [0, 1]. margin applies to all but the cosine.
    match: (number of remembered scenes, least cosine of a match), both rising; see `least_match`.
    Raises SettingsError for a number out of its range.
    """

    roi: float = 0.3
    scene: float = 0.85
    tile: float | None = None
    trav: float = 0.4
    margin: float = 0.03
    similarity_margin: float = 0.01
    match: tuple[tuple[int, float], ...] = ()

    def __post_init__(self) -> None:
        _check("roi", self.roi, 0.0 < self.roi <= 1.0, "above 0, at most 1")
        _check("scene", self.scene, -1.0 <= self.scene <= 1.0, "-1 to 1")
        _check("tile", self.tile, self.tile is None or 0.0 < self.tile <= 1.0, "above 0, at most 1")
        _check("trav", self.trav, 0.0 <= self.trav <= 1.0, "0 to 1")
        _check("margin", self.margin, 0.0 <= self.margin <= 1.0, "0 to 1")
        _check("similarity_margin", self.similarity_margin, 0.0 <= self.similarity_margin <= 1.0, "0 to 1")
        entries, cosines = [0, *(row[0] for row in self.match)], [-1.0, *(row[1] for row in self.match)]
        rising = all(one < next_one for one, next_one in pairwise(entries))
        rising = rising and all(one <= next_one <= 1.0 for one, next_one in pairwise(cosines))
        _check("match", self.match, rising, "pairs of a number of scenes and a cosine, both rising")

    @classmethod
    def of(cls, defaults: DefaultThresholds) -> Thresholds:
        """Take a perceiver's own thresholds, with the default of every other number."""
        return cls(defaults.roi, defaults.scene, defaults.tile, match=defaults.match)

    def least_match(self, scenes: int) -> float:
        """Return the cosine that a frame needs to match one of `scenes` remembered ones.

        The more there are, the more a frame of another place resembles one of them by chance. Between two
        numbers in `match` it is interpolated by the logarithm of `scenes`. Beyond the last it rises on, at
        least as it did on the whole, up to 1. It is never below `scene`, which is all that counts where
        `match` is empty.
        """
        if not self.match:
            return self.scene
        logs, cosines = [math.log(row[0]) for row in self.match], [row[1] for row in self.match]
        at = math.log(max(1, scenes))
        least = float(np.interp(at, logs, cosines))
        if at > logs[-1] and len(logs) > 1:
            slopes = [(cosines[-1] - cosines[n]) / (logs[-1] - logs[n]) for n in (0, -2)]
            least = min(1.0, cosines[-1] + max(slopes) * (at - logs[-1]))
        return max(self.scene, least)


@dataclass(frozen=True)
class Settings:
    """Holds the settings by which frames are judged.

    region: the ROI. tile_share: a tile's side over the ROI's width, (0, 1]. tile_width: a tile's side over
    the image's width, (0, 1], where it is known how wide the things are that must be seen; see `tile_side`.
    freshness: seconds after which a frame is too old to be OK. votes, window: so many of the last `window`
    frames must match a remembered scene before it is adopted. scene_every: every n-th frame gets an embedding
    of its own, 1 to 100; see `SceneWatch`. pooling, uncertainty: names in `POOLINGS` and `UNCERTAINTIES`.
    misfit_allowed: whether the vehicle may be wider than the region, see `misfit`. No frame is OK then.
    ground: the ROI in metres, None: not known. `region` is the box around it for a vehicle that does not
    lean; a frame is judged by its own region and `tiles`, see `at`. With another `region` it is not used.
    Raises SettingsError for a number out of range, an unknown name, or a misfit that is not allowed.
    """

    region: Region = field(default_factory=lambda: Box(1 / 3, 0.6, 2 / 3, 0.95))
    thresholds: Thresholds = field(default_factory=Thresholds)
    corridor: Corridor = field(default_factory=lambda: Corridor(bottom=0.3, top=0.2))
    tile_share: float = 0.25
    tile_width: float | None = None
    freshness: float = 1.0
    votes: int = 2
    window: int = 3
    scene_every: int = 1
    pooling: str = "max"
    uncertainty: str = "max"
    misfit_allowed: bool = False
    ground: GroundRegion | None = None
    tiles: TileScale | None = None

    def __post_init__(self) -> None:
        _check("tile_share", self.tile_share, 0.0 < self.tile_share <= 1.0, "above 0, at most 1")
        known = self.tile_width is None or 0.0 < self.tile_width <= 1.0
        _check("tile_width", self.tile_width, known, "above 0, at most 1")
        _check("freshness", self.freshness, 0.0 < self.freshness < math.inf, "seconds above 0")
        _check("votes", self.votes, 1 <= self.votes <= self.window, f"1 to the window, {self.window}")
        _check("scene_every", self.scene_every, 1 <= self.scene_every <= 100, "1 to 100 frames")
        _check("pooling", self.pooling, self.pooling in POOLINGS, " or ".join(POOLINGS))
        _check("uncertainty", self.uncertainty, self.uncertainty in UNCERTAINTIES, " or ".join(UNCERTAINTIES))
        if self.misfit and not self.misfit_allowed:
            raise SettingsError(self.misfit)

    @classmethod
    def of(cls, defaults: DefaultThresholds) -> Settings:
        """Take a perceiver's own thresholds and tiles, with the default of every other setting."""
        return cls(thresholds=Thresholds.of(defaults), tile_share=defaults.tile_share)

    @property
    def misfit(self) -> str:
        """Why the vehicle does not fit into the region, "" where it does: see `Corridor.misfit`."""
        if self.metres is not None or self.tiles is not None:
            return ""  # a `GroundRegion` is as wide as the vehicle, or wider
        return self.corridor.misfit(self.region.bounds)

    def at(self, lean: tuple[float, float] | None, reach: float | None = None) -> Settings:
        """Return a frame's settings: region, corridor and tiles as they appear when the vehicle leans so.

        lean, reach: as in `Frame`. A region is never made shorter by a reach. They are these settings
        themselves where no region in metres is known.
        """
        ground = self.metres
        return self if ground is None else _seen(self, ground.reaching(reach), lean)

    @property
    def metres(self) -> GroundRegion | None:
        """The ROI in metres that is in force; None where it is one in fractions of the image."""
        if self.ground is None:
            return None
        sides = zip(
            astuple(self.region.bounds), astuple(self.ground.in_picture(None).region.bounds), strict=True
        )
        return self.ground if all(abs(one - other) <= _SAME for one, other in sides) else None

    @property
    def tile(self) -> float | TileScale:
        """How large a tile is: over the ROI's width, or by its distance."""
        return self.tiles or self.tile_side

    @property
    def tile_side(self) -> float:
        """A tile's side over the ROI's width, (0, 1]: tile_width, but from tile_share to `LARGEST_TILE`.

        Where no tile_width is known it is tile_share. The tile's threshold was chosen for tile_share: smaller
        tiles would be over it more often, and call more often for nothing.
        """
        if self.tile_width is None:
            return self.tile_share
        bounds = self.region.bounds
        width = bounds.right - bounds.left
        return max(self.tile_share, min(LARGEST_TILE, self.tile_width / width))


@lru_cache(16)
def _seen(settings: Settings, ground: GroundRegion, lean: tuple[float, float] | None) -> Settings:
    seen = ground.in_picture(lean)
    (low, wide), (high, slim) = seen.near, seen.far
    bounds, corridor = seen.region.bounds, settings.corridor
    top, bottom, region = max(0.0, high), min(1.0, low), seen.region
    if top >= bottom:
        region = NOWHERE
    else:
        slope = (wide - slim) / (low - high)
        middle = ground.width / ground.vehicle * (wide + slim) / 2
        corridor = replace(
            corridor,
            bottom=wide + slope * (bottom - low),
            top=slim + slope * (top - high),
            bottom_row=bottom,
            top_row=top,
            gap=min(1.0, corridor.gap * middle / (bounds.right - bounds.left)),
            rows=seen.rows,
        )
    return replace(settings, region=region, corridor=corridor, tiles=seen.tiles, ground=None)


def _check(name: str, value: object, holds: bool, expected: str) -> None:
    if not holds:
        raise SettingsError(f"{name} is {value!r}: give {expected}")
