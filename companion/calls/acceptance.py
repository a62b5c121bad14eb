"""What a "go" without words accepts, and where that ends."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from anytraverse.assessment import CORRIDOR, NAMED_MEAN, NAMED_TILE, Assessment, Maps, Reason
from anytraverse.history import Embedding, cosine
from anytraverse.judging import is_open
from anytraverse.regions import Box
from anytraverse.roi import KNOWN, worst_tile
from companion.calls.numbers import Numbers

Mask = NDArray[np.bool_]

_MARGIN = 1.15
"""How much larger than what is found of the thing its box is."""
_UNCERTAIN = 0.5
"""Uncertainty from which a pixel belongs to the thing, where tiles have no threshold."""
_CELLS = 96
"""A thing is followed in maps of at most so many cells a side: larger ones are made coarser."""


@dataclass
class Acceptance:
    """The accepted reasons, and what of them was seen.

    box: where the thing is in the image, None where none was seen.
    uncertainty, strangeness: means of the ROI. beside: worst tile outside the box.
    scene: embedding of the accepted place, None where it is not known.
    travelled: metres driven at the start, None where not known.
    """

    reasons: frozenset[Reason]
    box: Box | None
    uncertainty: float
    strangeness: float
    beside: float
    scene: Embedding | None
    since: float
    travelled: float | None
    clear_frames: int = 0

    @classmethod
    def of(
        cls,
        seen: Assessment,
        reasons: frozenset[Reason],
        numbers: Numbers,
        now: float,
        travelled: float | None,
    ) -> Acceptance:
        """Accept `reasons` as they are in `seen`."""
        accepted = cls(reasons, None, 0.0, 0.0, 0.0, scene_of(seen), now, travelled)
        if seen.roi is not None and seen.maps is not None:
            accepted.uncertainty, accepted.strangeness = seen.roi.uncertainty, seen.roi.strangeness
            for shown in _shown(seen, reasons):
                accepted.box = shown.grown(1.5).joined(accepted.box)
                accepted.box = accepted.box.joined(accepted._find(seen, seen.maps, numbers, at_once=True))
            if accepted.box is not None and not accepted._covers_way(seen, numbers):
                accepted.box = accepted.box.joined(Box.around(_missing(seen.maps, numbers)))
        accepted.beside = accepted._beside(seen, numbers, by_name=False)
        return accepted

    def joined(self, other: Acceptance) -> Acceptance:
        """This one, and where the other's thing is."""
        return replace(
            self,
            box=self.box.joined(other.box) if self.box is not None else other.box,
            uncertainty=max(self.uncertainty, other.uncertainty),
            strangeness=max(self.strangeness, other.strangeness),
        )

    def watch(self, seen: Assessment, numbers: Numbers) -> None:
        """Follow the thing while the call is open, with the uncertainty as it comes nearer.

        What turns up beside it was not in the picture that the operator is asked about.
        """
        limit = numbers.judging.thresholds.tile
        if limit is None:
            limit = self.beside + numbers.accepted_rise
        if seen.roi is not None and self._beside(seen, numbers, by_name=False) <= limit:
            self.uncertainty = max(self.uncertainty, seen.roi.uncertainty)
            self.strangeness = max(self.strangeness, seen.roi.strangeness)
            self.follow(seen, numbers)

    def covers(self, seen: Assessment, numbers: Numbers) -> frozenset[Reason]:
        """Those of the frame's reasons that stay within what was accepted.

        Whether a thing has a name may change from frame to frame: an accepted one is covered either way.
        """
        covered = seen.reasons & self.reasons
        if Reason.UNKNOWN_OBJECT in covered:
            by_name = Reason.UNKNOWN_OBJECT in _named_reasons(seen)
            if not (self._covers_object(seen, numbers, by_name=by_name) and self._covers_way(seen, numbers)):
                covered -= {Reason.UNKNOWN_OBJECT}
        if Reason.BLOCKED in covered and not self._covers_blocked(seen, numbers):
            covered -= {Reason.BLOCKED}
        if Reason.UNKNOWN_SCENE in covered and not self._covers_scene(seen, numbers):
            covered -= {Reason.UNKNOWN_SCENE}
        if self._names_thing(seen) and self._covers_object(seen, numbers, by_name=True):
            covered |= {Reason.BLOCKED} if self._covers_way(seen, numbers) else set()
        return covered

    def follow(self, seen: Assessment, numbers: Numbers) -> None:
        """Move the box after the thing: down the image and wider, never up."""
        self.box = self._moved(seen, numbers)

    def ended(self, seen: Assessment, numbers: Numbers, now: float, travelled: float | None) -> bool:
        """Whether the thing is gone, or the time or distance is over. Counts frames: once a frame."""
        if seen.reasons & self.reasons or self._names_thing(seen):
            self.clear_frames = 0
        elif Reason.FAULT not in seen.reasons:
            self.clear_frames += 1
        too_far = (
            travelled is not None
            and self.travelled is not None
            and travelled - self.travelled >= numbers.accepted_distance
        )
        return self.clear_frames >= numbers.ok_frames or now - self.since >= numbers.accepted_for or too_far

    def _names_thing(self, seen: Assessment) -> bool:
        """Whether an unknown thing was accepted and the frame is blocked by a tile with a name alone."""
        return Reason.UNKNOWN_OBJECT in self.reasons and blocked_by_name(seen)

    def _moved(self, seen: Assessment, numbers: Numbers) -> Box | None:
        """The box around the thing as it is in this frame; as it was where nothing is found of it."""
        if self.box is None or seen.maps is None:
            return self.box
        found = self._find(seen, seen.maps, numbers, at_once=False)
        if found is None:
            return self.box
        top = max(found.top, min(self.box.top, found.bottom - 1e-3))
        return Box(found.left, top, found.right, found.bottom)

    def _find(self, seen: Assessment, maps: Maps, numbers: Numbers, *, at_once: bool) -> Box | None:
        """The box around what is strange in the accepted box and what touches it.

        at_once: all that is uncertain and touches it; else no more than a tile's side, by which a thing comes
        nearer at most from frame to frame. What a word that is not drivable explains of the thing belongs to
        it: else that were a thing beside it. But what it explains may be the ground around, too: of that no
        more than a tile's side is taken at once, and later only what comes straight down.
        """
        if self.box is None:
            return None
        limit = numbers.judging.thresholds.tile or _UNCERTAIN
        if any(one.figure == CORRIDOR for one in seen.bad):
            limit = min(limit, 1.0 - KNOWN)
        unsure, strange = maps.uncertainty > limit, maps.strangeness > limit
        if Reason.BLOCKED in self.reasons:
            unsure = unsure | (~maps.drivable & numbers.judging.region.mask(*unsure.shape))
        unsure, strange = _coarse(unsure), _coarse(strange)
        box, side = self.box.mask(*unsure.shape), _tile_side(unsure.shape[1], numbers)
        thing = _connected(unsure & box, unsure, max(unsure.shape) if at_once else side)
        if at_once:
            thing = _connected(thing, strange, side)
        elif _named_reasons(seen):
            below = Box(self.box.left, self.box.top, self.box.right, 1.0).mask(*strange.shape)
            thing = thing | _connected(strange & box, strange & below, side)
        found = Box.around(thing)
        return None if found is None else found.grown(_MARGIN)

    def _beside(self, seen: Assessment, numbers: Numbers, *, by_name: bool) -> float:
        """Uncertainty of the worst tile of the ROI beside the thing; 0 when there is no room for one.

        by_name: what was named as not drivable counts as if it had no name.
        """
        if seen.maps is None:
            return 1.0
        height, width = seen.frame.image.shape[:2]
        judging = numbers.judging
        tile = worst_tile(
            seen.maps.strangeness if by_name else seen.maps.uncertainty,
            judging.region,
            width / height,
            judging.tile_share,
            outside=self._moved(seen, numbers),
        )
        return tile.uncertainty if tile is not None else 0.0

    def _covers_object(self, seen: Assessment, numbers: Numbers, *, by_name: bool) -> bool:
        """Whether nothing strange is beside the thing. by_name: nor what is strange but for its name."""
        if seen.roi is None or self.box is None:
            return False
        if not seen.roi.uncertainty <= self.uncertainty + numbers.accepted_rise:
            return False
        if by_name and any(one.figure == NAMED_MEAN for one in seen.bad):
            accepted = self.strangeness if Reason.BLOCKED in self.reasons else self.uncertainty
            if not seen.roi.strangeness <= accepted + numbers.accepted_rise:
                return False
        limit = numbers.judging.thresholds.tile
        return limit is None or self._beside(seen, numbers, by_name=by_name) <= limit

    def _covers_way(self, seen: Assessment, numbers: Numbers) -> bool:
        """Whether the vehicle fits through where the thing is driven over, and what is as uncertain as seen.

        Or not even where all that is uncertain is driven over: then it is blocked, which is not asked here.
        """
        if seen.roi is None or seen.maps is None:
            return False
        way, maps = seen.roi.corridor, seen.maps
        if way.open or not way.passable:
            return True
        accepted = maps.uncertainty <= self.uncertainty + numbers.accepted_rise
        if (box := self._moved(seen, numbers)) is not None:
            accepted |= box.mask(*accepted.shape)
        return self._is_open(seen, maps.drivable | (accepted & ~maps.not_drivable), numbers)

    def _covers_blocked(self, seen: Assessment, numbers: Numbers) -> bool:
        """Whether nothing beside the thing is in the way, by any figure."""
        box = self._moved(seen, numbers)
        if seen.roi is None or seen.maps is None or box is None:
            return False
        if _named_reasons(seen) and not self._covers_object(seen, numbers, by_name=True):
            return False
        maps, inside = seen.maps, box.mask(*seen.maps.drivable.shape)
        if not self._is_open(seen, ~maps.not_drivable | inside, numbers):
            return False
        beside = numbers.judging.region.mask(*inside.shape) & maps.known & ~inside
        drivable = int((maps.drivable & beside).sum())
        return drivable >= numbers.judging.thresholds.trav * int(beside.sum())

    def _is_open(self, seen: Assessment, drivable: Mask, numbers: Numbers) -> bool:
        height, width = seen.frame.image.shape[:2]
        return is_open(drivable, width / height, numbers.judging)

    def _covers_scene(self, seen: Assessment, numbers: Numbers) -> bool:
        scene = scene_of(seen)
        if scene is None or self.scene is None:
            return False
        return cosine(self.scene, scene) >= numbers.judging.thresholds.scene


_NAMED = frozenset({NAMED_TILE, NAMED_MEAN})


def _named_reasons(seen: Assessment) -> frozenset[Reason]:
    """What a thing that is strange but for its name makes the frame bad for."""
    return frozenset(one.reason for one in seen.bad if one.figure in _NAMED)


def blocked_by_name(seen: Assessment) -> bool:
    """Whether the frame is blocked by what has a name, and by nothing else."""
    figures = {one.figure for one in seen.bad if one.reason is Reason.BLOCKED}
    passable = seen.roi is not None and seen.roi.corridor.passable
    return bool(figures) and figures <= _NAMED | ({CORRIDOR} if passable else set())


def _shown(seen: Assessment, reasons: frozenset[Reason]) -> list[Box]:
    """Where what is accepted is: a tile of each, none where nothing of the kind is."""
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


def _missing(maps: Maps, numbers: Numbers) -> Mask:
    """What is uncertain in the ROI, (h, w)."""
    return ~maps.known & ~maps.drivable & numbers.judging.region.mask(*maps.drivable.shape)


def _coarse(mask: Mask) -> Mask:
    """The mask in at most `_CELLS` cells a side: one counts where any of its pixels does."""
    for axis in (0, 1):
        step = -(-mask.shape[axis] // _CELLS)
        if step > 1:
            mask = np.logical_or.reduceat(mask, np.arange(0, mask.shape[axis], step), axis=axis)
    return mask


def scene_of(seen: Assessment) -> Embedding | None:
    """What the place looks like, None where nothing could be seen."""
    return seen.observation.embedding if seen.observation is not None else None


def _tile_side(width: int, numbers: Numbers) -> int:
    """Pixels of a map `width` pixels wide: a thing comes nearer by less than a tile from frame to frame."""
    bounds = numbers.judging.region.bounds
    return max(1, round(numbers.judging.tile_share * (bounds.right - bounds.left) * width))


def _connected(seed: Mask, within: Mask, steps: int) -> Mask:
    """`seed` and the pixels of `within` that lead to it over at most `steps` of their sides."""
    for _ in range(steps):
        spread = seed.copy()
        spread[1:] |= seed[:-1]
        spread[:-1] |= seed[1:]
        spread[:, 1:] |= seed[:, :-1]
        spread[:, :-1] |= seed[:, 1:]
        spread &= within
        if np.array_equal(spread, seed):
            break
        seed = spread
    return seed
