"""What an operator's answer changes, and what came of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from anytraverse.assessment import Assessment, Observation
from anytraverse.errors import PreferencesError
from anytraverse.history import History
from anytraverse.memory import Memory
from anytraverse.perception import Example, Perceiver
from anytraverse.preferences import Preferences, Setting, check_weight, clean_word
from anytraverse.regions import Box

MAX_EXAMPLES = 16
"""Tapped examples kept of one word; the oldest goes."""
_MAX_FORGOTTEN = 64


@dataclass(frozen=True)
class Tap:
    """What `box` shows in frame `frame_id` becomes an example of `word`, with a weight in [-1, 1]."""

    frame_id: int
    box: Box
    word: str
    weight: float


@dataclass(frozen=True)
class Changes:
    """What an answer teaches: weights of words, taps, words and calls to forget, a new episode."""

    weights: Mapping[str, float] = field(default_factory=dict)
    taps: tuple[Tap, ...] = ()
    forget_words: tuple[str, ...] = ()
    forget_calls: tuple[int, ...] = ()
    new_episode: bool = False

    def __bool__(self) -> bool:
        """Whether anything is changed at all."""
        return bool(self.weights or self.taps or self.forget_words or self.forget_calls or self.new_episode)


@dataclass(frozen=True, eq=False)
class AnswerOutcome:
    """What came of an answer.

    call: the call's frame, judged again; None for words without a call. newest: the newest frame, likewise.
    dropped: words that went out of use because more than 16 would be. remembered: the scene entered H.
    """

    call: Assessment | None
    newest: Assessment | None
    dropped: tuple[str, ...] = ()
    remembered: bool = False


def changed_memory(
    memory: Memory, changes: Changes, perceiver: Perceiver, seen: Observation | None
) -> tuple[Memory, tuple[str, ...]]:
    """`memory` after `changes`, all or nothing, and the words that had to go.

    seen: the frame that taps refer to. Raises PreferencesError (UnknownWordError) and ExampleError, with
    `memory` as it was.
    """
    clock = memory.clock + 1
    settings = {
        clean_word(word): Setting(check_weight(word, weight), clock)
        for word, weight in changes.weights.items()
    }
    examples: dict[str, tuple[Example, ...]] = dict(memory.examples)
    for tap in changes.taps:
        word = clean_word(tap.word)
        if seen is None or tap.frame_id != seen.frame.id:
            raise PreferencesError(
                f"the tap names frame {tap.frame_id}, not the call's: tap the call's picture again"
            )
        example = perceiver.example(seen.features, tap.box)
        examples[word] = (*examples.get(word, ()), example)[-MAX_EXAMPLES:]
        settings[word] = Setting(check_weight(word, tap.weight), clock)
    gone = {clean_word(word) for word in changes.forget_words}
    for word in settings:
        if word not in examples:
            perceiver.meaning(word)
    before = memory.preferences.without(*gone)
    preferences = before.merged(Preferences(settings))
    _refuse_contradictions(preferences, perceiver)
    dropped = tuple(word for word in before if word not in preferences)
    forgotten = {word: order for word, order in memory.forgotten.items() if word not in settings}
    forgotten.update(dict.fromkeys((gone - settings.keys()) | set(dropped), clock))
    forgotten = dict(sorted(forgotten.items(), key=lambda item: item[1])[-_MAX_FORGOTTEN:])
    history = memory.history
    for call_id in changes.forget_calls:
        history = history.without_call(call_id)
    after = replace(
        memory,
        preferences=preferences,
        examples={word: kept for word, kept in examples.items() if word in preferences},
        forgotten=forgotten,
        history=History(limit=history.limit) if changes.new_episode else history,
        reference=None if changes.new_episode else memory.reference,
        clock=clock,
    )
    return after, dropped


def _refuse_contradictions(preferences: Preferences, perceiver: Perceiver) -> None:
    """Raises PreferencesError when two words of one meaning have opposite signs."""
    seen: dict[str, str] = {}
    for word, weight in preferences.items():
        try:
            meaning = perceiver.meaning(word)
        except PreferencesError:
            continue  # a tapped word means itself
        other = seen.setdefault(meaning, word)
        if preferences[other] * weight < 0:
            raise PreferencesError(
                f'"{word}: {weight:g}" contradicts "{other}: {preferences[other]:g}", which means the same: '
                f'change or forget "{other}"'
            )
        seen[meaning] = max(other, word, key=lambda one: abs(preferences[one]))
