"""Loads a `Config` from TOML files, with words and vocabulary, and reports all problems at once."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from anytraverse.errors import SettingsError
from anytraverse.preferences import Preferences, clean_word
from companion.cameras.shown import shown
from companion.config.calibrated import calibrate
from companion.config.checks import (
    NestedError,
    Section,
    ValueCheck,
    checks_of,
    harmless,
    listing,
    number,
    text,
)
from companion.config.link_settings import LONGEST_PACE_WITH_STICKS
from companion.config.radio import ConnectionSection
from companion.config.schema import OF_A_VEHICLE, SECTIONS, WORD_KEYS, Config, VehicleSection
from companion.config.stopping import ground_region
from companion.config.toml_file import ConfigError, Layer, Problem, nearest
from companion.config.toml_lines import KeyPath
from companion.wire.parameters import MAX_WORDS, OBSTACLE, build, word_parameter

SERVICE = Path("/var/lib/anytraverse")
"""The service's state folder. systemd sets $STATE_DIRECTORY for the service, but not in a person's shell."""
_OF_JUDGING = {"camera": ("rate", "view", "latency"), "perceiver": ("name", "precision", "scene_every")}
"""Settings by which frames are judged, beside `OF_A_VEHICLE`. Where a network runs is this computer's."""
WORDS_OFFERED = listing(text, 0, MAX_WORDS)


def load_config(path: str | Path) -> Config:
    """Load the file `path` and the vehicle's file that it names; `path` wins. Raises ConfigError."""
    return load_layer(read_layer(path))


def read_layer(path: str | Path, raw: bytes | None = None) -> Layer:
    """Read the file `path`, or `raw` as what is to stand in it. Raises ConfigError."""
    file = Path(os.path.expanduser(path))
    return Layer.read(file, may_be_shown) if raw is None else Layer.parse(file, raw, may_be_shown)


def load_layer(main: Layer) -> Config:
    """Make the configuration of a file, and of the vehicle's file that it names. Raises ConfigError."""
    problems: list[Problem] = []
    vehicle = _read_vehicle(main, problems)
    config = _checked(main, vehicle, problems)
    folder = main.path.parent.absolute()
    return replace(
        config,
        camera=config.camera.with_paths_in(folder),
        perceiver=config.perceiver.with_paths_in(folder),
        link=config.link.with_paths_in(folder),
        journal=config.journal.with_paths_in(folder),
    )


def recorded_config(text: str) -> Config:
    """Load the settings by which frames were judged, of a configuration that a rover recorded.

    text: by `format_config`. All else has its defaults: a recording may come from anybody, so that no file,
    folder or address in it is used. Raises ConfigError.
    """
    recorded = Layer.parse(Path("its companion.toml"), text.encode(errors="replace"))
    return _checked(recorded.only(OF_A_VEHICLE, _OF_JUDGING), None, [])


def _checked(main: Layer, vehicle: Layer | None, problems: list[Problem]) -> Config:
    """Make the configuration. Raises ConfigError with `problems`, those found before, and all others."""
    layers = [main]
    _refuse_unknown(main, (*WORD_KEYS, *SECTIONS), problems)
    if vehicle is not None:
        _refuse_unknown(vehicle, OF_A_VEHICLE, problems)
        layers.append(vehicle)
    sections: dict[str, Any] = {
        name: _read_section(name, section, layers if name in OF_A_VEHICLE else [main], problems)
        for name, section in SECTIONS.items()
    }
    calibration = calibrate(main, sections, problems)
    words = read_words(layers, problems)
    problems += _too_slow_for_sticks(main, sections)
    for section, key in (("web", "token"), ("alert", "url")):
        if getattr(sections[section], key) and main.is_open_to_all():
            reason = f"everybody on this computer may read it: chmod o-r {main.path}"
            problems.append(main.problem((section, key), reason))
    if not problems:
        try:
            ground_region(Config(**sections))
        except SettingsError as error:
            problems.append(main.problem(("roi", "far"), f"{error}: see [mount] and [roi] near, far, width"))
    if problems:
        raise ConfigError(problems)
    if sections["video"].listen and len(words.vocabulary) < MAX_WORDS:
        # A tap in the video names an obstacle: with a parameter of its own it can be taken back.
        words = words._replace(vocabulary=tuple(dict.fromkeys((*words.vocabulary, OBSTACLE[0]))))
    return Config(**sections, **words._asdict(), calibration=calibration)


def _too_slow_for_sticks(main: Layer, sections: Mapping[str, Any]) -> list[Problem]:
    """Refuse connections on which the dead man's stream would leave no room for replies."""
    link = sections["link"]
    paces = {("link", "pace"): link.pace} | {
        ("link", "more", name, "pace"): one.pace for name, one in link.more
    }
    most = LONGEST_PACE_WITH_STICKS
    return [
        main.problem(keys, f'give at most {most:g}, or set [call] px4_deadman = "off"')
        for keys, pace in paces.items()
        if pace > most and sections["call"].px4_deadman != "off"
    ]


def state_folder(config: Config, service: Path = SERVICE) -> Path:
    """Return the state folder of the companion: the configured one, else the service's if it exists."""
    said = config.journal.folder or os.environ.get("STATE_DIRECTORY")
    return service if not said and service.is_dir() else config.journal.path


def word_problem(path: str | Path, word: str, reason: str) -> Problem:
    """Make a problem with a word in use, located in `path` or in the vehicle's file. Raises ConfigError."""
    return located(read_layer(path), ("words", word), reason)


def located(main: Layer, keys: KeyPath, reason: str) -> Problem:
    """Make a problem with the value that is in force at `keys`, in `main` or in the vehicle's file."""
    return (owner(main, keys) or main).problem(keys, reason)


def owner(main: Layer, keys: KeyPath) -> Layer | None:
    """Return the file whose value at `keys` is in force, `main` or the vehicle's; None: it is the default.

    Of words, vocabulary and aliases the first file that has any has them all.
    """
    if keys[0] in WORD_KEYS:
        keys = keys[:1]
    layers = [main] if main.value(keys) is not None else [main, _read_vehicle(main, [])]
    return next((one for one in layers if one is not None and one.value(keys) is not None), None)


def _read_vehicle(main: Layer, problems: list[Problem]) -> Layer | None:
    name = main.table("vehicle", []).get("file", VehicleSection().file)
    if not isinstance(name, str) or not name:
        return None
    path = main.path.parent / os.path.expanduser(name)
    if not os.path.isfile(path):
        problems.append(
            main.problem(
                ("vehicle", "file"), f'there is no file {shown(str(path))}: name the vehicle\'s file, or ""'
            )
        )
        return None
    try:
        return Layer.read(path, may_be_shown)
    except ConfigError as error:
        problems.extend(error.problems)
        return None


def _refuse_unknown(layer: Layer, known: Sequence[str], problems: list[Problem]) -> None:
    for name in layer.data:
        if name in known:
            continue
        place = _place_of(layer, name)
        if name in SECTIONS:
            reason = "does not belong in a vehicle's file: move it to companion.toml"
        elif place:
            reason = f"belongs {place}"
        else:
            reason = f"is not known; {nearest(name, known)}"
        problems.append(layer.problem((name,), reason))


def _place_of(layer: Layer, key: str) -> str:
    """Say below which [section] a setting belongs; "" when there is no such setting."""
    place = next((name for name, section in SECTIONS.items() if key in checks_of(section)), None)
    if place is None:
        return ""
    # In the shipped file headlines are commented out like the settings below them, and easily left so.
    missing = "" if place in layer.data else ": write that headline above it, or take its # away"
    return f"below [{place}]{missing}"


def may_be_shown(keys: KeyPath, value: object) -> object:
    """Return what may be shown of a value of the file; None for nothing, as of unknown settings."""
    match keys:
        case ("words", _):
            return harmless(value)
        case ("link", "more", _, key):
            check = checks_of(ConnectionSection).get(key)
        case (name, key) if name in SECTIONS:
            check = checks_of(SECTIONS[name]).get(key)
        case _:
            check = None
    return check.shown(value) if check is not None and check.shown is not None else None


def _read_section(
    name: str, section: type[Section], layers: Sequence[Layer], problems: list[Problem]
) -> Section:
    """Read a section. The first layer that has a setting gives its value; a wrong value is left out."""
    checks = checks_of(section)
    given: dict[str, Any] = {}
    source: dict[str, Layer] = {}
    before = len(problems)
    for layer in reversed(layers):  # the first layer comes last, and overwrites the others
        for key, value in layer.table(name, problems).items():
            if key not in checks:
                place = _place_of(layer, key)
                hint = f"it belongs {place}" if place else nearest(key, checks)
                problems.append(layer.problem((name, key), f"is not known; {hint}"))
                continue
            try:
                given[key] = checks[key](value)
                source[key] = layer
            except NestedError as error:
                problems += [layer.problem((name, key, *keys), reason) for keys, reason in error.found]
            except ValueError as error:
                problems.append(layer.problem((name, key), str(error)))
    read = section(**given)
    # Only when each setting is valid by itself: the default in place of a wrong one could cause false
    # complaints.
    if len(problems) == before:
        for keys, reason in read.conflicts():
            path = next((path for path in map(_path, keys) if path[0] in source), _path(keys[0]))
            problems.append(source.get(path[0], layers[0]).problem((name, *path), reason))
    return read


def _path(keys: str) -> tuple[str, ...]:
    return tuple(keys.split("."))


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
