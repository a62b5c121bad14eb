"""Runs `companion memory`: prints, exports, forgets and imports what the answers taught."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from anytraverse.errors import AnyTraverseError
from anytraverse.frame import Frame
from anytraverse.history import Entry, History
from anytraverse.memory import Memory, first_memory
from anytraverse.perception import Perceiver, Prompt, surroundings_of
from anytraverse.preferences import MAX_WORDS, Preferences, Setting
from anytraverse.regions import Box
from anytraverse.synonyms import Meaning, meaning_of, opposed
from companion.config import Config, load_config, state_folder
from companion.desk.memory import listing
from companion.desk.memory.listing import delete_unused, picture_of, read_picture, store_picture
from companion.desk.memory.scene_file import ExpectedModel, Scene, SceneFileError, read_scenes, write_scenes
from companion.storage.batch import Batch
from companion.storage.database import JournalError
from companion.storage.journal import Journal
from companion.storage.journal_copy import read_stored_memory, told_of_damage
from companion.system.as_owner import as_owner

ALL = "all"


class MemoryCommandError(Exception):
    """The command cannot be carried out. The text says what to do."""


def show_list(file: str, *, as_json: bool = False) -> int:
    """Print one line for each answered scene. Raises MemoryCommandError, ConfigError, JournalError."""
    config = load_config(file)
    folder = state_folder(config)
    memory, damage = read_stored_memory(folder), told_of_damage(folder)
    if damage:
        print(damage)
    if memory is None:
        print(f"nothing is remembered in {folder}")
    else:
        limit = config.journal.scenes
        print(f"{len(memory.history)} of at most {limit} scenes, learnt with model {memory.model_id}")
        if memory.history:
            print(listing.HEAD)
        for entry in memory.history:
            print(listing.row(folder, entry))
    if as_json:
        scenes = [] if memory is None else [listing.figures(folder, entry) for entry in memory.history]
        model = None if memory is None else memory.model_id
        print(json.dumps({"model": model, "scenes": scenes, "damage": damage or None}))
    return 0


def show_scene(file: str, number: int, out: str | None = None) -> int:
    """Print a scene, and name its picture. out: where the picture is copied to. Raises as `show_list`."""
    folder = state_folder(load_config(file))
    entry = _entry(read_stored_memory(folder), number)
    print(f"scene     {number}")
    print(f"call      {listing.call_text(entry)}")
    print(f"answered  {listing.time_text(entry)}")
    print(f"place     {listing.place_text(entry)}")
    for word, weight in entry.preferences.items():
        taps = len(entry.examples.get(word, ()))
        print(f"word      {word}: {weight:g}{f', tapped {taps} x' if taps else ''}")
    if entry.refused:
        print(f"refused   {len(entry.refused)} frames that an operator said are another place")
    picture = picture_of(folder, entry)
    if picture is None:
        print("picture   none: those of calls are kept, unless [pictures] keep is 0, and imported ones")
        return 0 if out is None else 1
    print(f"picture   {picture}")
    if out is not None:
        with _naming(out):
            with as_owner(folder):
                content = read_picture(folder, entry)
            Path(out).write_bytes(content)
        print(f"copied to {out}")
    return 0


def forget(file: str, which: Sequence[str]) -> int:
    """Forget scenes by number, or all of them with the reference, as `new episode` does. Raises as above."""
    folder = state_folder(load_config(file))
    stored = read_stored_memory(folder)  # before the journal is locked, which a wrong number does not need
    chosen = None if list(which) == [ALL] else {_entry(stored, _number(one)).order for one in which}
    if stored is None:
        raise MemoryCommandError(f"nothing is remembered in {folder}")
    _become_owner(folder)
    with _stopped(folder, "or type on the ground `new episode`, or `forget call N`") as journal:
        memory = journal.load_memory()
        if memory is None:
            raise MemoryCommandError(f"nothing is remembered in {folder}")
        left = [] if chosen is None else [one for one in memory.history if one.order not in chosen]
        after = replace(memory, history=History(left, memory.history.limit), clock=memory.clock + 1)
        if chosen is None:
            after = after.at(None)
        journal.commit(Batch(memory=after.using(after.preferences, after.examples)))
    delete_unused(folder, left)
    print(f"{len(memory.history) - len(left)} scenes are forgotten, {len(left)} are left")
    return 0


def export(file: str, to: str) -> int:
    """Write all scenes to a new file. Raises as `show_list`, and SceneFileError."""
    folder = state_folder(load_config(file))
    memory = read_stored_memory(folder)
    if memory is None or not memory.history:
        raise MemoryCommandError(f"nothing is remembered in {folder}: there is nothing to export")
    with _naming(to):
        with as_owner(folder):
            scenes = [Scene(entry, read_picture(folder, entry)) for entry in memory.history]
        left_out = write_scenes(Path(to), memory.model_id, scenes)
    pictures = sum(bool(scene.picture) for scene in scenes) - left_out
    print(f"{to}: {len(scenes)} scenes of model {memory.model_id}, {pictures} with a picture")
    if left_out:
        print(f"{left_out} pictures did not fit and are left out")
    return 0


def take_in(file: str, source: str) -> int:
    """Add the scenes of an exported file, as if they were answered now. Raises as `export`."""
    config = load_config(file)
    folder = state_folder(config)
    with _naming(source):
        perceiver, scenes = read_checked(config, Path(source))
    model_id = perceiver.model_id
    _become_owner(folder)
    with _stopped(folder, "then type this again") as journal:
        memory = journal.load_memory()
        if memory is None:
            memory = first_memory(model_id, config.preferences, config.journal.scenes)
        elif memory.model_id != model_id:
            raise MemoryCommandError(
                f"{folder} holds scenes of model {memory.model_id}, and [perceiver] name is {model_id}: set "
                "it back, or start the companion once, which leaves the old scenes out, and stop it"
            )
        after, added, known, left_out = merged(memory, scenes, config.journal.scenes, perceiver.meaning)
        if added:
            journal.commit(Batch(memory=after))
    lost = _store_pictures(folder, after, added)
    print(
        f"{len(added)} scenes are added, {known} were there already; now {len(after.history)} are remembered"
    )
    if left_out:
        print(
            f"{left_out} did not fit: [journal] scenes is {config.journal.scenes}: raise it, or forget some"
        )
    if lost:
        print(f"{lost} pictures could not be written to {folder}: make room on the disk")
    if new := after.preferences.without(*memory.preferences):
        print(f"words that are in force from now on: {new.format()}")
    if words := _overruled(memory, added):
        print(f"words set here without a call that these scenes set otherwise: {', '.join(words)}")
    return 0


def merged(
    memory: Memory, scenes: Sequence[Scene], limit: int, meaning: Meaning
) -> tuple[Memory, list[Scene], int, int]:
    """Return the memory with the scenes added, those that were added, how many it had, how many lack room.

    They count as answered now, in the order of the file, and by no call of this rover. Never forgets a scene
    for a new one. limit: the most scenes. Words of the newest scene come into force, unless this rover knows
    them: surroundings are familiar only where the words of their scenes are in force.
    """
    had = {_content(entry) for entry in memory.history}
    new: list[Scene] = []
    known = left_out = 0
    for scene in reversed(scenes):  # the newest come first into what room there is
        content = _content(scene.entry)
        if content in had:
            known += 1
        elif len(memory.history) + len(new) >= limit:
            left_out += 1
        else:
            had.add(content)
            new.append(scene)
    clock, added = memory.clock, list[Scene]()
    for scene in reversed(new):
        clock += 1
        words = Preferences(
            {word: Setting(weight, clock) for word, weight in scene.entry.preferences.items()}
        )
        entry = replace(scene.entry, preferences=words, order=clock, matched=clock, call_id=0)
        added.append(replace(scene, entry=entry))
    entries = [*memory.history, *(scene.entry for scene in added)]
    history = History(entries, max(limit, len(memory.history)))
    given = {word: weight for one in added for word, weight in one.entry.preferences.items()}
    after = replace(memory, history=history, clock=clock)
    if new and new[0] is scenes[-1]:  # an older one may have words that were forgotten since
        after = _with_new_words(after, added[-1].entry, meaning)
    return after.giving(given), added, known, left_out


def _with_new_words(memory: Memory, entry: Entry, meaning: Meaning) -> Memory:
    """Return the memory with those words of an entry in force that it does not know, as far as they fit."""
    own = memory.preferences
    words = {
        word: setting
        for word, setting in entry.preferences.settings.items()
        if not any(word in known for known in (own, memory.settled, memory.given))
        and not opposed(word, setting.weight, own, meaning)
        and (word in entry.examples or meaning_of(word, meaning) is not None)
    }
    new = Preferences(dict(islice(reversed(words.items()), MAX_WORDS - len(own))))  # the last set first
    taps = {word: kept for word, kept in entry.examples.items() if word in new}
    return memory.using(own.merged(new), {**memory.examples, **taps})


def _content(entry: Entry) -> tuple[bytes, Preferences]:
    return entry.embedding.tobytes(), entry.preferences


def _overruled(memory: Memory, added: Sequence[Scene]) -> list[str]:
    words = memory.preferences
    differing = {
        word
        for scene in added
        for word, weight in scene.entry.preferences.items()
        if words.get(word, weight) != weight
    }
    return sorted(differing & set(memory.settled))


def _store_pictures(folder: Path, memory: Memory, added: Sequence[Scene]) -> int:
    """Store the pictures of added scenes. Returns how many could not be written."""
    delete_unused(folder, memory.history)
    return sum(not store_picture(folder, scene.entry, scene.picture) for scene in added if scene.picture)


def read_checked(config: Config, source: Path) -> tuple[Perceiver, list[Scene]]:
    """Read an exported file, and try it on the perceiver. Returns that, too. Takes seconds.

    Raises OSError, SceneFileError, MemoryCommandError.
    """
    from companion.vision.warm_up import load_engine

    image = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    try:
        engine, _ = load_engine(config, None)
        perceiver, seen = engine.perceiver, engine.observe(Frame(0, 0.0, image))
        example = perceiver.example(seen.features, Box(0.3, 0.3, 0.7, 0.7))
    except AnyTraverseError as error:
        raise MemoryCommandError(f"the perceiver does not run: {error}") from error
    around = surroundings_of(perceiver, seen.features)
    lengths = len(seen.embedding), len(example.vector), 0 if around is None else len(around)
    scenes = read_scenes(source, ExpectedModel(perceiver, *lengths))
    taps = {id(tap): tap for scene in scenes for kept in scene.entry.examples.values() for tap in kept}
    for tap in taps.values():
        try:
            whole = bool(np.isfinite(perceiver.attend(seen.features, [Prompt("tapped", (tap,))])).all())
        except (AnyTraverseError, ArithmeticError, ValueError):
            whole = False
        if not whole:
            raise SceneFileError(f"{source}: the perceiver cannot use a tapped example: nothing is imported")
    return perceiver, scenes


def _become_owner(folder: Path) -> None:
    """As root, go on as the folder's owner: a file of root's in it would keep out the service, for good."""
    if os.geteuid() != 0:
        return
    try:
        owner = folder.stat()
    except OSError as error:
        raise MemoryCommandError(f"{folder} is not there: start the companion once, and stop it") from error
    if owner.st_uid != 0:
        os.setgroups([])
        os.setgid(owner.st_gid)
        os.setuid(owner.st_uid)


@contextmanager
def _stopped(folder: Path, otherwise: str) -> Iterator[Journal]:
    """Open the journal of a companion that is stopped. Raises MemoryCommandError while it runs."""
    if folder.exists() and not os.access(folder, os.R_OK | os.W_OK | os.X_OK):
        raise MemoryCommandError(f"{folder} may not be written: type this with sudo")
    try:
        journal = Journal(folder)
    except JournalError as error:
        if "in use" in str(error):
            raise MemoryCommandError(
                f"a companion runs with {folder}: stop it first (sudo systemctl stop companion), {otherwise}"
            ) from error
        raise
    try:
        if journal.recovered_from is not None:
            raise MemoryCommandError(
                f"the journal was damaged, set aside as {journal.recovered_from}: {journal.recovered}: see "
                "`companion memory list`, then type this again"
            )
        yield journal
        journal.tidy()
    finally:
        journal.close()


@contextmanager
def _naming(path: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise MemoryCommandError(
            f"{error.filename or path}: {why}: name another file, or use sudo"
        ) from error
    except SceneFileError as error:
        raise MemoryCommandError(str(error)) from error


def _number(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise MemoryCommandError(
            f'"{text}" is no scene: `companion memory list` numbers them, or type all'
        ) from None


def _entry(memory: Memory | None, number: int) -> Entry:
    found = next((one for one in memory.history if one.order == number), None) if memory is not None else None
    if found is None:
        raise MemoryCommandError(f"no scene {number} is remembered: `companion memory list` numbers them")
    return found
