"""Changes the configuration file by program: proposes a text, and writes it whole.

propose() edits and checks and writes nothing; write() replaces the file, and keeps the versions before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from anytraverse.preferences import clean_word
from companion.config.guards import Guard, guard_of, guards_old, guards_words, split_key
from companion.config.reading import owner, read_layer
from companion.config.schema import SECTIONS, WORD_KEYS
from companion.config.shown_diff import shown_diff
from companion.config.toml_edit import EditError, edited
from companion.config.toml_file import ConfigError, Layer, Problem
from companion.config.toml_lines import KeyPath
from companion.config.versions import write_version
from companion.config.whole_check import problems_of
from companion.wire.parameters import OBSTACLE

__all__ = ["Guard", "Proposal", "guard_of", "propose", "write"]


@dataclass(frozen=True)
class Proposal:
    """A changed text of the configuration file.

    before, after: the file's texts; they may hold secrets. diff: unified, with secrets left out, "" where
    nothing changes. problems: what `companion config check` would say of the text after, but for what only a
    bundle of the perceiver says. guarded: the keys that need loopback, for the value before or after.
    """

    before: str = field(repr=False)
    after: str = field(repr=False)
    diff: str
    problems: tuple[Problem, ...]
    guarded: tuple[str, ...]


def propose(path: Path, changes: Mapping[str, object | None]) -> Proposal:
    """Propose the text of the file `path` with `changes`, keeping its comments and its order.

    changes: "section.key" -> a value of a TOML type, None: the key is removed. "words.WORD" and
    "aliases.WORD" are entries of these tables, "words" and "aliases" the whole tables, "vocabulary" the whole
    list, in which words in use stay, "link.more" all further connections, {"NAME.url": ...}. Where the
    vehicle's file has the words, its words are copied first, since the tables of one file count; without its
    last word it has an empty table.
    Raises ConfigError for a file that cannot be read.
    """
    layer = read_layer(path)
    before = layer.text
    problems: list[Problem] = []
    guarded = [key for key, value in changes.items() if _is_guarded(layer, key, value, problems)]
    after = before
    if not problems:
        text = before.replace("\r\n", "\n")
        try:
            text = edited(text, _keyed(layer, changes))
        except (EditError, ValueError) as error:
            problems.append(Problem(path, None, "", None, str(error)))
        after = text.replace("\n", "\r\n") if "\r\n" in before else text
    if not problems:
        problems += _problems(path, after)
    return Proposal(before, after, shown_diff(before, after, path.name), tuple(problems), tuple(guarded))


def _problems(path: Path, text: str) -> tuple[Problem, ...]:
    try:
        return problems_of(read_layer(path, text.encode()))
    except ConfigError as error:
        return error.problems


def _is_guarded(layer: Layer, key: str, value: object, problems: list[Problem]) -> bool:
    """Whether a change needs loopback, for its value or for the one that is in force before."""
    try:
        keys = split_key(key)
    except ValueError as error:
        problems.append(Problem(layer.path, None, key, None, str(error)))
        return True
    if keys[0] in WORD_KEYS:
        return guards_words(layer.value(("perceiver", "name")))
    holder = owner(layer, keys)
    old = holder.value(keys) if holder is not None else getattr(SECTIONS[keys[0]](), keys[1], None)
    return guard_of(key, value) is Guard.LOOPBACK or guards_old(key, old)


def _keyed(layer: Layer, changes: Mapping[str, object | None]) -> dict[KeyPath, object]:
    """Return the changes by the keys of the file; those of whole tables word by word."""
    found: dict[KeyPath, object] = {}
    for key, value in changes.items():
        keys = split_key(key)
        if keys == ("link", "more"):
            found |= _connections(layer.value(keys), value)
            continue
        if keys[0] not in ("words", "aliases"):
            kept = _also_in_use(layer, value) if keys == ("vocabulary",) and isinstance(value, list) else []
            found[keys] = [*kept, *value] if kept and isinstance(value, list) else value
            continue
        held = owner(layer, keys)
        there: Mapping[str, Any] = held.table(keys[0], []) if held is not None else {}
        if len(keys) == 1 and value is None:
            found = {one: v for one, v in found.items() if one[0] != keys[0]} | {keys: None}
            continue
        if held is not layer:  # this file's table will replace that of the vehicle's file
            found = {(keys[0], word): v for word, v in there.items()} | found
        as_written = {clean_word(word): word for word in there}
        if len(keys) == 2:
            new = {keys[1]: value}
        elif isinstance(value, Mapping):
            cleaned = {clean_word(word) for word in value}
            if len(cleaned) < len(value):
                raise ValueError(f"{key}: a word stands twice, differently spelled: keep one")
            new = {word: None for one, word in as_written.items() if one not in cleaned} | dict(value)
        else:
            raise ValueError(f"{key}: give a table")
        found |= {
            (keys[0], as_written.get(clean_word(word), word)): v
            for word, v in new.items()
            if v is not None or clean_word(word) in as_written
        }
    return found


def _also_in_use(layer: Layer, value: list[object]) -> list[object]:
    """Return what the list has besides: words in use, and that of the video. No page shows these in it."""
    listed, used = owner(layer, ("vocabulary",)), owner(layer, ("words",))
    there = listed.value(("vocabulary",)) if listed is not None else None
    unshown = {clean_word(word) for word in (used.table("words", []) if used is not None else {})}
    if layer.value(("video", "listen")):
        unshown.add(OBSTACLE[0])
    given = {clean_word(one) for one in value if isinstance(one, str)}
    return [
        one
        for one in (there if isinstance(there, list) else [])
        if isinstance(one, str) and clean_word(one) in unshown - given
    ]


def _connections(there: object, value: object) -> dict[KeyPath, object]:
    """Return the changes by which all further connections of a link are these. there: those of the file."""
    if value is not None and not isinstance(value, Mapping):
        raise ValueError("link.more: give a table of NAME.url and the like")
    new = {split_key(f"link.more.{one}"): v for one, v in (value or {}).items()}
    found: dict[KeyPath, object] = dict(new)
    for name, table in there.items() if isinstance(there, Mapping) else ():
        kept = {keys[3] for keys in new if keys[2] == name}
        if not kept:
            found["link", "more", name] = None
            continue
        found |= {("link", "more", name, key): None for key in table if key not in kept}
    return found


def write(path: Path, proposal: Proposal) -> Path:
    """Write the text after into the file, and return the path of the kept version before, `path`.1.

    Owner, group and rights stay. `path`.1 to .5 are the last five versions, the newest first. Raises
    ConfigError where the proposal has problems, the file is no longer the one before or no regular file, or
    it cannot be written; the file is then unchanged.
    """
    if proposal.problems:
        raise ConfigError(proposal.problems)
    try:
        return write_version(path, proposal.before.encode(), proposal.after.encode())
    except OSError as error:
        denied = ": try again with sudo" if isinstance(error, PermissionError) else ""
        why = f"is not written: {error.strerror or error}{denied}"
        raise ConfigError([Problem(path, None, "", None, why)]) from error
