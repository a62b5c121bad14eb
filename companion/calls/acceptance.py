"""Decides what a "go" without words accepts, and when that ends."""

from __future__ import annotations

from dataclasses import dataclass, replace

from anytraverse.assessment import CORRIDOR, NAMED_MEAN, NAMED_TILE, Assessment, Maps, Reason
from anytraverse.findings import is_open
from anytraverse.history import Embedding, cosine
from anytraverse.regions import Box
from anytraverse.roi import worst_tile
from companion.calls.masks import Mask, coarse, joined
from companion.calls.numbers import Numbers
from companion.calls.tracking import NAMED_FIGURES, named_reasons, sized, track


@dataclass
class Acceptance:
    """The accepted reasons, and the limits within which they are accepted.

    thing: mask of the accepted thing, grown by one cell: (h, w) bool, coarse. None where none was seen.
    uncertainty, strangeness: means over the ROI as accepted, in [0, 1] (see `Maps`).
    beside: uncertainty of the worst tile outside the thing, in [0, 1].
    scene: embedding of the accepted place, None where it is not known.
    since: start, monotonic seconds. travelled: metres driven at the start, None where not known.
    clear_frames: frames in a row without the thing.
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
        """Accept `reasons` as far as the frame `seen` shows them."""
        accepted = cls(reasons, None, 0.0, 0.0, 0.0, scene_of(seen), now, travelled)
        inside = sized(None, seen)
        if seen.roi is not None and seen.maps is not None:
            accepted.uncertainty, accepted.strangeness = seen.roi.uncertainty, seen.roi.strangeness
            for box in _accepted_boxes(seen, reasons):
                accepted._extend(box.grown(1.5).mask(*seen.maps.signed.shape))
            if accepted.thing is not None:
                accepted.thing = joined(accepted.thing, accepted._moved(seen, numbers, at_once=True))
                inside = sized(accepted._moved(seen, numbers), seen)
                covered = accepted._covers_corridor(seen, inside, numbers)
                if Reason.BLOCKED in reasons:
                    covered = covered and accepted._is_open(seen, seen.maps, inside, numbers)
                if not covered:
                    # The thing alone leaves no corridor, so the go would have no effect: accept all unknown.
                    accepted._extend(_unexplained_in_roi(seen.maps, numbers))
                    inside = sized(accepted._moved(seen, numbers), seen)
        accepted.beside = _beside(seen, inside, numbers, by_name=False)
        return accepted

    def joined(self, other: Acceptance) -> Acceptance:
        """Return this acceptance, extended by the other's thing and its figures."""
        return replace(
            self,
            thing=joined(self.thing, other.thing),
            uncertainty=max(self.uncertainty, other.uncertainty),
            strangeness=max(self.strangeness, other.strangeness),
        )

    def watch(self, seen: Assessment, numbers: Numbers) -> None:
        """Track the thing while the call is open, and raise the accepted figures as it comes nearer.

        Nothing is raised while another thing is beside it: the operator's picture does not show that one.
        """
        limit = numbers.judging.thresholds.tile
        if limit is None:
            limit = self.beside + numbers.accepted_rise
        moved = self._moved(seen, numbers)
        if seen.roi is not None and _beside(seen, sized(moved, seen), numbers, by_name=False) <= limit:
            self.uncertainty = max(self.uncertainty, seen.roi.uncertainty)
            self.strangeness = max(self.strangeness, seen.roi.strangeness)
            self.thing = moved

    def covers(self, seen: Assessment, numbers: Numbers) -> tuple[frozenset[Reason], Mask | None]:
        """Return the frame's reasons that are within what was accepted, and the thing's mask in the frame.

        Whether a word explains a thing may change from frame to frame. An accepted thing is covered in both
        cases: as unknown, and as blocked by its name.
        """
        if not seen.reasons:
            return frozenset(), self.thing
        covered, moved = seen.reasons & self.reasons, self._moved(seen, numbers)
        inside = sized(moved, seen)
        if Reason.UNKNOWN_OBJECT in covered:
            by_name = Reason.UNKNOWN_OBJECT in named_reasons(seen)
            alone = self._covers_object(seen, inside, numbers, by_name=by_name)
            if not (alone and self._covers_corridor(seen, inside, numbers)):
                covered -= {Reason.UNKNOWN_OBJECT}
        if Reason.BLOCKED in covered and not self._covers_blocked(seen, inside, numbers):
            covered -= {Reason.BLOCKED}
        if Reason.UNKNOWN_SCENE in covered and not self._covers_scene(seen, numbers):
            covered -= {Reason.UNKNOWN_SCENE}
        if self._blocked_by_accepted(seen) and self._covers_object(seen, inside, numbers, by_name=True):
            covered |= {Reason.BLOCKED} if self._covers_corridor(seen, inside, numbers) else set()
        return covered, moved

    def follow(self, thing: Mask | None) -> None:
        """Move the mask to where `covers` found the thing. It moves down the image and grows, never up."""
        self.thing = thing

    def ended(self, seen: Assessment, numbers: Numbers, now: float, travelled: float | None) -> bool:
        """Whether the thing is gone, or the time or the distance is used up.

        It counts clear frames, so call it once a frame.
        """
        if seen.reasons & self.reasons or self._blocked_by_accepted(seen):
            self.clear_frames = 0
        elif Reason.FAULT not in seen.reasons:
            self.clear_frames += 1
        too_far = (
            travelled is not None
            and self.travelled is not None
            and travelled - self.travelled >= numbers.accepted_distance
        )
        return self.clear_frames >= numbers.ok_frames or now - self.since >= numbers.accepted_for or too_far

    def _blocked_by_accepted(self, seen: Assessment) -> bool:
        """Whether an unknown thing was accepted, and the frame is blocked only by a thing with a name."""
        return Reason.UNKNOWN_OBJECT in self.reasons and blocked_by_name(seen)

    def _extend(self, mask: Mask) -> None:
        self.thing = joined(self.thing, coarse(mask))

    def _moved(self, seen: Assessment, numbers: Numbers, *, at_once: bool = False) -> Mask | None:
        """Return the thing's mask in this frame, or the last mask where nothing of it is found."""
        if self.thing is None or seen.maps is None:
            return self.thing
        blocks = Reason.BLOCKED in self.reasons
        return track(self.thing, seen, seen.maps, numbers, blocks=blocks, at_once=at_once)

    def _covers_object(self, seen: Assessment, inside: Mask, numbers: Numbers, *, by_name: bool) -> bool:
        """Whether no other unknown thing is beside the accepted one.

        by_name: a thing that only a negative word explains counts, too.
        """
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

    def _covers_corridor(self, seen: Assessment, inside: Mask, numbers: Numbers) -> bool:
        """Whether the vehicle fits through if it drives over the thing, and over what is no more uncertain.

        True as well where it would not fit even over everything uncertain: that is a matter of BLOCKED.
        """
        if seen.roi is None or seen.maps is None:
            return False
        corridor, maps = seen.roi.corridor, seen.maps
        if corridor.open or not corridor.passable:
            return True
        return self._is_open(seen, maps, inside & ~maps.not_drivable, numbers)

    def _covers_blocked(self, seen: Assessment, inside: Mask, numbers: Numbers) -> bool:
        """Whether nothing but the accepted thing blocks the way, by any figure."""
        if seen.roi is None or seen.maps is None or self.thing is None:
            return False
        if named_reasons(seen) and not self._covers_object(seen, inside, numbers, by_name=True):
            return False
        maps = seen.maps
        if not self._is_open(seen, maps, inside, numbers):
            return False
        beside = numbers.judging.region.mask(*inside.shape) & maps.known & ~inside
        drivable = int((maps.drivable & beside).sum())
        return drivable >= numbers.judging.thresholds.trav * int(beside.sum())

    def _is_open(self, seen: Assessment, maps: Maps, over: Mask, numbers: Numbers) -> bool:
        """Whether the vehicle fits through over the mask `over` and all other ground that it may drive over.

        That is drivable ground, and ground that is no more uncertain than what was accepted.
        """
        height, width = seen.frame.image.shape[:2]
        as_uncertain = (maps.uncertainty <= self.uncertainty + numbers.accepted_rise) & ~maps.not_drivable
        return is_open(maps.drivable | as_uncertain | over, width / height, numbers.judging)

    def _covers_scene(self, seen: Assessment, numbers: Numbers) -> bool:
        scene = scene_of(seen)
        if scene is None or self.scene is None:
            return False
        return cosine(self.scene, scene) >= numbers.judging.thresholds.scene


def _beside(seen: Assessment, inside: Mask, numbers: Numbers, *, by_name: bool) -> float:
    """Return the uncertainty of the worst tile of the ROI outside the thing; 0 where no tile fits there.

    by_name: pixels that only a negative word explains count as unexplained.
    """
    if seen.maps is None:
        return 1.0
    height, width = seen.frame.image.shape[:2]
    judging = numbers.judging
    tile = worst_tile(
        seen.maps.strangeness if by_name else seen.maps.uncertainty,
        judging.region,
        width / height,
        judging.tile_side,
        outside=inside,
    )
    return tile.uncertainty if tile is not None else 0.0


def blocked_by_name(seen: Assessment) -> bool:
    """Whether the frame is blocked only by things that a negative word explains."""
    figures = {one.figure for one in seen.bad if one.reason is Reason.BLOCKED}
    passable = seen.roi is not None and seen.roi.corridor.passable
    return bool(figures) and figures <= NAMED_FIGURES | ({CORRIDOR} if passable else set())


def _accepted_boxes(seen: Assessment, reasons: frozenset[Reason]) -> list[Box]:
    """Return a box for each thing that is accepted: the worst tile, the corridor's gap, the named tile."""
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


def _unexplained_in_roi(maps: Maps, numbers: Numbers) -> Mask:
    """Return the mask of what is neither known nor drivable in the ROI, (h, w)."""
    return ~maps.known & ~maps.drivable & numbers.judging.region.mask(*maps.drivable.shape)


def scene_of(seen: Assessment) -> Embedding | None:
    """Return the embedding of the frame's scene, None where the frame could not be judged."""
    return seen.observation.embedding if seen.observation is not None else None
