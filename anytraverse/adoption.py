"""Puts the words of a remembered scene into force, and takes them back when the match is refused."""

from __future__ import annotations

from dataclasses import replace

from anytraverse.errors import PreferencesError
from anytraverse.history import Embedding, History, Match, cosine
from anytraverse.judging import Thresholds
from anytraverse.memory import Adoption, Examples, Memory
from anytraverse.preferences import Preferences, Setting
from anytraverse.synonyms import Meaning, meaning_of, opposed


def adopted_memory(
    memory: Memory, match: Match, meaning: Meaning, seen: Embedding, at: float | None = None
) -> tuple[Memory, tuple[str, ...]]:
    """Return `memory` with the words of a match in force, nu(tau, tau_match), and the words this dropped.

    seen: the embedding of the frame that matched. at: seconds since 1970.

    The entry does not change a word that the operator set without a call, or forgot, after the entry was
    made, nor does it add a contradicting synonym. Words set in answer to a call belong to that call's scene:
    those that the entry contradicts are dropped.
    """
    entry = match.entry

    def settled_later(word: str) -> bool:
        return memory.settled.get(word, -1) > entry.order

    words: dict[str, Setting] = {}
    contradicted: set[str] = set()
    for word, setting in entry.preferences.settings.items():
        if word not in entry.examples and meaning_of(word, meaning) is None:
            continue
        against = opposed(word, setting.weight, memory.preferences, meaning)
        if not any(settled_later(one) for one in (word, *against)):
            words[word] = setting
            contradicted.update(against)
    staying = memory.preferences.without(*(contradicted - words.keys()))
    preferences = staying.merged(Preferences(words))
    examples = {word: kept for word, kept in memory.examples.items() if word not in words}
    examples.update({word: kept for word, kept in entry.examples.items() if word in words})
    clock = memory.clock + 1
    adoption = Adoption(
        entry.order,
        entry.call_id,
        match.similarity,
        clock,
        seen,
        memory.preferences,
        memory.examples,
        memory.reference,
        at,
    )
    after = replace(
        memory,
        reference=entry.embedding,
        history=memory.history.touched(entry, clock),
        clock=clock,
        adoption=adoption,
    ).using(preferences, examples)
    return after, tuple(word for word in memory.preferences if word not in preferences)


def refused_memory(
    memory: Memory,
    call_id: int,
    newest: Embedding | None,
    limits: Thresholds,
    meaning: Meaning,
    *,
    stamp: int | None = None,
) -> tuple[Memory, tuple[str, ...], tuple[int, ...]]:
    """Return `memory` without the newest match: the place was another one than the remembered scene.

    Words and reference are again as before the match, but for words that were set or forgotten since; scenes
    that were answered since lose the words of the match, too. The frame that matched is noted at that scene,
    and at each other one that it matches, so that frames like it match none of them. So is the newest frame
    (its embedding; None: not known), if it still counts as that place.
    call_id: the call of the refused scene; 0: whichever matched. stamp: of the refused match, None: whichever
    is the newest. Also returns the words that this dropped, and the stamps of the scenes that were refused
    too often and are forgotten.
    Raises PreferencesError when no match is in force, or another one than was meant.
    """
    adoption = memory.adoption
    if adoption is None:
        raise PreferencesError("no place has matched: there is nothing to refuse")
    if call_id not in (0, adoption.call_id):
        place = f"the place of C{adoption.call_id}" if adoption.call_id else "a place without a call"
        raise PreferencesError(f"{place} matched, not that of C{call_id}")
    if stamp not in (None, adoption.clock):
        raise PreferencesError("another place matched: read which, and say again")
    history = _taught(memory, adoption, newest, limits)
    kept = {entry.order for entry in history}
    forgotten = tuple(entry.order for entry in memory.history if entry.order not in kept)
    entries = []
    for entry in history:
        words, taps = entry.preferences, entry.examples
        if entry.order > adoption.clock and entry.call_id:  # without a call it was imported
            words, taps = _undone(memory, adoption, words, taps, meaning)
        same = words is entry.preferences
        entries.append(entry if same else replace(entry, preferences=words, examples=taps))
    preferences, examples = _undone(memory, adoption, memory.preferences, memory.examples, meaning)
    reference = memory.reference if adoption.reference is None else adoption.reference
    after = replace(
        memory, reference=reference, history=History(entries, history.limit), clock=memory.clock + 1
    ).using(preferences, examples)
    dropped = tuple(word for word in memory.preferences if word not in preferences)
    return replace(after, adoption=None), dropped, forgotten


def _taught(memory: Memory, adoption: Adoption, newest: Embedding | None, limits: Thresholds) -> History:
    least = limits.least_match(len(memory.history))

    def like(seen: Embedding, history: History) -> set[int]:
        found = {match.entry.order for match in history.matches(seen, least)}
        return {order for order in found if order <= adoption.clock}

    history = memory.history
    history = history.refusing({adoption.order} | like(adoption.embedding, history), adoption.embedding)
    if newest is None or adoption.reference is None or memory.reference is None:
        return history
    if cosine(memory.reference, newest) >= limits.scene:
        history = history.refusing(like(newest, history), newest)
    return history


def _undone(
    memory: Memory, adoption: Adoption, words: Preferences, examples: Examples, meaning: Meaning
) -> tuple[Preferences, Examples]:
    """Return words and examples as before the match, with those of `words` that were set since."""
    since = {word: one for word, one in words.settings.items() if one.order > adoption.clock}
    newer, back = Preferences(since), dict[str, Setting]()
    for word, setting in adoption.preferences.settings.items():
        forgotten = word not in words and memory.settled.get(word, -1) > adoption.clock
        grounded = word in adoption.examples or meaning_of(word, meaning) is not None
        if grounded and not forgotten and not opposed(word, setting.weight, newer, meaning):
            back[word] = setting
    preferences = Preferences(back).merged(newer)
    taps = {word: kept for word, kept in adoption.examples.items() if word in back and word not in since}
    taps |= {word: kept for word, kept in examples.items() if word in since}
    return preferences, {word: kept for word, kept in taps.items() if word in preferences}
