"""Answers the calls of `make demo AUTO=1` by a table, as a person who looks at the picture would."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from companion.sim.demo.onlooker import Shown

WORDS_FOR_PLACE: Mapping[str, str] = {
    "meadow": "grass: 1; dirt path: 1",
    "forest": "dirt path: 1; tree: -1; bush: -1",
    "gravel": "gravel: 1; dry grass: 0.3",
}
"""The words with which the operator answers a call for each place."""

DRY = "gravel"
"""The place whose grass is dry, which has a word of its own."""

THINK = 0.8
"""Seconds that the operator looks at a call before answering."""
HEARS_WITHIN = 20.0
"""Seconds for which the operator waits to hear of an answer: a busy computer takes its time."""


@dataclass
class _Seen:
    since: float
    stage: str
    tries: int = 0
    typed_at: float | None = None
    """When an answer was typed of which nothing was heard yet."""


@dataclass
class AutoOperator:
    """Answers every call by what its box shows: a place with its words, a thing or the ground with a tap.

    It never accepts a thing: that keeps its weight -1 until it is gone.
    """

    _calls: dict[int, _Seen] = field(default_factory=dict)

    def answer(
        self, call: Mapping[str, Any], shown: Shown, now: float, *, stands_there: bool = False
    ) -> str | None:
        """Returns the line to type now for an open call or hold; None while it waits.

        call: its newest event. shown: what it is about. now: s of a steady clock. stands_there: what it is
        about is still in the way, whatever the daemon makes of it.
        """
        seen = self._calls.setdefault(call["id"], _Seen(now, call["stage"]))
        if seen.stage != call["stage"]:
            seen.stage, seen.since, seen.tries, seen.typed_at = call["stage"], now, 0, None
        unheard = seen.typed_at is not None and now - seen.typed_at < HEARS_WITHIN
        if unheard or now - seen.since < THINK * (1 + 2 * seen.tries):
            return None
        line = self._line(call, shown, seen.tries, stands_there=stands_there)
        if line is not None:
            seen.tries += 1
            seen.typed_at = now
        return line

    def heard(self, number: int, result: str) -> None:
        """Takes in what became of an answer to a call; one that was too early is given again."""
        seen = self._calls.get(number)
        if seen is not None and seen.typed_at is not None:
            seen.typed_at = None
            seen.tries -= result == "busy"

    def _line(self, call: Mapping[str, Any], shown: Shown, tries: int, *, stands_there: bool) -> str | None:
        thing = shown.thing is not None
        own = "".join(f" {side:.4f}" for side in shown.outline or ())
        tap = f"tap {shown.kind} -1{own} go" if tries <= 2 else None
        if thing and stands_there and call["kind"] == "call" and call["stage"] == "clear":
            return tap  # what the rover takes for a clear way is none
        if call["kind"] == "hold" or call["stage"] != "open":
            goes = call["stage"] == "clear" or (call["stage"] == "open" and not thing)
            goes = goes and not stands_there
            return "go" if tries == 0 and goes else None
        if "unknown_scene" in call["reasons"] and tries == 0:
            return f"{WORDS_FOR_PLACE[shown.zone]}, go"
        if thing:
            return tap
        if "unknown_scene" in call["reasons"] or tries > 0 or not shown.kind:
            return "go"
        dry = shown.kind == "grass" and shown.zone == DRY
        return f"tap {'dry grass' if dry else shown.kind} 1 go"
