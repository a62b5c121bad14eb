"""Turns maps and similarity into findings. Fails closed: what is not finite, empty or old is a fault."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from anytraverse.assessment import (
    CORRIDOR,
    NAMED_MEAN,
    NAMED_TILE,
    ROI_MEAN,
    WORST_TILE,
    Finding,
    Map,
    Maps,
    Reason,
)
from anytraverse.judging import Settings
from anytraverse.pooling import POOLINGS, UNCERTAINTIES
from anytraverse.regions import Box
from anytraverse.roi import (
    KNOWN,
    Corridor,
    Mask,
    NamedTile,
    Passage,
    RoiFigures,
    Tile,
    corridor_open,
    explained,
    tile_size,
    worst_tile,
)

_TOLERANCE = 1e-3
_WIDER = 1.1
"""A corridor is clear when one wider by this factor is open, with the margin on its share."""
_EXPLAINED = 0.2
"""Words of no positive weight name a thing when they explain at least this share of its strangeness."""
_AROUND = 2.0
"""The gap's tile is enlarged by this factor to judge what closes the corridor."""
SHOWN = 0.25
"""Over the ROI's width: side of the square that is shown and tapped around a smaller tile.

A part of a thing is not enough: of a thing that was tapped in a tile of .08 half as much was found again as
of one that was tapped in this square.
"""


def check_age(age: float, freshness: float) -> list[Finding]:
    """Return a fault when `age`, the seconds since capture, is above `freshness`, below 0 or NaN."""
    if 0.0 <= age <= freshness:  # False for NaN, so that a NaN is a fault
        return []
    return [Finding.fault(f"the frame is {-age:.1f} s ahead" if age < 0 else f"the frame is {age:.1f} s old")]


def make_maps(
    attention: Map,
    weights: list[float],
    settings: Settings,
    evidence: Map | None = None,
    *,
    joint: bool = False,
) -> Maps | Finding:
    """Pool attention maps, or return the fault that makes them useless.

    attention: (n, h, w) of any floating dtype, one map for each weight. evidence: the attention of the words
    of positive weight when only these are asked for, (p, h, w); None: the same as in `attention`, which holds
    for a perceiver whose words do not compete for a pixel. Where they do, words that are not drivable may
    share what they explain, and a further one must not make it less: it is summed. joint: that cannot happen,
    see `is_joint`.
    """
    signs = np.sign(np.asarray(weights, dtype=np.float32))
    whole = _checked_attention(attention, len(weights))
    if isinstance(whole, Finding):
        return whole
    alone = whole[signs > 0] if evidence is None else _checked_attention(evidence, int((signs > 0).sum()))
    if isinstance(alone, Finding):
        return alone
    if alone.shape[1:] != whole.shape[1:]:
        return Finding.fault("attention maps have a wrong shape")
    signed = POOLINGS[settings.pooling](whole, np.asarray(weights, dtype=np.float32))
    uncertain = UNCERTAINTIES[settings.uncertainty]
    uncertainty = uncertain(whole)
    strangeness = np.maximum(uncertainty, uncertain(alone))
    if not (np.isfinite(signed).all() and np.isfinite(strangeness).all()):
        return Finding.fault("pooled maps are not finite")
    # A pixel is drivable only where a word of positive weight explains it both alone and beside all others,
    # and no other word does: a thing's name must not make the ground below it drivable.
    others, wins = whole[signs <= 0], signed > 0
    adds_up = evidence is not None and not joint
    against = others.sum(axis=0) if adds_up else others.max(axis=0, initial=0.0)
    if adds_up:
        weighted = whole * np.asarray(weights, dtype=np.float32)[:, np.newaxis, np.newaxis]
        wins &= weighted.max(axis=0, initial=0.0) > -np.minimum(weighted, 0.0).sum(axis=0)
    explained_alone = np.minimum(alone.max(axis=0, initial=0.0), whole.max(axis=0, initial=0.0)) >= KNOWN
    drivable = explained_alone & (against < KNOWN) & wins
    known = (uncertainty <= 1.0 - KNOWN) | (against >= KNOWN)
    return Maps(whole, signed, uncertainty, strangeness, drivable, signs <= 0, known)


def _checked_attention(attention: Map, count: int) -> Map | Finding:
    """Return the attention maps of `count` words as float32 clipped to [0, 1], or the fault in them."""
    attention = np.asarray(attention, dtype=np.float32)
    if attention.ndim != 3 or len(attention) != count or attention.shape[1] * attention.shape[2] == 0:
        return Finding.fault("attention maps have a wrong shape")
    if count == 0:
        return attention
    lowest, highest = float(attention.min()), float(attention.max())
    if not math.isfinite(lowest + highest):
        return Finding.fault("attention maps are not finite")
    if lowest < -_TOLERANCE or highest > 1 + _TOLERANCE:
        return Finding.fault("attention maps leave 0 to 1")
    return np.clip(attention, 0.0, 1.0) if lowest < 0.0 or highest > 1.0 else attention


def roi_figures(maps: Maps, aspect: float, settings: Settings) -> RoiFigures | Finding:
    """Calculate the ROI's figures; a fault when it holds no pixel. aspect: width / height of the frame."""
    height, width = maps.signed.shape
    inside = settings.region.mask(height, width)
    worst = worst_tile(maps.uncertainty, settings.region, aspect, settings.tile)
    if worst is None:
        return Finding.fault("the ROI holds no pixel: make it larger")
    known = int(maps.known[inside].sum())
    named = _named_tile(maps, aspect, settings, worst)
    return RoiFigures(
        uncertainty=float(maps.uncertainty[inside].mean()),
        strangeness=float(maps.strangeness[inside].mean()),
        traversability=float(maps.traversability[inside].mean()),
        known_share=known / int(inside.sum()),
        drivable_share=int(maps.drivable[inside].sum()) / known if known else None,
        corridor=_passage(maps, aspect, settings),
        worst_tile=_with_square(worst, aspect, settings),
        named_tile=named and replace(named, tile=_with_square(named.tile, aspect, settings)),
    )


def tile_outside(maps: Maps, aspect: float, settings: Settings, outside: Mask) -> Tile | None:
    """Return the worst tile outside a mask, (h, w), with the square that is shown; None where none fits."""
    tile = worst_tile(maps.uncertainty, settings.region, aspect, settings.tile, outside=outside)
    return None if tile is None else _with_square(tile, aspect, settings)


def _with_square(tile: Tile, aspect: float, settings: Settings) -> Tile:
    """Return a tile that is smaller than `SHOWN` with the square around it, inside the ROI's bounds."""
    if settings.tiles is not None or settings.tile_side >= SHOWN:
        return tile
    bounds, box = settings.region.bounds, tile.box
    side = SHOWN * (bounds.right - bounds.left)
    left, right = _around(box.left, box.right, side, (bounds.left, bounds.right))
    top, bottom = _around(box.top, box.bottom, side * aspect, (bounds.top, bounds.bottom))
    return replace(tile, around=Box(left, top, right, bottom))


def _around(low: float, high: float, side: float, within: tuple[float, float]) -> tuple[float, float]:
    """Return low and high, widened about their middle to the length `side` and shifted into `within`.

    An interval that is as long already is returned unchanged. One that reached out of `within` still does.
    """
    if high - low >= side:
        return low, high
    start = max(within[0], min((low + high - side) / 2, within[1] - side))
    return min(low, start), max(high, min(start + side, within[1]))


def is_open(drivable: Mask, aspect: float, settings: Settings, corridor: Corridor | None = None) -> bool:
    """Return whether the vehicle fits through over `drivable`, (h, w). corridor: the settings' by default."""
    height, width = drivable.shape
    corridor = corridor or settings.corridor
    gap = tile_size(height, width, settings.region.bounds, aspect, corridor.gap)
    return corridor_open(drivable, settings.region, corridor, gap)


def find(roi: RoiFigures, words: int, similarity: float | None, settings: Settings) -> list[Finding]:
    """Compare every figure with its threshold. words: how many are in force.

    Naming a thing with a word of no positive weight turns `unknown_object` into `blocked`, never into OK.
    """
    limits = settings.thresholds
    mean = Finding.above(Reason.UNKNOWN_OBJECT, ROI_MEAN, roi.uncertainty, limits.roi, limits.margin)
    findings = [mean]
    if words == 0:
        findings.append(Finding(Reason.UNKNOWN_OBJECT, "no words", bad=True, clear=False))
    if limits.tile is not None:
        worst = roi.worst_tile.uncertainty
        unknown = Finding.above(Reason.UNKNOWN_OBJECT, WORST_TILE, worst, limits.tile, limits.margin)
        findings.append(unknown)
        if (named := roi.named_tile) is not None:
            strange = named.tile.uncertainty
            findings.append(
                _named_finding(NAMED_TILE, strange, named.explained, limits.tile, limits.margin, unknown)
            )
    if roi.named_tile is not None:
        share = explained(roi.strangeness, roi.uncertainty)
        findings.append(_named_finding(NAMED_MEAN, roi.strangeness, share, limits.roi, limits.margin, mean))
    findings.extend(find_scene(similarity, settings))
    if roi.drivable_share is not None:
        findings.append(
            Finding.below(Reason.BLOCKED, "drivable_share", roi.drivable_share, limits.trav, limits.margin)
        )
    return findings + _find_corridor(roi.corridor)


def _named_finding(
    figure: str, strange: float, share: float, limit: float, margin: float, unknown: Finding
) -> Finding:
    """Make the finding of a thing that words of no positive weight explain. It is bad above `limit`.

    share: of its strangeness `strange` that these words explain. unknown: the finding of the same figure of
    the uncertainty map. The reason is `blocked` when they explain enough of it, else still `unknown_object`.
    """
    reason = Reason.BLOCKED if share >= _EXPLAINED else Reason.UNKNOWN_OBJECT
    found = Finding.above(reason, figure, strange, limit, margin)
    if unknown.bad and reason is Reason.UNKNOWN_OBJECT:
        # `unknown` reports it already; a second finding must not delay the end of that reason
        return replace(found, bad=False, clear=True)
    return found


def _find_corridor(way: Passage) -> list[Finding]:
    """Report a closed corridor: as `blocked` where known ground closes it, else as `unknown_object`.

    It is also `blocked` where words of no positive weight explain enough of what closes it.
    """
    blocked = not way.open and (not way.passable or way.explained >= _EXPLAINED)
    unknown = not way.open and not blocked
    return [
        Finding(Reason.BLOCKED, CORRIDOR, bad=blocked, clear=way.passable_roomy and not blocked),
        Finding(Reason.UNKNOWN_OBJECT, CORRIDOR, bad=unknown, clear=way.roomy or blocked),
    ]


def _passage(maps: Maps, aspect: float, settings: Settings) -> Passage:
    """Judge the corridor, and where it is closed find its gap."""
    roomier = settings.corridor.roomier(_WIDER, settings.thresholds.margin)
    not_against = ~maps.not_drivable
    opened = is_open(maps.drivable, aspect, settings)
    passable = opened or is_open(not_against, aspect, settings)
    roomy = opened and is_open(maps.drivable, aspect, settings, roomier)
    free = roomy or (passable and is_open(not_against, aspect, settings, roomier))
    if opened:
        return Passage(open=True, passable=True, roomy=roomy, passable_roomy=free)
    gap = _gap(maps, ~maps.known if passable else maps.not_drivable, aspect, settings)
    share = 0.0
    if gap is not None:
        around = gap.box.grown(_AROUND).slices(*maps.signed.shape)
        share = explained(float(maps.strangeness[around].mean()), float(maps.uncertainty[around].mean()))
    return Passage(open=False, passable=passable, roomy=False, passable_roomy=free, gap=gap, explained=share)


def _gap(maps: Maps, missing: Mask, aspect: float, settings: Settings) -> Tile | None:
    """Return the square as large as a gap in which most pixels are `missing`, with its mean uncertainty."""
    found = worst_tile(missing.astype(np.float32), settings.region, aspect, settings.corridor.gap)
    if found is None:
        return None
    rows, columns = found.box.slices(*missing.shape)
    return Tile(found.box, float(maps.uncertainty[rows, columns].mean()))


def _named_tile(maps: Maps, aspect: float, settings: Settings, worst: Tile) -> NamedTile | None:
    """Find the tile of a thing whose word has no positive weight: the vehicle must be held for it.

    The word may be found in only a part of the thing, too small to close the corridor, or in another thing.
    The uncertainty is low there, so that the worst tile does not show it. Where the worst tile is over its
    threshold, only tiles outside of it are searched. None where no word has a weight of 0 or below.
    """
    if not maps.named.any():
        return None
    limit = settings.thresholds.tile
    calling = worst.box.mask(*maps.signed.shape) if limit is not None and worst.uncertainty > limit else None
    tile = worst_tile(maps.strangeness, settings.region, aspect, settings.tile, outside=calling)
    if tile is None:
        return None
    found = _with_word(maps, tile, float(maps.uncertainty[tile.box.slices(*maps.signed.shape)].mean()))
    if calling is None or found.explained >= _EXPLAINED:
        return found
    # What was found may be part of the thing that calls already, which may be larger than its tile. So search
    # for the tile in which words of no positive weight explain most.
    explained_difference = maps.strangeness - maps.uncertainty
    beside = worst_tile(explained_difference, settings.region, aspect, settings.tile, outside=calling)
    # its value is the difference, all of which these words explain: nothing is left
    return found if beside is None else _with_word(maps, beside, 0.0)


def _with_word(maps: Maps, tile: Tile, left: float) -> NamedTile:
    """Make a NamedTile with the word of no positive weight that explains most of the tile."""
    rows, columns = tile.box.slices(*maps.strangeness.shape)
    within = np.where(maps.named, maps.attention[:, rows, columns].mean(axis=(1, 2)), -1.0)
    return NamedTile(tile, min(left, tile.uncertainty), int(np.argmax(within)))


def find_scene(similarity: float | None, settings: Settings) -> list[Finding]:
    """Compare the scene's similarity with its threshold; None (no reference): no finding; NaN: a fault."""
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
