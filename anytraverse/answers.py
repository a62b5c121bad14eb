"""Applies an operator's answer to the memory."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

from anytraverse.assessment import Assessment, Observation
from anytraverse.errors import ExampleError, PreferencesError
from anytraverse.history import History
from anytraverse.memory import Memory
from anytraverse.perception import Example, Perceiver
from anytraverse.preferences import Preferences, Setting, check_weight, clean_word
from anytraverse.regions import Box
from anytraverse.synonyms import refuse_contradictions

MAX_EXAMPLES = 16
"""The most tapped examples of one word; beyond it the oldest is dropped."""
MAX_NAMED = 8
"""The most call ids that an error lists when the call to forget is not known; the newest ones."""


@dataclass(frozen=True)
class Tap:
    """Makes what `box` shows in frame `frame_id` an example of `word`, with a weight in [-1, 1]."""

    frame_id: int
    box: Box
    word: str
    weight: float


@dataclass(frozen=True)
class Changes:
    """Holds what an answer changes: weights of words, taps, words and calls to forget, a new episode.

    new_episode: forget the reference and all remembered scenes. missing_ok: forgetting an unknown word or
    call is no error; a setting that is sent again may have been applied already.
    other_place: the newest match is refused, see `refused_memory`; the call whose scene matched, 0: any.
    None: it is not. match: the stamp of the match that is meant (`Adoption.clock`); None: any.
    """

    weights: Mapping[str, float] = field(default_factory=dict)
    taps: tuple[Tap, ...] = ()
    forget_words: tuple[str, ...] = ()
    forget_calls: tuple[int, ...] = ()
    new_episode: bool = False
    missing_ok: bool = False
    other_place: int | None = None
    match: int | None = None

    def __bool__(self) -> bool:
        """Return whether anything is changed."""
        return self.teaches or self.other_place is not None

    @property
    def teaches(self) -> bool:
        """Whether something is said of the scene of the call. That it is another place says nothing of it."""
        return bool(self.weights or self.taps or self.forget_words or self.forget_calls or self.new_episode)


@dataclass(frozen=True, eq=False)
class AnswerOutcome:
    """Holds the result of an answer.

    call: the call's frame, judged again; None for words without a call. newest: the newest frame, judged
    again. dropped: words put out of use because at most 16 can be in use. remembered: whether H gained the
    scene. undone: words that a refused match had put into use. forgotten: stamps of scenes that were refused
    too often.
    """

    call: Assessment | None
    newest: Assessment | None
    dropped: tuple[str, ...] = ()
    remembered: bool = False
    undone: tuple[str, ...] = ()
    forgotten: tuple[int, ...] = ()


def changed_memory(
    memory: Memory, changes: Changes, perceiver: Perceiver, seen: Observation | None
) -> tuple[Memory, tuple[str, ...]]:
    """Return `memory` after `changes`, and the words that were dropped. All changes apply, or none.

    The refusal of a match is left to `refused_memory`.
    Words and calls are forgotten first, words with their examples; then words are set.
    seen: the frame of the answered call, to which taps refer; None for words without a call, which scenes
    remembered before cannot change.
    Raises PreferencesError (UnknownWordError) and ExampleError.
    """
    if not changes.teaches:
        return memory, ()
    clock = memory.clock + 1
    gone = {clean_word(word) for word in changes.forget_words}
    if not changes.missing_ok:
        _refuse_missing(memory, gone, changes.forget_calls)
    settings = dict(Preferences.of(changes.weights, clock).settings)
    examples = {word: kept for word, kept in memory.examples.items() if word not in gone}
    for tap in changes.taps:
        word = clean_word(tap.word)
        settings[word] = Setting(check_weight(word, tap.weight), clock)
        examples[word] = (*examples.get(word, ()), _example(tap, perceiver, seen))[-MAX_EXAMPLES:]
    for word in settings:
        if word not in examples:
            perceiver.meaning(word)
    before = memory.preferences.without(*gone)
    preferences = before.merged(Preferences(settings))
    refuse_contradictions(preferences, perceiver.meaning)
    # words set in answer to a call belong to its scene, so only words set without a call are settled
    settled = dict.fromkeys(gone if seen is not None else {*gone, *settings}, clock)
    after = replace(memory, history=_forgetting(memory.history, changes), clock=clock)
    if changes.new_episode:
        after = after.at(None)
    return (
        after.using(preferences, examples, settled),
        tuple(word for word in before if word not in preferences),
    )


def _refuse_missing(memory: Memory, words: Collection[str], calls: Collection[int]) -> None:
    for word in sorted(words):
        if word not in memory.preferences:
            others = (
                f". In use: {', '.join(memory.preferences)}" if memory.preferences else ", nor is any word"
            )
            raise PreferencesError(f'"{word}" is not in use{others}')
    learnt = [entry.call_id for entry in reversed(memory.history) if entry.call_id]
    for call_id in calls:
        if call_id not in learnt:
            others = f"only from {', '.join(map(str, learnt[:MAX_NAMED]))}" if learnt else "nor from any"
            raise PreferencesError(f"nothing was learnt from call {call_id}, {others}")


def _example(tap: Tap, perceiver: Perceiver, seen: Observation | None) -> Example:
    if seen is None or tap.frame_id != seen.frame.id:
        raise PreferencesError(
            f"the tap names frame {tap.frame_id}, not the call's: tap the call's picture again"
        )
    example = perceiver.example(seen.features, tap.box)
    if example.model_id != perceiver.model_id:
        raise ExampleError(f"the example was made by {example.model_id}, not {perceiver.model_id}: tap again")
    return example


def _forgetting(history: History, changes: Changes) -> History:
    if changes.new_episode:
        return History(limit=history.limit)
    for call_id in changes.forget_calls:
        history = history.without_call(call_id)
    return history
