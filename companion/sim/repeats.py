"""Tells which calls ask again about what an operator has just answered, for the demo and for benchmarks.

A simulation or labels know what a call is about. A call asks again if its thing or patch of ground was
answered less than `THING_AGAIN_M` before, or its kind of ground less than `PLACE_AGAIN_M` before. These are
metres driven along the track, so that standing still ends nothing.
"""

from __future__ import annotations

THING_AGAIN_M = 25.0
"""Metres within which a call about an answered thing or patch of ground is a repeat."""
PLACE_AGAIN_M = 100.0
"""Metres within which a call about an answered kind of ground is a repeat."""

ThingId = int | str
"""The simulated thing, or the patch of ground, that a call is about."""


class AskedBefore:
    """Keeps where each thing and each kind of ground was answered last."""

    def __init__(self) -> None:
        self._things: dict[ThingId, float] = {}
        self._places: dict[str, float] = {}

    def answered(self, at_m: float, thing: ThingId | None, place: str | None) -> None:
        """Takes in an answer.

        at_m: metres driven so far, never less than before. thing: what the answer named or accepted. place:
        the kind of ground that it answered. None where the call was not about one.
        """
        if thing is not None:
            self._things[thing] = at_m
        if place is not None:
            self._places[place] = at_m

    def asks_again(self, at_m: float, thing: ThingId | None, place: str | None) -> bool:
        """Whether a call that opens at `at_m` is about something that was answered a moment ago.

        thing, place: what the call is about, as in `answered`. Ask before the call's own answer is taken in.
        """
        thing_at = None if thing is None else self._things.get(thing)
        place_at = None if place is None else self._places.get(place)
        return (thing_at is not None and at_m - thing_at < THING_AGAIN_M) or (
            place_at is not None and at_m - place_at < PLACE_AGAIN_M
        )
