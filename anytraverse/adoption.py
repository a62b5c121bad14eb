"""Puts the words of a remembered scene into force."""

from __future__ import annotations

from dataclasses import replace

from anytraverse.history import Entry
from anytraverse.memory import Memory
from anytraverse.preferences import Preferences, Setting
from anytraverse.synonyms import Meaning, meaning_of, opposed


def adopted_memory(memory: Memory, entry: Entry, meaning: Meaning) -> tuple[Memory, tuple[str, ...]]:
    """Return `memory` with the words of `entry` in force, nu(tau, tau_match), and the words this dropped.

    The entry does not change a word that the operator set without a call, or forgot, after the entry was
    made, nor does it add a contradicting synonym. Words set in answer to a call belong to that call's scene:
    those that the entry contradicts are dropped.
    """

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
    after = replace(
        memory.using(preferences, examples),
        reference=entry.embedding,
        history=memory.history.touched(entry, clock),
        clock=clock,
    )
    return after, tuple(word for word in memory.preferences if word not in preferences)
