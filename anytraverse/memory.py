"""All that an AnyTraverse must not lose over a restart."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from anytraverse.errors import PreferencesError
from anytraverse.history import Embedding, History
from anytraverse.perception import Example
from anytraverse.preferences import Preferences, Setting


@dataclass(frozen=True, eq=False)
class Memory:
    """Words in force, the reference scene and the answered scenes of one model. Immutable.

    clock: the last stamp given; stamps order settings and entries even on a computer without a clock.
    configured: the configured words as last seen, to notice when they were edited.
    forgotten: word -> stamp of its being forgotten, so that no match brings it back.
    """

    model_id: str
    preferences: Preferences = field(default_factory=Preferences)
    configured: Preferences = field(default_factory=Preferences)
    examples: Mapping[str, tuple[Example, ...]] = field(default_factory=dict)
    forgotten: Mapping[str, int] = field(default_factory=dict)
    reference: Embedding | None = None
    history: History = field(default_factory=History)
    clock: int = 0

    def touched_by(self, word: str) -> int:
        """The stamp of the last thing the operator did to `word`; -1 for nothing."""
        settled = self.preferences.order(word) if word in self.preferences else -1
        return max(settled, self.forgotten.get(word, -1))


def first_memory(model_id: str, configured: Preferences, history_limit: int = 256) -> Memory:
    """What a rover starts with that has never been out."""
    return Memory(model_id, configured, configured, history=History(limit=history_limit))


def resumed_memory(
    saved: Memory, model_id: str, configured: Preferences, meaning: Callable[[str], str]
) -> tuple[Memory, list[str]]:
    """What a rover starts with after a restart, and what a person should be told about it.

    Scenes and examples of another model are left out. Configured words that were edited since win over the
    saved ones. Saved words that `meaning` refuses (the perceiver cannot ground them) go, unless
    they have examples.
    """
    notices: list[str] = []
    memory = saved
    if saved.model_id != model_id:
        notices.append(
            f"memory of model {saved.model_id} does not fit {model_id}: "
            f"{len(saved.history)} scenes and {len(saved.examples)} tapped words are left out"
        )
        memory = replace(
            memory, model_id=model_id, examples={}, reference=None, history=History(limit=saved.history.limit)
        )
    clock = memory.clock + 1
    edited = {word for word, weight in configured.items() if saved.configured.get(word) != weight}
    removed = {word for word in saved.configured if word not in configured}
    preferences = memory.preferences.without(*removed).merged(
        Preferences({word: Setting(configured[word], clock) for word in edited})
    )
    forgotten = {word: order for word, order in memory.forgotten.items() if word not in edited}
    forgotten.update(dict.fromkeys(removed, clock))
    if edited or removed:
        words = ", ".join(sorted(edited | removed))
        notices.append(f"configured words were edited and win: {words}")
    lost = [word for word in preferences if word not in memory.examples and not _known(word, meaning)]
    if lost:
        notices.append(f"words that {model_id} cannot ground are out of use: {', '.join(lost)}")
    memory = replace(
        memory,
        preferences=preferences.without(*lost),
        configured=configured,
        forgotten=forgotten,
        clock=clock,
    )
    return memory, notices


def _known(word: str, meaning: Callable[[str], str]) -> bool:
    try:
        meaning(word)
    except PreferencesError:
        return False
    return True
