"""Checks a configuration by what each part of the companion refuses when it starts: one check for all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from anytraverse.errors import AnyTraverseError, SettingsError, UnknownWordError
from anytraverse.judging import Settings
from anytraverse.roi import Corridor
from anytraverse.synonyms import Meaning, refuse_contradictions
from companion.config.reading import load_layer, located
from companion.config.schema import Config
from companion.config.stopping import ground_region, judge_stopping, region_of
from companion.config.toml_file import ConfigError, Layer, Problem
from companion.config.toml_lines import KeyPath
from companion.wire.signing_store import SigningKeyError, read_key


def load_checked(main: Layer) -> Config:
    """Load the configuration, and check the whole of it. Raises ConfigError.

    Everything is checked but what only the perceiver's files say: no network is loaded, no device opened.
    """
    config = load_layer(main)
    problems = [located(main, keys, reason) for keys, reason in _misfits(config)]
    if problems:
        raise ConfigError(problems)
    return config


def problems_of(main: Layer) -> tuple[Problem, ...]:
    """Return what `load_checked` finds wrong."""
    try:
        load_checked(main)
    except ConfigError as error:
        return error.problems
    return ()


def _misfits(config: Config) -> Iterator[tuple[KeyPath, str]]:
    key = config.link.signing_key
    # A key that exists and cannot be read belongs to the service's user: only the daemon can check it.
    if key is not None and (os.access(key, os.R_OK) or not os.path.exists(key)):
        try:
            read_key(Path(key))
        except SigningKeyError as error:
            yield ("link", "signing_key"), str(error)
    stopping = judge_stopping(config)
    if config.call.holds and isinstance(stopping, str) and not config.stopping.unchecked:
        yield ("call", "policy"), unchecked(stopping)
    width = config.corridor
    corridor = Corridor(width.bottom, width.top, bottom_row=width.bottom_row, top_row=width.top_row)
    try:
        Settings(region=region_of(config).bounds, ground=ground_region(config), corridor=corridor)
    except SettingsError as error:
        yield ("roi",), str(error)
    meaning = _meaning(config.perceiver.name)
    if meaning is not None:
        yield from _wrong_words(config, meaning)


def unchecked(missing: str) -> str:
    """Return why hold cannot be given, and what to do. missing: what `judge_stopping` returned."""
    return (
        f"hold cannot be given, since it is not known whether the vehicle stops in time: {missing}. "
        "Or allow hold without that check: set [stopping] unchecked = true"
    )


def _meaning(perceiver: str) -> Meaning | None:
    """Return what words mean to a built-in perceiver, None for those whose bundle says it."""
    kind, _, argument = perceiver.partition(":")
    if kind != "builtin":
        return None
    from anytraverse.perception.builtin.lexicon import LOOKS
    from anytraverse.perception.builtin.vocabulary import concept_of
    from anytraverse.perception.builtin.words import GROUND_WORDS

    concepts = (*LOOKS,) if argument == "lexicon" else (*GROUND_WORDS,)
    return lambda word: concept_of(word, concepts)


def _wrong_words(config: Config, meaning: Meaning) -> Iterator[tuple[KeyPath, str]]:
    try:
        for word in config.words:
            meaning(word)
        refuse_contradictions(config.preferences, meaning)
    except UnknownWordError as error:
        yield ("words", error.word), str(error)
    except AnyTraverseError as error:
        yield ("words",), str(error)
