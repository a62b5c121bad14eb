"""Answers the calls of `make demo AUTO=1` by a table, as a person who looks at the picture would."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

WORDS_FOR_PLACE: Mapping[str, str] = {
    "meadow": "grass: 1; dirt path: 1",
    "forest": "dirt path: 1; tree: -1; bush: -1",
    "gravel": "gravel: 1; dry grass: 0.3",
}
"""The words with which the operator answers a call for each place."""

GROUND: Mapping[str, str] = {"meadow": "grass", "forest": "dirt path", "gravel": "dry grass"}
"""The word for the ground where a call was needless: a tuft between the ruts, litter on the path."""

THINK = 0.8
"""Seconds that the operator looks at a call before answering."""


@dataclass
class _Seen:
    since: float
    stage: str
    tries: int = 0


@dataclass
class AutoOperator:
    """Answers every call: a place with its words, a thing with a tap on it.

    It never accepts a thing that is in the way: that keeps its weight -1 until it is gone.
    """

    _calls: dict[int, _Seen] = field(default_factory=dict)

    def answer(self, call: Mapping[str, Any], place: str, thing: str | None, now: float) -> str | None:
        """Returns the line to type now for an open call or hold; None while it waits.

        call: its newest event. place: the zone that the rover is in. thing: the kind of the nearest thing
        ahead, None where there is none. now: s of a steady clock.
        """
        seen = self._calls.setdefault(call["id"], _Seen(now, call["stage"]))
        if seen.stage != call["stage"]:
            seen.stage, seen.since, seen.tries = call["stage"], now, 0
        if now - seen.since < THINK * (1 + 2 * seen.tries):
            return None
        line = self._line(call, place, thing, seen.tries)
        if line is not None:
            seen.tries += 1
        return line

    def _line(self, call: Mapping[str, Any], place: str, thing: str | None, tries: int) -> str | None:
        if call["kind"] == "hold" or call["stage"] != "open":
            goes = call["stage"] == "clear" or (call["stage"] == "open" and thing is None)
            return "go" if tries == 0 and goes else None
        if "unknown_scene" in call["reasons"] and tries == 0:
            return f"{WORDS_FOR_PLACE[place]}, go"
        if thing is not None:
            return f"tap {thing} -1 go" if tries <= 2 else None
        if "unknown_scene" in call["reasons"] or tries > 0:
            return "go"
        return f"tap {GROUND[place]} 1 go"
