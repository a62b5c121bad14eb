"""`companion memory` as it is typed: what a person sees, and what is in the journal afterwards."""

from __future__ import annotations

import json
import os
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.adoption import adopted_memory
from anytraverse.history import Entry, History, Match, Place
from anytraverse.memory import Memory, first_memory
from anytraverse.perception import Example, make_perceiver
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from companion.cli import main
from companion.config import load_config
from companion.desk.memory.command import merged
from companion.desk.memory.scene_file import Scene
from companion.storage import Batch, Journal, JournalError
from companion.storage.salvage import salvage
from companion.vision.warm_up import load_engine
from tests.companion.desk.memory.test_scene_file import PICTURE

PERCEIVER = make_perceiver("builtin:lexicon")
IMAGE = np.random.default_rng(1).integers(0, 256, (48, 64, 3), dtype=np.uint8)
Say = Callable[..., tuple[int, str, str]]


class Rover:
    """A configuration with a state folder of its own, and what is typed on it."""

    def __init__(self, path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        path.mkdir()
        self.state = path / "state"
        self.config = path / "companion.toml"
        self.config.write_text(
            '[vehicle]\nfile = ""\n[perceiver]\nname = "builtin:lexicon"\n[journal]\nfolder = "state"\n'
            "scenes = 4\n[words]\ngrass = 1.0\n"
        )
        self._capsys = capsys

    def type(self, *words: str) -> tuple[int, str, str]:
        """Exit code, output and errors of `companion memory ...`."""
        code = main(["memory", words[0], "--config", str(self.config), *words[1:]])
        told = self._capsys.readouterr()
        return code, told.out, told.err

    @property
    def memory(self) -> Memory | None:
        """What the journal holds."""
        journal = Journal(self.state)
        memory = journal.load_memory()
        journal.close()
        return memory

    def taught(self, *calls: int) -> None:
        """Scenes in which a drum was tapped, with pictures of their calls."""
        features = PERCEIVER.encode(IMAGE)
        tap = PERCEIVER.example(features, Box(0.3, 0.3, 0.7, 0.7))
        memory = self.memory or first_memory(PERCEIVER.model_id, Preferences.of({"grass": 1.0}), 4)
        wide = len(PERCEIVER.embed(features))
        (self.state / "calls").mkdir(exist_ok=True)
        for call in calls:
            words = Preferences.of({"grass": 1.0, "drum": -1.0}, call)
            memory = replace(memory, preferences=words, examples={"drum": (tap,)})
            embedding = np.random.default_rng(call).random(wide).astype(np.float32)
            memory = memory.remembering(embedding, call, Place(47.0, 8.0, None, 1_790_000_000.0), move=True)
            (self.state / "calls" / f"{call}.jpg").write_bytes(PICTURE)
        journal = Journal(self.state)
        journal.commit(Batch(memory=memory))
        journal.close()


@pytest.fixture
def rover(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Rover:
    return Rover(tmp_path / "rover", capsys)


@pytest.fixture
def other(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Rover:
    return Rover(tmp_path / "other", capsys)


def test_scenes_are_listed_with_call_place_picture_and_words(rover: Rover) -> None:
    rover.taught(7, 8)
    code, told, _ = rover.type("list", "--json")
    head, _, seven, eight, last = told.splitlines()
    assert (code, head) == (0, f"2 of at most 4 scenes, learnt with model {PERCEIVER.model_id}")
    assert seven.split()[:2] == ["1", "C7"]
    assert seven.endswith(
        "  47.00000, 8.00000     yes            0  no            grass: 1; drum: -1 (tapped)"
    )
    assert eight.split()[:2] == ["2", "C8"]
    assert [scene["call"] for scene in json.loads(last)["scenes"]] == [7, 8]


def test_a_damaged_journal_is_told_with_what_was_recovered_of_it(rover: Rover) -> None:
    rover.taught(7, 8)
    with sqlite3.connect(rover.state / "journal.db") as connection:
        connection.execute("UPDATE entries SET embedding = x'01' WHERE call_id = 7")
    connection.close()
    code, _, why = rover.type("forget", "all")
    assert code == 2
    assert "is damaged: start the companion, which sets it aside" in why
    assert rover.memory is not None
    code, told, _ = rover.type("list", "--json")
    first, *_, last = told.splitlines()
    assert code == 0
    assert first.startswith("the journal was damaged (the memory cannot be read: ")
    assert first.endswith("journal.damaged-1.db: 1 scenes recovered")
    assert json.loads(last)["damage"] == first
    assert [scene["call"] for scene in json.loads(last)["scenes"]] == [8]


def test_what_is_forgotten_is_forgotten_in_the_copy_too(rover: Rover) -> None:
    rover.taught(7, 8)
    assert rover.type("forget", "1")[0] == 0
    copied = salvage(rover.state / "journal.copy.db").memory
    assert copied is not None
    assert [entry.call_id for entry in copied.history] == [8]


def test_how_often_a_scene_was_refused_is_listed_and_shown(rover: Rover) -> None:
    rover.taught(7)
    journal = Journal(rover.state)
    memory = journal.load_memory()
    assert memory is not None
    refused = memory.history.refusing({1}, memory.history[0].embedding)
    journal.commit(Batch(memory=replace(memory, history=refused)))
    journal.close()
    _, told, _ = rover.type("list", "--json")
    assert "yes            1  no            grass: 1" in told
    assert json.loads(told.splitlines()[-1])["scenes"][0]["refused"] == 1
    assert "refused   1 frames that an operator said are another place\n" in rover.type("show", "1")[1]


def test_a_scene_is_shown_with_its_picture(rover: Rover, tmp_path: Path) -> None:
    rover.taught(7)
    code, told, _ = rover.type("show", "1", "--out", str(tmp_path / "7.jpg"))
    assert code == 0
    assert "word      drum: -1, tapped 1 x\n" in told
    assert f"picture   {rover.state}/calls/7.jpg\n" in told
    assert (tmp_path / "7.jpg").read_bytes() == PICTURE
    (rover.state / "calls" / "7.jpg").unlink()
    assert rover.type("show", "1")[0] == 0
    assert rover.type("show", "1", "--out", str(tmp_path / "7.jpg"))[0] == 1


def test_where_nothing_is_remembered_each_command_says_so_and_makes_nothing(
    rover: Rover, tmp_path: Path
) -> None:
    assert rover.type("list") == (0, f"nothing is remembered in {rover.state}\n", "")
    for words in (["show", "1"], ["forget", "1"], ["forget", "all"], ["export", str(tmp_path / "file")]):
        code, _, told = rover.type(*words)
        assert code == 2
        assert "remembered" in told
    assert not rover.state.exists()
    assert not (tmp_path / "file").exists()


def test_scenes_are_forgotten_one_by_one_and_all(rover: Rover) -> None:
    rover.taught(7, 8, 9)
    assert rover.type("forget", "1", "3")[1] == "2 scenes are forgotten, 1 are left\n"
    memory = rover.memory
    assert memory is not None
    assert [entry.call_id for entry in memory.history] == [8]
    assert memory.reference is not None
    assert rover.type("forget", "2", "3")[2].startswith("companion memory: no scene 3 is remembered")
    assert rover.type("forget", "all")[1] == "1 scenes are forgotten, 0 are left\n"
    memory = rover.memory
    assert memory is not None
    assert (len(memory.history), memory.reference) == (0, None)
    assert dict(memory.preferences) == {"grass": 1.0, "drum": -1.0}, "words in use stay"


def test_after_all_scenes_are_forgotten_there_is_no_match_to_refuse(rover: Rover) -> None:
    rover.taught(7)
    memory = rover.memory
    assert memory is not None
    (scene,) = memory.history
    memory, _ = adopted_memory(memory, Match(scene, 0.9), str, scene.embedding)
    journal = Journal(rover.state)
    journal.commit(Batch(memory=memory))
    journal.close()
    assert rover.type("forget", "all")[0] == 0
    memory = rover.memory
    assert memory is not None
    assert (memory.reference, memory.adoption) == (None, None)


@pytest.mark.slow
def test_what_changes_the_memory_is_refused_while_a_companion_has_it_and_what_reads_is_not(
    rover: Rover, tmp_path: Path
) -> None:
    rover.taught(7)
    file = tmp_path / "scenes"
    journal = Journal(rover.state)
    try:
        assert rover.type("list")[0] == 0
        assert rover.type("show", "1")[0] == 0
        assert rover.type("export", str(file))[0] == 0
        for words, then in ((["forget", "1"], "`forget call N`"), (["import", str(file)], "type this again")):
            code, _, told = rover.type(*words)
            assert code == 2
            assert "stop it first (sudo systemctl stop companion)" in told
            assert then in told
    finally:
        journal.close()


def test_scenes_are_carried_to_another_rover_with_words_taps_and_pictures_once(
    rover: Rover, other: Rover, tmp_path: Path
) -> None:
    rover.taught(7, 8)
    file = str(tmp_path / "scenes")
    assert "2 scenes" in rover.type("export", file)[1]
    other.state.mkdir()
    code, told, _ = other.type("import", file)
    assert code == 0
    assert told == (
        "2 scenes are added, 0 were there already; now 2 are remembered\n"
        "words that are in force from now on: drum: -1\n"
    )
    memory, before = other.memory, rover.memory
    assert memory is not None
    assert before is not None
    assert [entry.embedding.tolist() for entry in memory.history] == [
        entry.embedding.tolist() for entry in before.history
    ]
    assert [(entry.call_id, dict(entry.preferences)) for entry in memory.history] == [
        (0, {"grass": 1.0, "drum": -1.0})
    ] * 2, "call 7 of this rover is another one"
    tapped = memory.history[0].examples["drum"][0]
    assert tapped.vector.tolist() == before.history[0].examples["drum"][0].vector.tolist()
    assert [path.read_bytes() for path in (other.state / "scenes").iterdir()] == [PICTURE] * 2
    assert dict(memory.preferences) == {"grass": 1.0, "drum": -1.0}
    assert [tap.vector.tolist() for tap in memory.examples["drum"]] == [tapped.vector.tolist()]
    engine, notices = load_engine(load_config(other.config), memory)
    assert (len(engine.memory.history), notices) == (2, []), "the next start takes it as it is"
    assert other.type("import", file)[1].startswith("0 scenes are added, 2 were there already")
    again = str(tmp_path / "again")
    assert "2 with a picture" in other.type("export", again)[1]
    other.type("forget", "all")
    assert list((other.state / "scenes").iterdir()) == []


def test_only_as_many_scenes_are_added_as_there_is_room_for_and_none_here_goes(
    rover: Rover, other: Rover, tmp_path: Path
) -> None:
    rover.taught(7, 8, 9)
    other.taught(1, 2)
    file = str(tmp_path / "scenes")
    rover.type("export", file)
    told = other.type("import", file)[1]
    assert "2 scenes are added" in told
    assert "1 did not fit: [journal] scenes is 4: raise it, or forget some" in told
    memory = other.memory
    assert memory is not None
    assert [entry.call_id for entry in memory.history] == [1, 2, 0, 0]


def test_words_set_here_that_an_imported_scene_sets_otherwise_are_told(
    rover: Rover, other: Rover, tmp_path: Path
) -> None:
    rover.taught(7)
    words = Preferences.of({"grass": 1.0, "drum": 0.5})
    memory = replace(first_memory(PERCEIVER.model_id, words, 4), settled={"drum": 3, "grass": 3}, clock=3)
    journal = Journal(other.state)
    journal.commit(Batch(memory=memory))
    journal.close()
    rover.type("export", str(tmp_path / "scenes"))
    told = other.type("import", str(tmp_path / "scenes"))[1]
    assert told.endswith("words set here without a call that these scenes set otherwise: drum\n")


def _scene(seed: int, words: str, tapped: str = "") -> Scene:
    embedding = np.random.default_rng(seed).random(3).astype(np.float32)
    taps = {tapped: (Example("m", embedding),)} if tapped else {}
    return Scene(Entry(embedding, Preferences.parse(words), order=0, matched=0, examples=taps))


def test_words_that_a_rover_does_not_know_come_into_force_with_the_newest_imported_scene() -> None:
    memory = first_memory("m", Preferences.parse("grass: 1"))
    scenes = [_scene(1, "mud: 1; trail: 1"), _scene(2, "grass: -1; trail: 0.5; crate: -1; stain: 1", "crate")]
    after, *_ = merged(memory, scenes, 8, PERCEIVER.meaning)
    assert dict(after.preferences) == {"grass": 1.0, "trail": 0.5, "crate": -1.0}, "mud was forgotten there"
    assert list(after.examples) == ["crate"], "nobody can ground a stain"


def test_an_imported_word_does_not_come_into_force_where_the_rover_knows_it_otherwise() -> None:
    begun = first_memory("m", Preferences.parse("grass: 1"))
    own = replace(begun, settled={"trail": 4}, given={"gravel": -1.0}, clock=4)
    scene = _scene(1, "trail: 1; gravel: 1; lawn: -1; bush: -1")
    assert dict(merged(own, [scene], 8, PERCEIVER.meaning)[0].preferences) == {"grass": 1.0, "bush": -1.0}
    full = first_memory("m", Preferences.of({f"word {number}": 1.0 for number in range(15)}))
    after, *_ = merged(full, [scene], 8, PERCEIVER.meaning)
    assert dict(after.preferences) == {**full.preferences, "bush": -1.0}, "the one that was set last fits"


def test_an_older_scene_of_a_file_that_was_imported_before_brings_no_words_into_force() -> None:
    newest = _scene(2, "bush: -1")
    memory, *_ = merged(first_memory("m", Preferences.parse("grass: 1")), [newest], 8, PERCEIVER.meaning)
    after, added, *_ = merged(memory, [_scene(1, "mud: 1"), newest], 8, PERCEIVER.meaning)
    assert len(added) == 1
    assert dict(after.preferences) == {"grass": 1.0, "bush": -1.0}


def test_scenes_of_another_model_are_refused_from_either_side(
    rover: Rover, other: Rover, tmp_path: Path
) -> None:
    rover.taught(7)
    file = tmp_path / "scenes"
    rover.type("export", str(file))
    foreign = tmp_path / "foreign"
    foreign.write_text(file.read_text().replace(PERCEIVER.model_id, "clipseg-1"))
    code, _, told = other.type("import", str(foreign))
    assert code == 2
    assert "scenes of two models cannot be compared" in told
    assert not other.state.exists()
    journal = Journal(other.state)
    journal.commit(Batch(memory=first_memory("clipseg-1", Preferences())))
    journal.close()
    code, _, told = other.type("import", str(file))
    assert code == 2
    assert "holds scenes of model clipseg-1" in told


def test_a_perceiver_that_does_not_run_is_told(rover: Rover, tmp_path: Path) -> None:
    rover.config.write_text(rover.config.read_text().replace("builtin:lexicon", "clipseg:none"))
    (tmp_path / "scenes").write_text("{}\n")
    code, _, told = rover.type("import", str(tmp_path / "scenes"))
    assert code == 2
    assert "the perceiver does not run" in told


def test_a_wrong_configuration_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["memory", "list", "--config", str(tmp_path / "none.toml")]) == 2
    assert "companion init" in capsys.readouterr().err


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can own files as somebody else")
def test_what_root_changes_stays_the_folder_s_owner_s(
    rover: Rover, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with TemporaryDirectory() as opened:  # unlike pytest's own folder, others may enter it
        Path(opened).chmod(0o755)
        _import_as_root(rover, Rover(Path(opened) / "other", capsys), tmp_path)


def _import_as_root(rover: Rover, other: Rover, tmp_path: Path) -> None:
    rover.taught(7)
    rover.type("export", str(tmp_path / "scenes"))
    other.state.mkdir()
    os.chown(other.state, 65534, 65534)
    other.state.rename(tmp_path / "away")
    assert "is not there: start the companion once" in other.type("import", str(tmp_path / "scenes"))[2]
    (tmp_path / "away").rename(other.state)
    arguments = ["memory", "import", str(tmp_path / "scenes"), "--config", str(other.config)]
    script = f"import sys; from companion.cli import main; sys.exit(main({arguments!r}))"
    subprocess.run([sys.executable, "-c", script], check=True, timeout=60)
    found = list(other.state.rglob("*"))
    assert {"journal.db", "scenes"} <= {path.name for path in found}
    assert {path.stat().st_uid for path in found} == {65534}


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can own files as somebody else")
@pytest.mark.parametrize("typed", [("show", "1", "--out"), ("export",)])
def test_a_link_in_the_folder_shows_nobody_what_only_root_may_read(
    typed: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    secret, out = tmp_path / "secret", tmp_path / "out"
    secret.write_bytes(PICTURE)
    with TemporaryDirectory() as opened:
        Path(opened).chmod(0o755)
        rover = Rover(Path(opened) / "rover", capsys)
        rover.taught(1)
        for path in (rover.state, *rover.state.rglob("*")):
            os.chown(path, 65534, 65534)
        assert rover.type(*typed, str(out))[0] == 0
        out.unlink()
        picture = rover.state / "calls" / "1.jpg"
        picture.unlink()
        picture.symlink_to(secret)
        code, _, errors = rover.type(*typed, str(out))
    assert code != 0
    assert "permission denied" in errors
    assert not out.exists()
    assert os.geteuid() == 0


_WORDS = st.sampled_from([Preferences(), Preferences.parse("grass: 1"), Preferences.parse("grass: -1")])
_ENTRIES = st.builds(
    Entry,
    embedding=st.integers(0, 6).map(lambda seed: np.random.default_rng(seed).random(3).astype(np.float32)),
    preferences=_WORDS,
    order=st.just(0),
    matched=st.just(0),
    call_id=st.integers(0, 9),
)


@settings(max_examples=60, deadline=None)
@given(st.lists(_ENTRIES, max_size=5), st.lists(_ENTRIES, max_size=8), st.integers(1, 8))
def test_merging_loses_nothing_that_was_here_keeps_to_the_limit_and_stamps_upwards(
    here: list[Entry], there: list[Entry], limit: int
) -> None:
    own = [replace(entry, order=number, matched=number) for number, entry in enumerate(here)]
    memory = replace(first_memory("m", Preferences()), history=History(own, 8), clock=9)
    scenes = [Scene(entry) for entry in there]
    after, added, known, left_out = merged(memory, scenes, limit, PERCEIVER.meaning)
    assert [entry for entry in after.history if entry.order <= 9] == list(memory.history)
    assert len(added) + known + left_out == len(there)
    assert len(after.history) == len(here) + len(added) <= max(limit, len(here))
    assert [entry.order for entry in [*after.history][len(here) :]] == list(range(10, 10 + len(added)))
    assert after.clock == 9 + len(added)
    contents = {(entry.embedding.tobytes(), entry.preferences) for entry in [*after.history][len(here) :]}
    assert len(contents) == len(added)
    assert after.history.limit >= len(after.history)


def test_somebody_who_may_not_write_there_is_told_to_use_sudo(
    rover: Rover, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rover.taught(7)
    rover.type("export", str(tmp_path / "scenes"))
    monkeypatch.setattr("companion.desk.memory.command.os.access", lambda *_: False)
    for words in (["forget", "all"], ["import", str(tmp_path / "scenes")]):
        told = rover.type(*words)[2]
        assert told == f"companion memory: {rover.state} may not be written: type this with sudo\n"


def test_a_folder_that_may_not_be_entered_is_told(rover: Rover, monkeypatch: pytest.MonkeyPatch) -> None:
    rover.taught(7)

    def refused(_: Path) -> bool:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "exists", refused)
    assert rover.type("list")[2].endswith("journal.db may not be read: type this with sudo\n")
    monkeypatch.undo()
    monkeypatch.setattr("companion.storage.database.Path.is_file", refused)
    with pytest.raises(JournalError, match="check that the folder is writable"):
        Journal(rover.state)
