"""Decides which reasons of a frame are explained by things that were answered about. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from anytraverse.assessment import NAMED_MEAN, Assessment, Maps, Reason
from anytraverse.findings import is_open
from anytraverse.roi import worst_tile
from companion.calls.numbers import Numbers
from companion.calls.thing import Thing, means_outside
from companion.calls.tracking import Mask, blocked_by_name, named_reasons, sized

_FILLS = 0.1
"""Of the picture: a thing that covers as much, as a drum does from 3 m, changes the scene."""


class Cover:
    """Compares a frame with things, all together: what lies outside of all of them must call.

    It tracks the things only where it is asked for them: a frame without reasons needs nothing of it.
    """

    def __init__(self, things: Sequence[Thing], seen: Assessment, numbers: Numbers) -> None:
        self._things, self._seen, self._numbers = things, seen, numbers.at(seen)
        self._level = max((thing.uncertainty for thing in things), default=0.0) + numbers.accepted_rise

    @cached_property
    def masks(self) -> list[Mask | None]:
        """Where each thing is in the frame, coarse (h, w)."""
        return [thing.moved(self._seen, self._numbers) for thing in self._things]

    @cached_property
    def inside(self) -> Mask:
        """The union of the masks, in the size of the maps, (h, w)."""
        whole = sized(None, self._seen)
        for mask in self.masks:
            whole = whole | sized(mask, self._seen)
        return whole

    @cached_property
    def covered(self) -> frozenset[Reason]:
        """The frame's reasons that the things explain.

        Whether a word explains a thing may change from frame to frame. An accepted thing is covered in both
        cases: as unknown, and as blocked by its name.
        """
        seen = self._seen
        if not seen.reasons:
            return frozenset()
        asked = frozenset[Reason]().union(*(thing.reasons for thing in self._things))
        covered = seen.reasons & asked
        if Reason.UNKNOWN_OBJECT in covered:
            by_name = Reason.UNKNOWN_OBJECT in named_reasons(seen)
            if not (self.alone(by_name=by_name) and self._covers_corridor()):
                covered -= {Reason.UNKNOWN_OBJECT}
        if Reason.BLOCKED in covered and not self._covers_blocked():
            covered -= {Reason.BLOCKED}
        if not any(thing.is_place(seen, self._numbers) for thing in self._things):
            covered -= {Reason.UNKNOWN_SCENE}
        if Reason.UNKNOWN_SCENE in seen.reasons and self._fills_picture():
            covered |= {Reason.UNKNOWN_SCENE}
        if Reason.UNKNOWN_OBJECT in asked and blocked_by_name(seen) and self.alone(by_name=True):
            covered |= {Reason.BLOCKED} if self._covers_corridor() else set()
        return covered

    def alone(self, *, by_name: bool = False) -> bool:
        """Whether no other unknown thing is beside these.

        by_name: a thing that only a negative word explains counts, too.
        """
        seen, numbers = self._seen, self._numbers
        if seen.maps is None or all(mask is None for mask in self.masks):
            return False
        uncertainty, strangeness = means_outside(seen.maps, self.inside, numbers)
        if not uncertainty <= self._level:
            return False
        if by_name and any(one.figure == NAMED_MEAN for one in seen.bad):
            accepted = max(thing.strangeness for thing in self._things)
            if not strangeness <= accepted + numbers.accepted_rise:
                return False
        limit = numbers.judging.thresholds.tile
        return limit is None or self.beside(by_name=by_name) <= limit

    def passable(self, reasons: frozenset[Reason]) -> bool:
        """Whether the vehicle fits through over the things; what has a name only if `reasons` has BLOCKED."""
        maps, covered = self._seen.maps, self._covers_corridor()
        if Reason.BLOCKED in reasons and maps is not None:
            covered = covered and self._is_open(maps, self.inside)
        return covered

    def _fills_picture(self) -> bool:
        """Whether a thing covers so much of the picture that a changed scene is a matter of it."""
        lasting = (mask for thing, mask in zip(self._things, self.masks, strict=True) if not thing.spent)
        return any(mask is not None and float(mask.mean()) >= _FILLS for mask in lasting)

    def beside(self, *, by_name: bool = False) -> float:
        """Return the uncertainty of the worst tile of the ROI outside the things; 0 where none fits there.

        by_name: pixels that only a negative word explains count as unexplained.
        """
        judging, maps = self._numbers.judging, self._seen.maps
        if maps is None:
            return 1.0
        values = maps.strangeness if by_name else maps.uncertainty
        tile = worst_tile(values, judging.region, self._aspect, judging.tile, outside=self.inside)
        return tile.uncertainty if tile is not None else 0.0

    def _covers_corridor(self) -> bool:
        """Whether the vehicle fits through if it drives over the things, and over what is no more uncertain.

        True as well where it would not fit even over everything uncertain: that is a matter of BLOCKED.
        """
        roi, maps = self._seen.roi, self._seen.maps
        if roi is None or maps is None:
            return False
        if roi.corridor.open or not roi.corridor.passable:
            return True
        return self._is_open(maps, self.inside & ~maps.not_drivable)

    def _covers_blocked(self) -> bool:
        """Whether nothing but the accepted things blocks the way, by any figure."""
        maps = self._seen.maps
        if maps is None or all(mask is None for mask in self.masks):
            return False
        if named_reasons(self._seen) and not self.alone(by_name=True):
            return False
        if not self._is_open(maps, self.inside):
            return False
        judging = self._numbers.judging
        beside = judging.region.mask(*self.inside.shape) & maps.known & ~self.inside
        drivable = int((maps.drivable & beside).sum())
        return drivable >= judging.thresholds.trav * int(beside.sum())

    def _is_open(self, maps: Maps, over: Mask) -> bool:
        """Whether the vehicle fits through over the mask `over` and all other ground that it may drive over.

        That is drivable ground, and ground that is no more uncertain than what was accepted.
        """
        as_uncertain = (maps.uncertainty <= self._level) & ~maps.not_drivable
        return is_open(maps.drivable | as_uncertain | over, self._aspect, self._numbers.judging)

    @property
    def _aspect(self) -> float:
        height, width = self._seen.frame.image.shape[:2]
        return float(width / height)
