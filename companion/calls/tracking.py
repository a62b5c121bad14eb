"""Tracks an accepted thing from frame to frame, as a coarse mask. Pure."""

from __future__ import annotations

import numpy as np

from anytraverse.assessment import CORRIDOR, NAMED_MEAN, NAMED_TILE, Assessment, Maps, Reason
from anytraverse.roi import KNOWN
from companion.calls.masks import Mask, below, coarse, connected, resized, wider
from companion.calls.numbers import Numbers

_UNCERTAIN_PIXEL = 0.5
"""Uncertainty above which a pixel belongs to the thing, where tiles have no threshold."""
_REACH = 0.25
"""Over the ROI's width: a thing becomes wider by less than this from frame to frame."""
NAMED_FIGURES = frozenset({NAMED_TILE, NAMED_MEAN})
"""The figures of things that only a negative word explains."""


def named_reasons(seen: Assessment) -> frozenset[Reason]:
    """Return the frame's bad reasons that come from things which only a negative word explains."""
    return frozenset(one.reason for one in seen.bad if one.figure in NAMED_FIGURES)


def blocked_by_name(seen: Assessment) -> bool:
    """Whether the frame is blocked only by things that a negative word explains."""
    figures = {one.figure for one in seen.bad if one.reason is Reason.BLOCKED}
    passable = seen.roi is not None and seen.roi.corridor.passable
    return bool(figures) and figures <= NAMED_FIGURES | ({CORRIDOR} if passable else set())


def track(
    thing: Mask, seen: Assessment, maps: Maps, numbers: Numbers, *, blocks: bool, at_once: bool = False
) -> Mask:
    """Return the uncertain pixels in `thing` or at its foot, and those connected to them, grown by one cell.

    blocks: the thing blocks the way, so that ground in the ROI that is not drivable belongs to it, too.
    at_once: take all connected uncertain pixels, as when the thing is accepted. Otherwise the mask grows
    straight down, and by less than `_REACH` to the sides, since a thing comes no nearer than that from
    frame to frame. An uncertain area that reaches further belongs to another thing that touches this one.
    Of that area the mask takes only the pixels straight below it.

    Above the horizon, only what is straight above the thing belongs to it: what rises above it touches all
    that is unknown there.

    Pixels that a negative word explains belong to the thing, too. Left out, they would count as a second
    thing beside it. But the word may explain the ground around as well, so at most `_REACH` of such
    pixels is taken at the start, and later only those straight below.
    """
    limit = uncertain_above(numbers)
    if any(one.figure == CORRIDOR for one in seen.bad):
        # Above this uncertainty a pixel is missing in the corridor, whatever the tiles' threshold.
        limit = min(limit, 1.0 - KNOWN)
    uncertain, strange = maps.uncertainty > limit, maps.strangeness > limit
    if blocks:
        uncertain = uncertain | (~maps.drivable & numbers.judging.region.mask(*uncertain.shape))
    uncertain, strange = coarse(uncertain), coarse(strange)
    thing = resized(thing, *uncertain.shape)
    in_rows = np.arange(len(thing))[:, np.newaxis] >= round(_highest(numbers) * len(thing))
    reach = _reach(uncertain.shape[1], numbers)
    if at_once:
        found = connected(thing & uncertain, uncertain & in_rows, max(uncertain.shape))
        above = in_rows | found.any(axis=0)
        found = connected(found, uncertain & above, max(uncertain.shape))
        return wider(connected(found, strange & above, reach))
    not_above, straight = below(thing, reach), below(thing, 0)
    uncertain = uncertain & not_above & (in_rows | (thing & in_rows).any(axis=0))
    # A perceiver may see the foot of a thing apart from the rest, by a gap of one cell. Right before the
    # vehicle the foot comes down by more than the reach.
    down = connected(wider(thing) & straight & uncertain, uncertain & straight, max(uncertain.shape))
    found = connected(down, uncertain, reach - 1)
    beyond = connected(found, uncertain, 1) & ~found
    found = found & (straight | ~connected(beyond, uncertain & ~thing, max(uncertain.shape)))
    if named_reasons(seen):
        found = found | connected(thing & strange, strange & straight, reach - 1)
    return wider(found) & not_above if found.any() else thing


def uncertain_above(numbers: Numbers) -> float:
    """Return the uncertainty above which a pixel belongs to a thing."""
    return numbers.judging.thresholds.tile or _UNCERTAIN_PIXEL


def sized(thing: Mask | None, seen: Assessment) -> Mask:
    """Return the thing's mask in the size of the frame's maps, (h, w)."""
    if seen.maps is None:
        return np.zeros((1, 1), dtype=np.bool_)
    shape = seen.maps.signed.shape
    return np.zeros(shape, dtype=np.bool_) if thing is None else resized(thing, *shape)


def _highest(numbers: Numbers) -> float:
    """Return the horizon's row, in fractions of the height; the ROI's upper side where it is unknown."""
    top, horizon = numbers.judging.region.bounds.top, numbers.judging.corridor.horizon
    return horizon if 0.0 < horizon < top else top


def _reach(width: int, numbers: Numbers) -> int:
    """Return `_REACH` in pixels, for a map that is `width` pixels wide."""
    bounds = numbers.judging.region.bounds
    return max(1, round(_REACH * (bounds.right - bounds.left) * width))
