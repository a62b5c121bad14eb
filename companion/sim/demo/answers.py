"""Who answers in `make demo AUTO=1`: a table, read as a person with eyes would read the picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

WORDS_FOR_PLACE: Mapping[str, str] = {
    "meadow": "grass: 1; dirt path: 1",
    "forest": "dirt path: 1; tree: -1; bush: -1",
    "gravel": "gravel: 1; dry grass: 0.3",
}
"""What the operator knows of each place, and so says when asked about it."""

GROUND: Mapping[str, str] = {"meadow": "grass", "forest": "dirt path", "gravel": "dry grass"}
"""What a call for nothing is about: a tuft between the ruts, litter on the path."""

THINK = 0.8
"""Seconds that the operator looks at a call before answering."""


@dataclass
class _Seen:
    since: float
    stage: str
    tries: int = 0


@dataclass
class AutoOperator:
    """Answers every call: the place by its words, a thing by a tap on it.

    A thing that was named is never waved through: it stays -1 until it is gone.
    """

    _calls: dict[int, _Seen] = field(default_factory=dict)

    def answer(self, call: Mapping[str, Any], place: str, thing: str | None, now: float) -> str | None:
        """The line to type for an open call or hold now, if any.

        call: the newest event of it. place: where the rover is heading. thing: the kind of what stands ahead.
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
            return "go" if tries == 0 and call["stage"] in {"open", "clear"} else None
        if "unknown_scene" in call["reasons"] and tries == 0:
            return f"{WORDS_FOR_PLACE[place]}, go"
        if thing is not None:
            return f"tap {thing} -1 go" if tries <= 2 else None
        if "unknown_scene" in call["reasons"] or tries > 0:
            return "go"
        return f"tap {GROUND[place]} 1 go"
