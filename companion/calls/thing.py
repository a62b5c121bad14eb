"""Holds one thing that an operator is asked about, or has answered about, and tracks it. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from anytraverse.assessment import CORRIDOR, NAMED_TILE, Assessment, Maps, Reason
from anytraverse.history import Embedding, cosine
from anytraverse.regions import Box
from companion.calls.numbers import Numbers
from companion.calls.tracking import (
    Mask,
    blocked_by_name,
    coarse,
    joined,
    resized,
    sized,
    track,
    uncertain_above,
)

REASONS_OF_THINGS = frozenset({Reason.UNKNOWN_OBJECT, Reason.BLOCKED})
_WIDENS = 1.5
"""A thing that comes nearer becomes wider and higher alike. Another one beside it makes the mask wider over
its height, by more than this factor.
"""
_ROOM, _MOST_ROOM = 0.02, 1.35
"""With each frame in which a thing widens evenly, and at most: how much wider it may turn out than it was at
its narrowest, beside `_WIDENS`. A far thing is few cells, so its shape is rough.
"""
_EVEN = 2
"""Cells by which a side of one thing moves outwards from frame to frame. What is put beside it adds more."""
_MEANT = 0.5
"""Of the smaller one of a thing and a tapped box: what both have in common where the thing was meant."""
_IN_VIEW = 2.0
"""How many times as long an accepted thing is accepted while it is in view. It may have been asked about from
13 m, and 10 m would then end right before it.
"""
_LITTLE = 0.25
"""Of the ROI: where less of it lies outside the things, means are still taken over this share."""


@dataclass
class Thing:
    """One object in one place, and what was said of it. A place without an object has no mask.

    reasons: what is asked, or was accepted, of it. mask: where it is, grown by one cell: (h, w) bool, coarse.
    shown: where it is in the call's frame.
    uncertainty, strangeness: highest accepted means over the ROI outside of all things, in [0, 1] (see
    `Maps`). So the thing may come nearer, and fill more of the ROI. Single pixels up to it may be driven
    over, too. beside: uncertainty of the worst tile outside of all things as it was asked about.
    shape: width over height of the mask, in cells, at its narrowest, and smoothed; infinite before. room: see
    `_ROOM`; 0 once it has not grown evenly.
    scene: embedding of its place, None where that is not known. call: id of the call that asks about it.
    since: when it was accepted, monotonic seconds. travelled: metres driven then, None where not known.
    blocked_by: the word of weight 0 or below that names it: it blocks. "" where it does not.
    clear_frames: frames in a row that do not show it. spent: its time or its distance is over.
    """

    reasons: frozenset[Reason]
    scene: Embedding | None = None
    call: int = 0
    since: float = 0.0
    travelled: float | None = None
    mask: Mask | None = None
    shown: Mask | None = None
    uncertainty: float = 0.0
    strangeness: float = 0.0
    beside: float = 0.0
    shape: float = math.inf
    room: float = 1.0
    blocked_by: str = ""
    clear_frames: int = field(default=0, compare=False)
    spent: bool = False

    def extend(self, mask: Mask) -> None:
        """Add `mask`, (h, w), to the thing."""
        self.mask = joined(self.mask, coarse(mask))

    def moved(self, seen: Assessment, numbers: Numbers, *, at_once: bool = False) -> Mask | None:
        """Return the thing's mask in this frame, or the last mask where nothing of it is found.

        at_once: all that is connected, as when it is asked about. Otherwise a mask that becomes much wider,
        and not as much higher, is not of the thing alone: another one stands beside it, outside of the last
        mask.
        """
        if self.mask is None or seen.maps is None:
            return self.mask
        numbers = numbers.at(seen)
        blocks = Reason.BLOCKED in self.reasons
        found = track(self.mask, seen, seen.maps, numbers, blocks=blocks, at_once=at_once)
        widest = _WIDENS * max(self.room, 1.0) * self.shape
        if at_once or _shape(found) <= widest or _widened(self.mask, found) <= 0:
            return found
        # What leaves the picture below looks wider than it is; beside what spans the ROI there is no room.
        bounds, columns = numbers.judging.region.bounds, np.flatnonzero(self.mask.any(axis=0))
        left, right = (int(side * (self.mask.shape[1] - 1)) for side in (bounds.left, bounds.right))
        spans = columns.size > 0 and columns[0] <= left and columns[-1] >= right
        return found if spans or found[-1].any() else self.mask

    def follow(self, mask: Mask | None) -> None:
        """Move to where `moved` found it."""
        before, self.mask = self.mask, mask
        if before is None or mask is None:
            return
        now = _shape(mask)
        self.shape = now if math.isinf(self.shape) else min(self.shape, (self.shape + now) / 2)
        wider = _widened(before, mask)
        if wider > _EVEN:
            self.room = 0.0
        elif wider > 0 and self.room:
            self.room = min(self.room + _ROOM, _MOST_ROOM)

    def measure(self, seen: Assessment, inside: Mask, numbers: Numbers) -> None:
        """Raise the accepted figures to those of a frame with the things `inside`, (h, w)."""
        if seen.roi is None or seen.maps is None:
            return
        uncertainty, strangeness = means_outside(seen.maps, inside, numbers.at(seen))
        self.uncertainty = max(self.uncertainty, uncertainty)
        # Without a name it was not accepted, so what has one is compared with what had none.
        named = Reason.BLOCKED in self.reasons or bool(self.blocked_by)
        self.strangeness = max(self.strangeness, strangeness if named else uncertainty)

    def is_place(self, seen: Assessment, numbers: Numbers) -> bool:
        """Whether the frame shows the accepted place."""
        here = scene_of(seen)
        if here is None or self.scene is None or Reason.UNKNOWN_SCENE not in self.reasons:
            return False
        return cosine(self.scene, here) >= numbers.judging.thresholds.scene

    def in_roi(self, seen: Assessment, numbers: Numbers) -> Mask:
        """Return what of its mask lies in the ROI, in the size of the frame's maps, (h, w)."""
        inside = sized(self.mask, seen)
        return inside & numbers.at(seen).judging.region.mask(*inside.shape)

    def overlap(self, box: Box, *, asked: bool = False) -> float:
        """Return what it and a box, in fractions of the frame, have in common: share of the smaller one.

        asked: the box is one of the call's frame. Otherwise it is one of the newest.
        """
        mask = self.shown if asked else self.mask
        if mask is None:
            return 0.0
        there = box.mask(*mask.shape)
        return int((mask & there).sum()) / max(1, min(int(mask.sum()), int(there.sum())))

    def is_meant(self, box: Box, *, asked: bool = False) -> bool:
        """Whether whoever taps this box means it, and not only what is beside it. asked: see `overlap`."""
        return self.overlap(box, asked=asked) > _MEANT

    def ended(self, seen: Assessment, numbers: Numbers, now: float, travelled: float | None) -> bool:
        """Whether the thing is gone, or an acceptance has used up its time or its distance.

        Both are twice as long while a thing is in view that is not accepted with its place. What blocks ends
        only when it is gone, or when its word has another sign or is not in use.
        """
        way = None if travelled is None or self.travelled is None else travelled - self.travelled
        in_view = Reason.UNKNOWN_SCENE not in self.reasons and self.in_roi(seen, numbers).any()
        longer = _IN_VIEW if in_view else 1.0
        self.spent = now - self.since >= longer * numbers.accepted_for
        self.spent = self.spent or (way or 0.0) >= longer * numbers.accepted_distance
        if self.blocked_by and seen.words.get(self.blocked_by, 1.0) > 0.0:
            return True
        if self.gone(seen, numbers):
            return True
        return self.spent and not self.blocked_by

    def gone(self, seen: Assessment, numbers: Numbers) -> bool:
        """Whether the last frames do not show the thing. It counts frames, so call it once a frame.

        Its outline has left the ROI, or is as drivable as a corridor and not uncertain. What does not block
        is gone as well where nothing of its outline is uncertain and no frame has a reason that it explains.
        """
        if Reason.FAULT not in seen.reasons:
            self.clear_frames = 0 if self._stays(seen, numbers) else self.clear_frames + 1
        return self.clear_frames >= numbers.ok_frames

    def _stays(self, seen: Assessment, numbers: Numbers) -> bool:
        named = Reason.UNKNOWN_OBJECT in self.reasons and blocked_by_name(seen)
        shown, maps = named or bool(seen.reasons & self.reasons), seen.maps
        if maps is None:
            return shown or bool(self.blocked_by)
        if shown and Reason.UNKNOWN_SCENE in seen.reasons and self.is_place(seen, numbers):
            return True
        here, limits = self.in_roi(seen, numbers), numbers.judging.thresholds
        if not (shown or self.blocked_by):
            # A figure may be just below its threshold for a while, as a small tile of a far thing is.
            return bool((here & (maps.uncertainty > uncertain_above(numbers))).any())
        clean = maps.drivable & (maps.uncertainty <= min(limits.roi, limits.tile or 1.0))
        return bool(here.any()) and float(clean[here].mean()) < numbers.judging.corridor.share


def _shape(mask: Mask) -> float:
    """Return the width over the height of what is set in a mask, in cells; 0 where nothing is."""
    columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
    return float((np.ptp(columns) + 1) / (np.ptp(rows) + 1)) if columns.size else 0.0


def _widened(before: Mask, mask: Mask) -> int:
    """Return by how many cells the left or the right edge of what is set moved outwards, the greater one."""
    before = resized(before, *mask.shape)
    was, now = np.flatnonzero(before.any(axis=0)), np.flatnonzero(mask.any(axis=0))
    return int(max(was[0] - now[0], now[-1] - was[-1])) if was.size and now.size else 0


def means_outside(maps: Maps, inside: Mask, numbers: Numbers) -> tuple[float, float]:
    """Return the mean uncertainty and strangeness over the ROI outside the mask `inside`, (h, w).

    Where tiles have no threshold, these means alone find another thing: then they are over the whole ROI.
    """
    region = numbers.judging.region.mask(*inside.shape)
    outside = region if numbers.judging.thresholds.tile is None else region & ~inside
    count = max(int(outside.sum()), round(_LITTLE * int(region.sum())), 1)
    return float(maps.uncertainty[outside].sum()) / count, float(maps.strangeness[outside].sum()) / count


def boxes_of(seen: Assessment, reasons: frozenset[Reason]) -> list[Box]:
    """Return a box for each thing that is asked about: the worst tile, the corridor's gap, the named tile."""
    roi = seen.roi
    if roi is None or seen.tile is None:
        return []
    bad = {(one.reason, one.figure) for one in seen.bad}
    boxes = []
    if Reason.UNKNOWN_OBJECT in reasons | seen.reasons or Reason.BLOCKED in reasons:
        boxes.append(seen.tile.box)
    if roi.corridor.gap is not None and any((reason, CORRIDOR) in bad for reason in reasons):
        boxes.append(roi.corridor.gap.box)
    if (Reason.BLOCKED, NAMED_TILE) in bad and Reason.BLOCKED in reasons and roi.named_tile is not None:
        boxes.append(roi.named_tile.tile.box)
    return boxes


def scene_of(seen: Assessment) -> Embedding | None:
    """Return the embedding of the frame's scene, None where the frame could not be judged."""
    return seen.observation.embedding if seen.observation is not None else None
