"""Proposes a word's weight, and says whether one turns a word's sign. `weights.js` says the same. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from anytraverse.preferences import turns_sign
from companion.wire.answers import SetWord, TapBox
from companion.wire.ids import Reasons
from companion.wire.typed_answers import Tap

_PLACE_AND_THING = Reasons.UNKNOWN_SCENE | Reasons.BLOCKED


@dataclass(frozen=True)
class Proposal:
    """What a word is sent with. weight: in [-1, 1]. was: its own weight, None for a word that is new.

    turns: whether `weight` turns the sign that the word had.
    """

    weight: float
    was: float | None
    turns: bool


def propose(
    word: str,
    typed: float | None,
    in_force: Mapping[str, float],
    given: Mapping[str, float],
    reasons: Reasons,
) -> Proposal:
    """Propose a word's weight: the one that was typed, else its own, else by what the call is about.

    word: as `clean_word` returns it. typed: None where only the word was given. in_force, given: weight by
    word, of those in force and of those given before. reasons: of the call. A new word is -1 for a thing, and
    1 for a place, or without a call.
    """
    was = in_force.get(word, given.get(word))
    thing = reasons & Reasons.UNKNOWN_OBJECT or reasons & _PLACE_AND_THING == Reasons.BLOCKED
    default = -1.0 if thing else 1.0
    weight = typed if typed is not None else was if was is not None else default
    return Proposal(weight, was, was is not None and turns_sign(was, weight))


def turned(changes: Iterable[object], in_force: Mapping[str, float], given: Mapping[str, float]) -> str:
    """Return a question for a person about the words that these changes turn, "" where they turn none."""
    asked = []
    for change in changes:
        if isinstance(change, SetWord | Tap | TapBox):
            found = propose(change.word, change.weight, in_force, given, Reasons.NONE)
            if found.was is not None and found.turns:
                asked.append((change.word, found.was, found.weight))
    if not asked:
        return ""
    was = ", ".join(f"{word} was {before:g}" for word, before, _ in asked)
    becomes = ", ".join(f"{word} becomes {_becomes(now)}" for word, _, now in asked)
    it = "it" if len(asked) == 1 else "them"
    return f"{was}: repeat it to turn {it}, then {becomes}; nothing was sent"


def _becomes(weight: float) -> str:
    return "drivable" if weight > 0 else "not drivable" if weight < 0 else "neither drivable nor not"
