"""Reads the words in use, the vocabulary that is offered as parameters, and aliases; checks them together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from anytraverse.preferences import Preferences, clean_word
from companion.config.checks import ValueCheck, listing, number, text
from companion.config.toml_file import Layer, Problem
from companion.wire.parameters import MAX_WORDS, build, word_parameter

WORDS_OFFERED = listing(text, 0, MAX_WORDS)


class _Words(NamedTuple):
    """The words, vocabulary and aliases of a `Config`."""

    words: Mapping[str, float] = {}
    vocabulary: tuple[str, ...] = ()
    aliases: Mapping[str, str] = {}


def read_words(layers: Sequence[Layer], problems: list[Problem]) -> _Words:
    """Read the three tables. The first layer that has a table replaces that of the others as a whole.

    The words in use are added to the vocabulary. Problems are added to `problems`.
    """
    before = len(problems)
    layer_of = {
        key: next((layer for layer in layers if key in layer.data), layers[0])
        for key in ("vocabulary", "words", "aliases")
    }
    words = _table(layer_of["words"], "words", number(-1, 1), problems)
    _try(layer_of["words"], ("words",), partial(Preferences.of, words), problems)
    aliases = _table(layer_of["aliases"], "aliases", text, problems)
    for word, alias in aliases.items():
        _try(layer_of["aliases"], ("aliases", word), partial(word_parameter, word, alias), problems)
    listed = layer_of["vocabulary"].data.get("vocabulary", [])
    listed = _try(layer_of["vocabulary"], ("vocabulary",), partial(_cleaned, listed), problems)
    vocabulary = tuple(dict.fromkeys((*words, *(listed or ()))))
    if len(problems) == before:
        key_to_report = next((key for key in layer_of if key in layer_of[key].data), "words")
        together = partial(build, vocabulary, words, {}, aliases=aliases)
        _try(layer_of[key_to_report], (key_to_report,), together, problems)
    return _Words(words, vocabulary, aliases)


def _cleaned(listed: object) -> tuple[str, ...]:
    return tuple(clean_word(word) for word in WORDS_OFFERED(listed))


def _table(layer: Layer, name: str, check: ValueCheck, problems: list[Problem]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for word, value in layer.table(name, problems).items():
        cleaned = _try(layer, (name, word), partial(clean_word, word), problems)
        checked = _try(layer, (name, word), partial(check, value), problems)
        if cleaned is None or checked is None:
            continue
        if cleaned in found:
            problems.append(layer.problem((name, word), f'"{cleaned}" stands twice: keep one'))
        found[cleaned] = checked
    return found


def _try(layer: Layer, keys: tuple[str, ...], make: Callable[[], Any], problems: list[Problem]) -> Any:
    """Return what `make` returns; turn its ValueError into a problem, and return None."""
    try:
        return make()
    except ValueError as error:
        problems.append(layer.problem(keys, str(error)))
        return None
