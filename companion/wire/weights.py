"""Finds a word's own weight, and says which words an answer turns. `weights.js` says the same. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from anytraverse.operations import OtherPlace, SetWord, Tap
from anytraverse.preferences import turns_sign
from companion.wire.answers import AnyOperation


def own_weight(word: str, in_force: Mapping[str, float], given: Mapping[str, float]) -> float | None:
    """Return the weight that a word proposes: the one in force, else the one given last. None: it is new.

    word: as `clean_word` returns it. in_force, given: weight by word.
    """
    return in_force.get(word, given.get(word))


def turned(
    changes: Iterable[AnyOperation],
    in_force: Mapping[str, float],
    given: Mapping[str, float],
    matched: Mapping[str, tuple[float | None, float | None]],
    *,
    read: bool = True,
) -> str:
    """Return a question for a person about the words that these changes turn, "" where they turn none.

    matched: word -> weight before and after the newest match, None: out of use. "other place" takes it back.
    read: whether `in_force` and `given` were read whole. If not, a word in neither may turn, too.
    """
    weights: list[tuple[str, float]] = []
    for change in changes:
        if isinstance(change, SetWord | Tap):
            weights.append((change.word, change.weight))
        elif isinstance(change, OtherPlace):
            both = matched.items()
            weights += [(word, back) for word, (back, now) in both if back is not None and now is not None]
    was, becomes = [], []
    for word, weight in weights:
        own = own_weight(word, in_force, given)
        if turns_sign(own, weight) if own is not None else not read:
            was.append(f"{word} {'is not read yet' if own is None else f'was {own:g}'}")
            becomes.append(f"{word} becomes {'drivable' if weight > 0 else 'not drivable'}")
    if not was:
        return ""
    it = "it" if len(was) == 1 else "them"
    return f"{', '.join(was)}: repeat it to turn {it}, then {', '.join(becomes)}; nothing was sent"
