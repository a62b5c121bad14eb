"""Applies an operator's answer to the memory."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from anytraverse.assessment import Assessment, Observation
from anytraverse.errors import ExampleError, PreferencesError
from anytraverse.history import History
from anytraverse.memory import Memory
from anytraverse.operations import (
    ForgetCall,
    ForgetWord,
    NewEpisode,
    Operation,
    Tap,
    taps_of,
    teaches,
    weights_of,
)
from anytraverse.perception import Example, Perceiver
from anytraverse.preferences import Preferences, Setting, check_weight, clean_word
from anytraverse.regions import Box
from anytraverse.synonyms import refuse_contradictions

MAX_EXAMPLES = 16
"""The most tapped examples of one word; beyond it the oldest is dropped."""
LARGEST_EXAMPLES = 2 << 20
"""Bytes of the examples of all words, at most: each remembered scene keeps them."""
MAX_NAMED = 8
"""The most call ids that an error lists when the call to forget is not known; the newest ones."""


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
    memory: Memory,
    operations: Sequence[Operation],
    perceiver: Perceiver,
    seen: Observation | None,
    *,
    missing_ok: bool = False,
) -> tuple[Memory, tuple[str, ...]]:
    """Return `memory` after `operations`, and the words that were dropped. All of them apply, or none.

    The refusal of a match is left to `refused_memory`.
    Words and calls are forgotten first, words with their examples; then words are set, those of taps last.
    seen: the frame of the answered call, to which taps refer; None for words without a call, which scenes
    remembered before cannot change. missing_ok: forgetting an unknown word or call is no error; a setting
    that is sent again may have been applied already.
    Raises PreferencesError (UnknownWordError), ExampleError and RegionError.
    """
    if not teaches(operations):
        return memory, ()
    clock = memory.clock + 1
    gone = {clean_word(one.word) for one in operations if isinstance(one, ForgetWord)}
    calls = [one.id for one in operations if isinstance(one, ForgetCall)]
    if not missing_ok:
        _refuse_missing(memory, gone, calls)
    settings = dict(Preferences.of(weights_of(operations), clock).settings)
    examples = {word: kept for word, kept in memory.examples.items() if word not in gone}
    for tap in taps_of(operations):
        word = clean_word(tap.word)
        settings[word] = Setting(check_weight(word, tap.weight), clock)
        examples[word] = (*examples.get(word, ()), _example(tap, perceiver, seen))[-MAX_EXAMPLES:]
    if sum(example.vector.nbytes for kept in examples.values() for example in kept) > LARGEST_EXAMPLES:
        raise ExampleError("as many taps of this model cannot be remembered: forget a tapped word first")
    for word in settings:
        if word not in examples:
            perceiver.meaning(word)
    before = memory.preferences.without(*gone)
    preferences = before.merged(Preferences(settings))
    refuse_contradictions(preferences, perceiver.meaning)
    # words set in answer to a call belong to its scene, so only words set without a call are settled
    settled = dict.fromkeys(gone if seen is not None else {*gone, *settings}, clock)
    history = memory.history
    for call_id in calls:
        history = history.without_call(call_id)
    after = replace(memory, history=history, clock=clock)
    if any(isinstance(one, NewEpisode) for one in operations):
        after = replace(after, history=History(limit=history.limit)).at(None)
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
    example = perceiver.example(seen.features, Box(*tap.box))
    if example.model_id != perceiver.model_id:
        raise ExampleError(f"the example was made by {example.model_id}, not {perceiver.model_id}: tap again")
    return example
