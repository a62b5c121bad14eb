"""Remembers the things that were answered about, until they are gone. Pure: time is an input."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from anytraverse.assessment import Assessment, Reason
from anytraverse.findings import tile_outside
from anytraverse.operations import Operation, taps_of, weights_of
from anytraverse.preferences import clean_word
from anytraverse.regions import Box
from companion.calls.cover import Cover
from companion.calls.numbers import Numbers
from companion.calls.thing import REASONS_OF_THINGS, Thing, boxes_of, scene_of

MOST = 8
"""The most things that are remembered; beyond it the oldest goes."""


class AnsweredThings:
    """The things that were accepted, or that block, oldest first: at most `MOST`."""

    def __init__(self, numbers: Numbers) -> None:
        self._numbers = numbers
        self.things: list[Thing] = []

    def __bool__(self) -> bool:
        """Whether anything is accepted, or blocks."""
        return bool(self.things)

    @property
    def accepted(self) -> frozenset[Reason]:
        """All reasons that are accepted of some thing or place."""
        return frozenset[Reason]().union(*(one.reasons for one in self.things if not one.blocked_by))

    def asked(self, seen: Assessment, reasons: frozenset[Reason]) -> tuple[Thing, Assessment]:
        """Return the thing that a call for `reasons` asks about, and the frame with the tile that shows it.

        The tile lies outside of the answered things, if one out there is over the threshold.
        """
        seen = self.pointed(seen)
        numbers, thing = self._numbers.at(seen), Thing(reasons, scene_of(seen))
        if seen.roi is None or seen.maps is None:
            return thing, seen
        for box in boxes_of(seen, reasons):
            thing.extend(box.grown(1.5).mask(*seen.maps.signed.shape))
        if thing.mask is not None:
            found = thing.moved(seen, numbers, at_once=True)
            if found is not None:
                thing.extend(found)
            if not Cover([*self.things, thing], seen, numbers).passable(reasons):
                # The things leave no corridor, so a go would have no effect: it is about all unknown.
                unexplained = ~seen.maps.known & ~seen.maps.drivable
                thing.extend(unexplained & numbers.judging.region.mask(*unexplained.shape))
        thing.shown, cover = thing.mask, Cover([*self.things, thing], seen, numbers)
        thing.measure(seen, cover.inside, numbers)
        thing.beside = cover.beside()
        return thing, seen

    def accept(self, thing: Thing, reasons: Iterable[Reason], now: float, travelled: float | None) -> None:
        """Accept `reasons` of a thing. It counts from now on, and does not block any more."""
        reasons = frozenset(reasons)
        mask = thing.mask if reasons & REASONS_OF_THINGS else None
        one = replace(thing, reasons=reasons, mask=mask, since=now, travelled=travelled)
        self._add(replace(one, blocked_by="", clear_frames=0))

    def name(self, thing: Thing, word: str, now: float, travelled: float | None) -> None:
        """Remember that `word`, whose weight is 0 or below, names a thing: it blocks."""
        one = replace(thing, reasons=frozenset({Reason.UNKNOWN_OBJECT}), since=now, travelled=travelled)
        self._add(replace(one, blocked_by=word, clear_frames=0))

    def watch(self, asked: Thing, seen: Assessment) -> None:
        """Track the thing of an open call, and raise its figures.

        Nothing is raised while another thing is beside it: the operator's picture does not show that one. Nor
        is what comes into its place later, once it is gone.
        """
        if asked.gone(seen, self._numbers):
            asked.mask = None
        cover = Cover([*self.things, asked], seen, self._numbers)
        if cover.alone() and cover.beside() <= asked.beside + self._numbers.accepted_rise:
            asked.follow(cover.masks[-1])
            asked.measure(seen, cover.inside, self._numbers)

    def cover(self, seen: Assessment) -> Cover:
        """Compare a frame with the things."""
        return Cover(self.things, seen, self._numbers)

    def block(self, seen: Assessment) -> frozenset[Reason]:
        """Return BLOCKED where a thing that blocks is in the ROI, also where its word does not find it."""
        blocks = any(one.blocked_by and one.in_roi(seen, self._numbers).any() for one in self.things)
        return frozenset({Reason.BLOCKED} if blocks else ())

    def follow(self, seen: Assessment, cover: Cover, now: float, travelled: float | None) -> None:
        """Move the things to where `cover` found them, and forget those that ended. Once a frame."""
        if not seen.reasons or cover.covered & REASONS_OF_THINGS or cover.alone():
            for one, mask in zip(self.things, cover.masks, strict=True):
                one.follow(mask)
        self._forget(lambda one: one.ended(seen, self._numbers, now, travelled))

    def forget(self) -> None:
        """Forget all things."""
        self.things.clear()

    def revoke(self, call: int) -> None:
        """Forget what a go to this call accepted."""
        self._forget(lambda one: one.call == call and not one.blocked_by)

    def forget_blocking(self) -> None:
        """Forget what blocks."""
        self._forget(lambda one: bool(one.blocked_by))

    def unblock(self, operations: Sequence[Operation]) -> None:
        """Forget what blocks where an answer gives its word a weight above 0, or taps it with one."""
        words = {clean_word(word) for word, weight in weights_of(operations).items() if weight > 0.0}
        taps = [Box(*tap.box) for tap in taps_of(operations) if tap.weight > 0.0]

        def drivable(one: Thing) -> bool:
            return one.blocked_by in words or any(map(one.is_meant, taps))

        self._forget(lambda one: bool(one.blocked_by) and drivable(one))

    def blocking(self, call: int) -> bool:
        """Whether the thing of this call blocks."""
        return any(one.call == call and one.blocked_by for one in self.things)

    @property
    def words(self) -> list[str]:
        """The words that name what blocks."""
        return [one.blocked_by for one in self.things if one.blocked_by]

    def pointed(self, seen: Assessment) -> Assessment:
        """Return the frame with the tile to ask about: outside of what was answered, if one calls there."""
        limit = self._numbers.judging.thresholds.tile
        if not self.things or limit is None or seen.maps is None:
            return seen
        height, width = seen.frame.image.shape[:2]
        inside = self.cover(seen).inside
        tile = tile_outside(seen.maps, width / height, self._numbers.at(seen).judging, inside)
        return seen if tile is None or tile.uncertainty <= limit else replace(seen, asked=tile)

    def _add(self, thing: Thing) -> None:
        self._forget(lambda one: one.call == thing.call != 0)
        self.things = [*self.things, thing][-MOST:]

    def _forget(self, ends: Callable[[Thing], bool]) -> None:
        self.things = [one for one in self.things if not ends(one)]
