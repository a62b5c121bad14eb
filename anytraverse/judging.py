"""From maps and similarity to findings. Fails closed: what is not finite, empty or old is a fault."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from anytraverse.assessment import Finding, Map, Maps, Reason
from anytraverse.perception import DefaultThresholds
from anytraverse.pooling import POOLINGS, UNCERTAINTIES
from anytraverse.regions import Box, Region
from anytraverse.roi import Corridor, RoiFigures, corridor_open, worst_tile

_TOLERANCE = 1e-3
_WIDER = 1.1
"""A corridor counts as clear when one this much wider is open."""


@dataclass(frozen=True)
class Thresholds:
    """Where a figure turns bad, and the margins by which it must turn good again.

    roi, tile: uncertainty, (0, 1]; tile None: not judged. scene: cosine, [-1, 1].
    trav: drivable share of the known pixels, [0, 1]. margin applies to all but the cosine.
    """

    roi: float = 0.3
    scene: float = 0.85
    tile: float | None = None
    trav: float = 0.4
    margin: float = 0.03
    similarity_margin: float = 0.01

    @classmethod
    def of(cls, defaults: DefaultThresholds) -> Thresholds:
        """A perceiver's own."""
        return cls(defaults.roi, defaults.scene, defaults.tile)


@dataclass(frozen=True)
class Settings:
    """How frames are judged.

    region: the ROI. freshness: seconds after which a frame is too old to be OK.
    votes of window: how many of the last frames must match a remembered scene before it is adopted.
    """

    region: Region = field(default_factory=lambda: Box(1 / 3, 0.6, 2 / 3, 0.95))
    thresholds: Thresholds = field(default_factory=Thresholds)
    corridor: Corridor | None = field(default_factory=lambda: Corridor(bottom=0.3, top=0.2))
    tile_share: float = 0.25
    freshness: float = 1.0
    votes: int = 2
    window: int = 3
    pooling: str = "max"
    uncertainty: str = "max"


def make_maps(attention: Map, weights: list[float], settings: Settings) -> Maps | Finding:
    """Pooled maps, or the fault that makes them worthless."""
    if attention.ndim != 3 or len(attention) != len(weights) or attention.shape[1] * attention.shape[2] == 0:
        return Finding.fault("attention maps have a wrong shape")
    if not np.isfinite(attention).all():
        return Finding.fault("attention maps are not finite")
    if len(attention) and (attention.min() < -_TOLERANCE or attention.max() > 1 + _TOLERANCE):
        return Finding.fault("attention maps leave 0 to 1")
    signed = POOLINGS[settings.pooling](attention, np.asarray(weights, dtype=np.float32))
    return Maps(attention, signed, UNCERTAINTIES[settings.uncertainty](attention))


def roi_figures(maps: Maps, aspect: float, settings: Settings) -> RoiFigures | Finding:
    """Figures of the ROI, or the fault when it holds no pixel. aspect: width / height of the frame."""
    height, width = maps.signed.shape
    inside = settings.region.mask(height, width)
    tile = worst_tile(maps.uncertainty, settings.region, aspect, settings.tile_share)
    if tile is None or not inside.any():
        return Finding.fault("the ROI holds no pixel: make it larger")
    known = int(maps.known[inside].sum())
    return RoiFigures(
        uncertainty=float(maps.uncertainty[inside].mean()),
        traversability=float(maps.traversability[inside].mean()),
        known_share=known / int(inside.sum()),
        drivable_share=int(maps.drivable[inside].sum()) / known if known else None,
        corridor=corridor_open(maps.not_drivable, settings.region, settings.corridor)
        if settings.corridor
        else None,
        worst_tile=tile,
    )


def find(maps: Maps, roi: RoiFigures, similarity: float | None, settings: Settings) -> list[Finding]:
    """Every figure against its threshold."""
    limits = settings.thresholds
    findings = [
        Finding.above(Reason.UNKNOWN_OBJECT, "roi_uncertainty", roi.uncertainty, limits.roi, limits.margin)
    ]
    if limits.tile is not None:
        worst = roi.worst_tile.uncertainty
        findings.append(Finding.above(Reason.UNKNOWN_OBJECT, "worst_tile", worst, limits.tile, limits.margin))
    if similarity is not None:
        findings.append(
            Finding.fault("the scene embedding is not finite")
            if not math.isfinite(similarity)
            else Finding.below(
                Reason.UNKNOWN_SCENE, "scene_similarity", similarity, limits.scene, limits.similarity_margin
            )
        )
    if roi.drivable_share is not None:
        findings.append(
            Finding.below(Reason.BLOCKED, "drivable_share", roi.drivable_share, limits.trav, limits.margin)
        )
    if settings.corridor is not None and roi.corridor is not None:
        wider = Corridor(settings.corridor.bottom * _WIDER, settings.corridor.top * _WIDER)
        clear = roi.corridor and corridor_open(maps.not_drivable, settings.region, wider)
        findings.append(Finding(Reason.BLOCKED, "corridor", not roi.corridor, clear))
    return findings
