"""What a "go" without words accepts, and where that ends."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from anytraverse.assessment import CORRIDOR, NAMED_MEAN, NAMED_TILE, Assessment, Maps, Reason
from anytraverse.history import Embedding, cosine
from anytraverse.judging import is_open
from anytraverse.regions import Box
from anytraverse.roi import KNOWN, worst_tile
from companion.calls.masks import Mask, below, coarse, connected, joined, resized, wider
from companion.calls.numbers import Numbers

_UNCERTAIN = 0.5
"""Uncertainty from which a pixel belongs to the thing, where tiles have no threshold."""


@dataclass
class Acceptance:
    """The accepted reasons, and what of them was seen.

    thing: where it is in the image, with a cell around it: (h, w), coarse; None where none was seen.
    uncertainty, strangeness: means of the ROI. beside: worst tile outside the thing.
    scene: embedding of the accepted place, None where it is not known.
    travelled: metres driven at the start, None where not known.
    """

    reasons: frozenset[Reason]
    thing: Mask | None
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
                accepted._add(shown.grown(1.5).mask(*seen.maps.signed.shape))
            if accepted.thing is not None:
                accepted._add(accepted._find(accepted.thing, seen, seen.maps, numbers, at_once=True))
                inside = accepted._inside(seen, numbers)
                covered = accepted._covers_way(seen, inside, numbers)
                if Reason.BLOCKED in reasons:
                    covered = covered and accepted._is_open(seen, seen.maps, inside, numbers)
                if not covered:
                    accepted._add(_missing(seen.maps, numbers))
        accepted.beside = _beside(seen, accepted._inside(seen, numbers), numbers, by_name=False)
        return accepted

    def joined(self, other: Acceptance) -> Acceptance:
        """This one, and where the other's thing is."""
        return replace(
            self,
            thing=joined(self.thing, other.thing),
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
        inside = self._inside(seen, numbers)
        if seen.roi is not None and _beside(seen, inside, numbers, by_name=False) <= limit:
            self.uncertainty = max(self.uncertainty, seen.roi.uncertainty)
            self.strangeness = max(self.strangeness, seen.roi.strangeness)
            self.follow(seen, numbers)

    def covers(self, seen: Assessment, numbers: Numbers) -> frozenset[Reason]:
        """Those of the frame's reasons that stay within what was accepted.

        Whether a thing has a name may change from frame to frame: an accepted one is covered either way.
        """
        covered, inside = seen.reasons & self.reasons, self._inside(seen, numbers)
        if Reason.UNKNOWN_OBJECT in covered:
            by_name = Reason.UNKNOWN_OBJECT in _named_reasons(seen)
            alone = self._covers_object(seen, inside, numbers, by_name=by_name)
            if not (alone and self._covers_way(seen, inside, numbers)):
                covered -= {Reason.UNKNOWN_OBJECT}
        if Reason.BLOCKED in covered and not self._covers_blocked(seen, inside, numbers):
            covered -= {Reason.BLOCKED}
        if Reason.UNKNOWN_SCENE in covered and not self._covers_scene(seen, numbers):
            covered -= {Reason.UNKNOWN_SCENE}
        if self._names_thing(seen) and self._covers_object(seen, inside, numbers, by_name=True):
            covered |= {Reason.BLOCKED} if self._covers_way(seen, inside, numbers) else set()
        return covered

    def follow(self, seen: Assessment, numbers: Numbers) -> None:
        """Move after the thing: down the image and wider, never up."""
        self.thing = self._moved(seen, numbers)

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

    def _add(self, mask: Mask) -> None:
        self.thing = joined(self.thing, coarse(mask))

    def _inside(self, seen: Assessment, numbers: Numbers) -> Mask:
        """What the thing fills of the frame's maps, (h, w)."""
        if seen.maps is None:
            return np.zeros((1, 1), dtype=np.bool_)
        moved = self._moved(seen, numbers)
        shape = seen.maps.signed.shape
        return np.zeros(shape, dtype=np.bool_) if moved is None else resized(moved, *shape)

    def _moved(self, seen: Assessment, numbers: Numbers) -> Mask | None:
        """The thing as it is in this frame; as it was where nothing is found of it."""
        if self.thing is None or seen.maps is None:
            return self.thing
        return self._find(self.thing, seen, seen.maps, numbers, at_once=False)

    def _find(self, thing: Mask, seen: Assessment, maps: Maps, numbers: Numbers, *, at_once: bool) -> Mask:
        """What is strange in the accepted thing and what touches it, with a cell around it.

        at_once: all that is uncertain and touches it; else no more than a tile's side, by which a thing comes
        nearer at most from frame to frame. Of what reaches further that is only what comes straight down: the
        rest is another thing, that touches it. What a word that is not drivable explains of the thing belongs
        to it: else that were a thing beside it. But what it explains may be the ground around, too: of that
        no more than a tile's side is taken at once, and later only what comes straight down.
        """
        limit = numbers.judging.thresholds.tile or _UNCERTAIN
        if any(one.figure == CORRIDOR for one in seen.bad):
            limit = min(limit, 1.0 - KNOWN)
        unsure, strange = maps.uncertainty > limit, maps.strangeness > limit
        if Reason.BLOCKED in self.reasons:
            unsure = unsure | (~maps.drivable & numbers.judging.region.mask(*unsure.shape))
        unsure, strange = coarse(unsure), coarse(strange)
        thing = resized(thing, *unsure.shape)
        side = _tile_side(unsure.shape[1], numbers)
        if at_once:
            found = connected(thing & unsure, unsure, max(unsure.shape))
            return wider(connected(found, strange, side))
        not_above, straight = below(thing, side), below(thing, 0)
        unsure = unsure & not_above
        found = connected(thing & unsure, unsure, side - 1)
        beyond = connected(found, unsure, 1) & ~found
        found = found & (straight | ~connected(beyond, unsure & ~thing, max(unsure.shape)))
        if _named_reasons(seen):
            found = found | connected(thing & strange, strange & straight, side - 1)
        return wider(found) & not_above if found.any() else thing

    def _covers_object(self, seen: Assessment, inside: Mask, numbers: Numbers, *, by_name: bool) -> bool:
        """Whether nothing strange is beside the thing. by_name: nor what is strange but for its name."""
        if seen.roi is None or self.thing is None:
            return False
        if not seen.roi.uncertainty <= self.uncertainty + numbers.accepted_rise:
            return False
        if by_name and any(one.figure == NAMED_MEAN for one in seen.bad):
            accepted = self.strangeness if Reason.BLOCKED in self.reasons else self.uncertainty
            if not seen.roi.strangeness <= accepted + numbers.accepted_rise:
                return False
        limit = numbers.judging.thresholds.tile
        return limit is None or _beside(seen, inside, numbers, by_name=by_name) <= limit

    def _covers_way(self, seen: Assessment, inside: Mask, numbers: Numbers) -> bool:
        """Whether the vehicle fits through where the thing is driven over, and what is as uncertain as seen.

        Or not even where all that is uncertain is driven over: then it is blocked, which is not asked here.
        """
        if seen.roi is None or seen.maps is None:
            return False
        way, maps = seen.roi.corridor, seen.maps
        if way.open or not way.passable:
            return True
        return self._is_open(seen, maps, inside & ~maps.not_drivable, numbers)

    def _covers_blocked(self, seen: Assessment, inside: Mask, numbers: Numbers) -> bool:
        """Whether nothing beside the thing is in the way, by any figure."""
        if seen.roi is None or seen.maps is None or self.thing is None:
            return False
        if _named_reasons(seen) and not self._covers_object(seen, inside, numbers, by_name=True):
            return False
        maps = seen.maps
        if not self._is_open(seen, maps, inside, numbers):
            return False
        beside = numbers.judging.region.mask(*inside.shape) & maps.known & ~inside
        drivable = int((maps.drivable & beside).sum())
        return drivable >= numbers.judging.thresholds.trav * int(beside.sum())

    def _is_open(self, seen: Assessment, maps: Maps, over: Mask, numbers: Numbers) -> bool:
        """Whether the vehicle fits through where it may drive `over` that, or over as uncertain as seen."""
        height, width = seen.frame.image.shape[:2]
        as_seen = (maps.uncertainty <= self.uncertainty + numbers.accepted_rise) & ~maps.not_drivable
        return is_open(maps.drivable | as_seen | over, width / height, numbers.judging)

    def _covers_scene(self, seen: Assessment, numbers: Numbers) -> bool:
        scene = scene_of(seen)
        if scene is None or self.scene is None:
            return False
        return cosine(self.scene, scene) >= numbers.judging.thresholds.scene


def _beside(seen: Assessment, inside: Mask, numbers: Numbers, *, by_name: bool) -> float:
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
        outside=inside,
    )
    return tile.uncertainty if tile is not None else 0.0


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


def scene_of(seen: Assessment) -> Embedding | None:
    """What the place looks like, None where nothing could be seen."""
    return seen.observation.embedding if seen.observation is not None else None


def _tile_side(width: int, numbers: Numbers) -> int:
    """Pixels of a map `width` pixels wide: a thing comes nearer by less than a tile from frame to frame."""
    bounds = numbers.judging.region.bounds
    return max(1, round(numbers.judging.tile_share * (bounds.right - bounds.left) * width))
