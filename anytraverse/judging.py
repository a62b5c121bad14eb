"""From maps and similarity to findings. Fails closed: what is not finite, empty or old is a fault."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from anytraverse.assessment import NAMED_TILE, WORST_TILE, Finding, Map, Maps, Reason
from anytraverse.errors import SettingsError
from anytraverse.perception import DefaultThresholds
from anytraverse.pooling import POOLINGS, UNCERTAINTIES
from anytraverse.regions import Box, Region
from anytraverse.roi import Corridor, NamedTile, RoiFigures, Tile, corridor_open, worst_tile

CORRIDOR = "corridor"
"""The figure that says whether the vehicle fits through."""

_TOLERANCE = 1e-3
_WIDER = 1.1
"""A corridor counts as clear when one this much wider is open."""
_EXPLAINED = 0.2
"""Share of a strange tile that the word of a tapped thing must account for to name it."""


@dataclass(frozen=True)
class Thresholds:
    """Where a figure turns bad, and the margins by which it must turn good again.

    roi, tile: uncertainty, (0, 1]; tile None: not judged. scene: cosine, [-1, 1].
    trav: drivable share of the known pixels, [0, 1]. margin applies to all but the cosine.
    Raises SettingsError for anything outside.
    """

    roi: float = 0.3
    scene: float = 0.85
    tile: float | None = None
    trav: float = 0.4
    margin: float = 0.03
    similarity_margin: float = 0.01

    def __post_init__(self) -> None:
        _check("roi", self.roi, 0.0 < self.roi <= 1.0, "above 0, at most 1")
        _check("scene", self.scene, -1.0 <= self.scene <= 1.0, "-1 to 1")
        _check("tile", self.tile, self.tile is None or 0.0 < self.tile <= 1.0, "above 0, at most 1")
        _check("trav", self.trav, 0.0 <= self.trav <= 1.0, "0 to 1")
        _check("margin", self.margin, 0.0 <= self.margin <= 1.0, "0 to 1")
        _check("similarity_margin", self.similarity_margin, 0.0 <= self.similarity_margin <= 1.0, "0 to 1")

    @classmethod
    def of(cls, defaults: DefaultThresholds) -> Thresholds:
        """A perceiver's own."""
        return cls(defaults.roi, defaults.scene, defaults.tile)


@dataclass(frozen=True)
class Settings:
    """How frames are judged.

    region: the ROI. freshness: seconds after which a frame is too old to be OK.
    votes of window: how many of the last frames must match a remembered scene before it is adopted.
    scene_every: the scene's embedding is made anew on every so many-th frame, 1 to 100; see `SceneWatch`.
    Raises SettingsError for a number out of range or an unknown name.
    """

    region: Region = field(default_factory=lambda: Box(1 / 3, 0.6, 2 / 3, 0.95))
    thresholds: Thresholds = field(default_factory=Thresholds)
    corridor: Corridor | None = field(default_factory=lambda: Corridor(bottom=0.3, top=0.2))
    tile_share: float = 0.25
    freshness: float = 1.0
    votes: int = 2
    window: int = 3
    scene_every: int = 1
    pooling: str = "max"
    uncertainty: str = "max"

    def __post_init__(self) -> None:
        _check("tile_share", self.tile_share, 0.0 < self.tile_share <= 1.0, "above 0, at most 1")
        _check("freshness", self.freshness, 0.0 < self.freshness < math.inf, "seconds above 0")
        _check("votes", self.votes, 1 <= self.votes <= self.window, f"1 to the window, {self.window}")
        _check("scene_every", self.scene_every, 1 <= self.scene_every <= 100, "1 to 100 frames")
        _check("pooling", self.pooling, self.pooling in POOLINGS, " or ".join(POOLINGS))
        _check("uncertainty", self.uncertainty, self.uncertainty in UNCERTAINTIES, " or ".join(UNCERTAINTIES))


def _check(name: str, value: object, holds: bool, expected: str) -> None:
    if not holds:
        raise SettingsError(f"{name} is {value!r}: give {expected}")


def check_age(age: float, freshness: float) -> list[Finding]:
    """The fault of a frame that is not fresh: seconds since capture, beyond `freshness` or below 0."""
    if 0.0 <= age <= freshness:
        return []
    return [Finding.fault(f"the frame is {-age:.1f} s ahead" if age < 0 else f"the frame is {age:.1f} s old")]


def make_maps(
    attention: Map, weights: list[float], settings: Settings, named: NDArray[np.bool_] | None = None
) -> Maps | Finding:
    """Pooled maps, or the fault that makes them worthless. Any floating dtype is taken.

    named: (n,), the words that were tapped and are not drivable; none of them when None.
    """
    attention = np.asarray(attention, dtype=np.float32)
    if attention.ndim != 3 or len(attention) != len(weights) or attention.shape[1] * attention.shape[2] == 0:
        return Finding.fault("attention maps have a wrong shape")
    if len(attention):
        lowest, highest = float(attention.min()), float(attention.max())
        if not math.isfinite(lowest + highest):
            return Finding.fault("attention maps are not finite")
        if lowest < -_TOLERANCE or highest > 1 + _TOLERANCE:
            return Finding.fault("attention maps leave 0 to 1")
        if lowest < 0.0 or highest > 1.0:
            attention = np.clip(attention, 0.0, 1.0)
    signed = POOLINGS[settings.pooling](attention, np.asarray(weights, dtype=np.float32))
    uncertain = UNCERTAINTIES[settings.uncertainty]
    uncertainty = strangeness = uncertain(attention)
    if named is None:
        named = np.zeros(len(attention), dtype=np.bool_)
    if named.any():
        strangeness = uncertain(attention[~named])
    if not (np.isfinite(signed).all() and np.isfinite(uncertainty).all()):
        return Finding.fault("pooled maps are not finite")
    return Maps(attention, signed, uncertainty, named, strangeness)


def roi_figures(maps: Maps, aspect: float, settings: Settings) -> RoiFigures | Finding:
    """Figures of the ROI, or the fault when it holds no pixel. aspect: width / height of the frame."""
    height, width = maps.signed.shape
    inside = settings.region.mask(height, width)
    tile = worst_tile(maps.uncertainty, settings.region, aspect, settings.tile_share)
    if tile is None:
        return Finding.fault("the ROI holds no pixel: make it larger")
    known = int(maps.known[inside].sum())
    return RoiFigures(
        uncertainty=float(maps.uncertainty[inside].mean()),
        traversability=float(maps.traversability[inside].mean()),
        known_share=known / int(inside.sum()),
        drivable_share=int(maps.drivable[inside].sum()) / known if known else None,
        corridor=_corridor(maps, settings, 1.0),
        worst_tile=tile,
        named_tile=_named_tile(maps, aspect, settings, tile),
    )


def find(maps: Maps, roi: RoiFigures, similarity: float | None, settings: Settings) -> list[Finding]:
    """Every figure against its threshold."""
    limits = settings.thresholds
    findings = [
        Finding.above(Reason.UNKNOWN_OBJECT, "roi_uncertainty", roi.uncertainty, limits.roi, limits.margin)
    ]
    if len(maps.attention) == 0:
        findings.append(Finding(Reason.UNKNOWN_OBJECT, "no words", bad=True, clear=False))
    if limits.tile is not None:
        worst = roi.worst_tile.uncertainty
        unknown = Finding.above(Reason.UNKNOWN_OBJECT, WORST_TILE, worst, limits.tile, limits.margin)
        findings.append(unknown)
        if roi.named_tile is not None:
            reason = Reason.BLOCKED if roi.named_tile.explained >= _EXPLAINED else Reason.UNKNOWN_OBJECT
            strange = roi.named_tile.tile.uncertainty
            held = Finding.above(reason, NAMED_TILE, strange, limits.tile, limits.margin)
            if unknown.bad and reason is Reason.UNKNOWN_OBJECT:
                held = replace(held, bad=False, clear=True)  # said already: nor in the way of a reason's end
            findings.append(held)
    findings.extend(find_scene(similarity, settings))
    if roi.drivable_share is not None:
        findings.append(
            Finding.below(Reason.BLOCKED, "drivable_share", roi.drivable_share, limits.trav, limits.margin)
        )
    if roi.corridor is not None:
        clear = roi.corridor and _corridor(maps, settings, _WIDER) is True
        findings.append(Finding(Reason.BLOCKED, CORRIDOR, not roi.corridor, clear))
    return findings


def _named_tile(maps: Maps, aspect: float, settings: Settings, worst: Tile) -> NamedTile | None:
    """A thing that was named and may not be driven over holds the vehicle as it did before it had a name.

    Its name may be found in a part of it, too little to close the corridor, or in another thing. Where the
    worst tile calls already, it is one beside that.
    """
    if not maps.named.any():
        return None
    limit = settings.thresholds.tile
    calling = worst.box if limit is not None and worst.uncertainty > limit else None
    tile = worst_tile(maps.strangeness, settings.region, aspect, settings.tile_share, outside=calling)
    if tile is None:
        return None
    found = _named(maps, tile, float(maps.uncertainty[tile.box.slices(*maps.signed.shape)].mean()))
    if calling is None or found.explained >= _EXPLAINED:
        return found
    accounted = maps.strangeness - maps.uncertainty  # what calls may be larger than its tile
    beside = worst_tile(accounted, settings.region, aspect, settings.tile_share, outside=calling)
    return found if beside is None else _named(maps, beside, 0.0)


def _named(maps: Maps, tile: Tile, left: float) -> NamedTile:
    """With the word that explains most of the tile."""
    rows, columns = tile.box.slices(*maps.strangeness.shape)
    within = np.where(maps.named, maps.attention[:, rows, columns].mean(axis=(1, 2)), -1.0)
    return NamedTile(tile, min(left, tile.uncertainty), int(np.argmax(within)))


def _corridor(maps: Maps, settings: Settings, factor: float) -> bool | None:
    if settings.corridor is None:
        return None
    return corridor_open(maps.not_drivable, settings.region, settings.corridor.wider(factor))


def find_scene(similarity: float | None, settings: Settings) -> list[Finding]:
    """The scene against its threshold: nothing without a reference (None), a fault when NaN."""
    if similarity is None:
        return []
    if not math.isfinite(similarity):
        return [Finding.fault("scene not comparable: new episode?")]
    limits = settings.thresholds
    return [
        Finding.below(
            Reason.UNKNOWN_SCENE, "scene_similarity", similarity, limits.scene, limits.similarity_margin
        )
    ]
