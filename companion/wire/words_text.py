"""Formats and parses words and weights as text, such as "grass: 1; rock: -0.8".

Finds a word's own weight, and says which words an answer turns, as `weights.js` does. Pure.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from anytraverse.errors import PreferencesError
from anytraverse.operations import ForgetCall, ForgetWord, NewEpisode, Operation, OtherPlace, SetWord, Tap
from anytraverse.preferences import MAX_WORDS, check_weight, clean_word, turns_sign
from companion.wire.answers import AnyOperation, CancelIncident, PackIncident, RecordingWish
from companion.wire.parameters import NOT_IN_USE

MAX_TEXT_VALUE = 128
"""Bytes of an extended parameter's value."""
_PLACES = 6


def words_text(weights: Mapping[str, float]) -> str:
    """Format the words, as many as fit into 128 bytes of UTF-8."""
    text = ""
    for word, weight in weights.items():
        extended = f"{text}{'; ' if text else ''}{word}: {weight_text(weight)}"
        if len(extended.encode()) > MAX_TEXT_VALUE:
            break
        text = extended
    return text


def weight_text(weight: float) -> str:
    """Format a weight, such as "1" or "-0.8"; "-2" means that the word is not in use."""
    return f"{round(weight, _PLACES):g}"


def operation_text(operation: AnyOperation) -> str:
    """Format an answer's operation as an operator types it."""
    match operation:
        case SetWord(word, weight):
            return f"{word}: {weight_text(weight)}"
        case Tap(_, box, word, weight):
            sides = " ".join(f"{side:.4f}" for side in box)
            return f"tap {word}: {weight_text(weight)} {sides}"
        case ForgetWord(word):
            return f"forget {word}"
        case ForgetCall(call_id):
            return f"forget call {call_id}"
        case NewEpisode():
            return "new episode"
        case OtherPlace(call_id):
            return f"other place {call_id}" if call_id else "other place"
        case PackIncident(call_id):
            return f"incident {call_id}" if call_id else "incident"
        case CancelIncident(call_id):
            return f"cancel incident {call_id}" if call_id else "cancel incident"
        case RecordingWish(number, wish):
            return f"{wish.name.lower()} recording {number}"


def read_words(text: str) -> tuple[Operation, ...]:
    """Parse a text into operations. Weight -2 takes a word out of use; words that are not named stay.

    Raises PreferencesError.
    """
    parts = [part for part in text.split(";") if part.strip()]
    if not parts:
        raise PreferencesError("no word: write grass: 1; rock: -0.8")
    if len(parts) > MAX_WORDS:
        raise PreferencesError(f"{len(parts)} words, {MAX_WORDS} at most")
    found: dict[str, Operation] = {}
    for part in parts:
        raw, colon, number = part.rpartition(":")
        if not colon:
            raise PreferencesError(f'"{part.strip()}" has no weight')
        word = clean_word(raw)
        if word in found:
            raise PreferencesError(f'"{word}" stands twice')
        found[word] = read_weight(word, number)
    return tuple(found.values())


def read_weight(word: str, text: str) -> Operation:
    """Parse one word's weight into its operation. Raises PreferencesError."""
    try:
        weight = float(text) if text.isascii() and "_" not in text else None
    except ValueError:
        weight = None
    if weight is None:
        raise PreferencesError(f'"{text.strip()}" is no weight')
    if weight == NOT_IN_USE:
        return ForgetWord(word)
    return SetWord(word, round(check_weight(word, weight), _PLACES))


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
