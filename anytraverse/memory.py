"""Holds all that an AnyTraverse must keep over a restart."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np

from anytraverse.history import Embedding, Entry, History, Likeness, Match, Place
from anytraverse.perception import Example
from anytraverse.preferences import MAX_WORDS, Preferences, turns_sign
from anytraverse.synonyms import Meaning, meaning_of, opposed

Examples = Mapping[str, tuple[Example, ...]]
"""Word -> its tapped examples."""

MOST_GIVEN = 256
"""Words out of use of which a memory knows the weight. Beyond that, those longest out of use go first."""


@dataclass(frozen=True, eq=False)
class Adoption:
    """Holds how a remembered scene came into force by a match, and what it replaced, to undo it.

    order, call_id: of the entry. embedding: of the frame that matched, similarity: its cosine to the entry's.
    clock: the stamp of the match. preferences, examples: in force before. reference: the one before; None
    once an answer has moved the reference on, so that another scene is in force. time: seconds since 1970,
    None where that was not known.
    """

    order: int
    call_id: int
    similarity: float
    clock: int
    embedding: Embedding
    preferences: Preferences
    examples: Examples
    reference: Embedding | None
    time: float | None = None


@dataclass(frozen=True, eq=False)
class Memory:
    """Holds the words in force, the reference scene and the answered scenes of one model. Immutable.

    clock: the last stamp given; stamps order settings and entries even on a computer without a clock.
    configured: the configured words at the last start, to notice when they were edited.
    settled: word -> the stamp at which it was last set without a call, or forgotten; no remembered scene
    older than that changes it. Words set in answer to a call belong to that call's scene and are not listed,
    nor is a word that is neither in use nor in a remembered scene.
    given: word -> weight in [-1, 1] that it had last, of the words that are out of use; the newest
    first, at most `MOST_GIVEN`. A word in force is not listed.
    adoption: the newest match whose words came into force; None without one, and after it was refused.
    """

    model_id: str
    preferences: Preferences = field(default_factory=Preferences)
    configured: Preferences = field(default_factory=Preferences)
    examples: Examples = field(default_factory=dict)
    settled: Mapping[str, int] = field(default_factory=dict)
    given: Mapping[str, float] = field(default_factory=dict)
    reference: Embedding | None = None
    history: History = field(default_factory=History)
    clock: int = 0
    adoption: Adoption | None = None

    def turned(self, after: Memory) -> dict[str, tuple[float, float]]:
        """Return the words whose sign `after` has turned -> weight given before, weight in force after."""
        was = {**self.given, **self.preferences}
        return {
            word: (was[word], weight)
            for word, weight in after.preferences.items()
            if word in was and turns_sign(was[word], weight)
        }

    def giving(self, words: Mapping[str, float]) -> Memory:
        """Return this memory with words counted as given with these weights, but for those in force."""
        older = {word: weight for word, weight in self.given.items() if word not in words}
        unused = ((word, one) for word, one in {**words, **older}.items() if word not in self.preferences)
        return replace(self, given=dict(islice(unused, MOST_GIVEN)))

    @property
    def matched(self) -> dict[str, tuple[float | None, float | None]]:
        """Words that the newest match changed -> weight before it, and in force; None: out of use."""
        if self.adoption is None:
            return {}
        before, after = self.adoption.preferences, self.preferences
        both = {word: (before.get(word), after.get(word)) for word in {**before, **after}}
        return {word: (was, now) for word, (was, now) in both.items() if was != now}

    def using(
        self, preferences: Preferences, examples: Examples, settled: Mapping[str, int] | None = None
    ) -> Memory:
        """Return this memory with other words in force, and only the examples of these.

        settled: word -> stamp of each word just set without a call, or just forgotten.
        """
        stamps = {**self.settled, **(settled or {})}
        known = {*preferences, *(word for entry in self.history for word in entry.preferences)}
        known |= set(self.adoption.preferences) if self.adoption is not None else set()
        after = replace(
            self,
            preferences=preferences,
            examples={word: kept for word, kept in examples.items() if word in preferences},
            settled={word: at for word, at in stamps.items() if word in known},
        )
        return after.giving(self.preferences)

    def remembering(
        self,
        embedding: Embedding,
        call_id: int,
        place: Place,
        *,
        move: bool,
        surroundings: Embedding | None = None,
    ) -> Memory:
        """Return this memory with the words in force added to H for a scene.

        move: whether the scene becomes the reference. surroundings: of its frame, None where not known. An
        entry of an earlier answer to the same call is replaced.
        """
        clock = self.clock + 1
        words, taps = self.preferences, self.examples
        entry = Entry(embedding, words, clock, clock, call_id, taps, place, surroundings=surroundings)
        kept = self.history.without_call(call_id) if call_id else self.history
        after = replace(self, history=kept.added(entry), clock=clock)
        return after.at(embedding) if move else after

    def taught(self, entry: Entry) -> dict[str, float]:
        """Return the words that came with a scene of H: those set since the scene before it was remembered,
        but for those set without a call.
        """
        before = max((one.order for one in self.history if one.order < entry.order), default=0)
        return {
            word: setting.weight
            for word, setting in entry.preferences.settings.items()
            if setting.order > before and self.settled.get(word) != setting.order
        }

    def nearest_answered(self, embedding: Embedding, but: Collection[int]) -> Match | None:
        """Return the most similar scene that an answer taught; None without one.

        but: ids of calls that are left out.
        """
        for match in self.history.nearest(embedding):
            entry = match.entry
            if entry.call_id not in but and (entry.call_id or self.taught(entry)):
                return match
        return None

    def likeness(self, embedding: Embedding, now: float, scene: float, match: float) -> Likeness:
        """Return the scene that a frame of a new place lacks least to count as: that of now, or one of H.

        now: its similarity to the scene of now, scene: what that needs, match: what one of H needs. Cosines.
        """
        calls = [
            entry.call_id
            for entry in self.history
            if self.reference is not None and np.array_equal(entry.embedding, self.reference)
        ]
        like = Likeness(calls[-1] if calls else 0, now, scene)
        best = self.history.best(embedding)
        if best is None:
            return like
        other = Likeness(best.entry.call_id, best.similarity, match)
        return min(like, other, key=lambda one: one.needed - one.similarity)

    def at(self, reference: Embedding | None) -> Memory:
        """Return this memory with another reference, to which no match led. None: none, as at first."""
        left = None if self.adoption is None or reference is None else replace(self.adoption, reference=None)
        return replace(self, reference=reference, adoption=left)


def first_memory(model_id: str, configured: Preferences, history_limit: int = 256) -> Memory:
    """Make the memory of a rover's first start."""
    return Memory(model_id, configured, configured, history=History(limit=history_limit))


def resumed_memory(
    saved: Memory,
    model_id: str,
    configured: Preferences,
    meaning: Meaning,
    *,
    history_limit: int | None = None,
) -> tuple[Memory, list[str]]:
    """Restore the memory after a restart; also return notices of what changed, for a person.

    Scenes and examples of another model are dropped. Configured words that were edited since win over the
    saved ones, and over remembered scenes. Of words that contradict each other the older are dropped. Words
    that `meaning` refuses (the perceiver cannot ground them) are dropped, unless they have examples.
    history_limit: the most scenes to remember from now on; None: as many as before.
    """
    memory, notices = _restricted_to_model(saved, model_id)
    if history_limit is not None:
        memory = replace(memory, history=History(memory.history, history_limit))
    clock = memory.clock + 1
    edited = {word: weight for word, weight in configured.items() if saved.configured.get(word) != weight}
    removed = {word for word in saved.configured if word not in configured}
    if edited or removed:
        notices.append(f"configured words were edited and win: {_listed({*edited, *removed})}")
    kept = memory.preferences.without(*removed)
    preferences = kept.merged(Preferences.of(edited, clock))
    dropped = {word for word in kept if word not in preferences}
    contradicted = _contradicted(preferences, configured, meaning)
    if contradicted:
        notices.append(f"words that later ones contradict are out of use: {_listed(contradicted)}")
    if dropped:
        notices.append(
            f"more than {MAX_WORDS} words, the least recently set are out of use: {_listed(dropped)}"
        )
    lost = {word for word in preferences if word not in memory.examples and meaning_of(word, meaning) is None}
    if lost:
        notices.append(f"words that {model_id} cannot ground are out of use: {_listed(lost)}")
    memory = memory.giving(preferences)
    preferences = preferences.without(*contradicted, *lost)
    memory = memory.using(preferences, memory.examples, dict.fromkeys((*edited, *removed), clock))
    return replace(memory, configured=configured, clock=clock), notices


def _restricted_to_model(saved: Memory, model_id: str) -> tuple[Memory, list[str]]:
    """Return `saved` without the scenes and examples of other models, and notices of that."""
    if saved.model_id == model_id:
        entries = [_without_foreign_examples(entry, model_id) for entry in saved.history]
        history = History(entries, saved.history.limit)
        own = _examples_of(saved.examples, model_id)
        adoption = saved.adoption
        if adoption is not None:
            adoption = replace(adoption, examples=_examples_of(adoption.examples, model_id))
        return replace(saved, history=history, examples=own, adoption=adoption), []
    notice = (
        f"memory of model {saved.model_id} does not fit {model_id}: "
        f"{len(saved.history)} scenes and {len(saved.examples)} tapped words are left out"
    )
    history = History(limit=saved.history.limit)
    after = replace(saved, model_id=model_id, examples={}, history=history)
    return after.at(None), [notice]


def _contradicted(preferences: Preferences, configured: Preferences, meaning: Meaning) -> set[str]:
    """Return the words that have a synonym of opposite sign with a later stamp.

    At equal stamps a word that is not configured loses. Two configured words that contradict each other both
    stay: only their author can correct that.
    """
    return {
        word
        for word, weight in preferences.items()
        for other in opposed(word, weight, preferences, meaning)
        # the bool adds 1, which turns < into <= for a word that is not configured
        if preferences.order(word) < preferences.order(other) + (word not in configured)
    }


def _without_foreign_examples(entry: Entry, model_id: str) -> Entry:
    """Remove other models' examples; return the same object where there are none: it is then unchanged."""
    own = _examples_of(entry.examples, model_id)
    return entry if own == entry.examples else replace(entry, examples=own)


def _examples_of(examples: Examples, model_id: str) -> Examples:
    """Return the examples that this model made."""
    own = {word: tuple(one for one in kept if one.model_id == model_id) for word, kept in examples.items()}
    return {word: kept for word, kept in own.items() if kept}


def _listed(words: set[str]) -> str:
    return ", ".join(sorted(words))
