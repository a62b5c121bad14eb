"""The algorithm's memory comes back from the journal as it was kept."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.adoption import adopted_memory
from anytraverse.history import Entry, History, Match, Place
from anytraverse.memory import Adoption, Memory, first_memory
from anytraverse.perception import Example
from anytraverse.preferences import Preferences, Setting
from companion.storage import Batch, Journal

_WORDS = st.sampled_from(["grass", "dry grass", "bush", "rock", "été", "water's edge", 'a "thing"'])
_WEIGHTS = st.floats(-1, 1)
_VECTORS = st.integers(0, 5).map(lambda seed: np.random.default_rng(seed).random(7).astype(np.float32))
_STAMPS = st.integers(0, 2**40)
_PREFERENCES = st.dictionaries(_WORDS, st.builds(Setting, _WEIGHTS, _STAMPS), max_size=5).map(Preferences)
_EXAMPLES = st.dictionaries(
    _WORDS,
    st.lists(st.builds(Example, st.sampled_from(["m1", "m2"]), _VECTORS), min_size=1, max_size=3).map(tuple),
    max_size=3,
)
_MAYBE = st.none() | st.floats(-180, 180)
_ENTRIES = st.lists(
    st.builds(
        Entry,
        embedding=_VECTORS,
        preferences=_PREFERENCES,
        order=st.integers(0, 9),
        matched=_STAMPS,
        call_id=st.integers(0, 99),
        examples=_EXAMPLES,
        place=st.builds(Place, _MAYBE, _MAYBE, _MAYBE, _MAYBE),
        refused=st.lists(_VECTORS, max_size=8).map(tuple),
        surroundings=st.none() | _VECTORS,
    ),
    max_size=6,
    unique_by=lambda entry: entry.order,
)
_ADOPTIONS = st.builds(
    Adoption,
    order=_STAMPS,
    call_id=st.integers(0, 99),
    similarity=st.floats(-1, 1),
    clock=_STAMPS,
    embedding=_VECTORS,
    preferences=_PREFERENCES,
    examples=_EXAMPLES,
    reference=st.none() | _VECTORS,
    time=_MAYBE,
)
_MEMORIES = st.builds(
    Memory,
    model_id=st.sampled_from(["m1", "m2"]),
    preferences=_PREFERENCES,
    configured=_PREFERENCES,
    examples=_EXAMPLES,
    settled=st.dictionaries(_WORDS, _STAMPS, max_size=3),
    reference=st.none() | _VECTORS,
    history=st.builds(History, _ENTRIES, st.integers(3, 9)),
    clock=_STAMPS,
    adoption=st.none() | _ADOPTIONS,
    given=st.dictionaries(_WORDS, _WEIGHTS, max_size=20),
)


def _plain(value: Any) -> Any:
    """A memory as values that compare."""
    match value:
        case Memory():
            parts = (value.model_id, value.clock, value.history.limit, dict(value.settled))
            words = [list(one.settings.items()) for one in (value.preferences, value.configured)]
            rest = (_plain(value.examples), _plain(value.reference), [_plain(one) for one in value.history])
            return (*parts, words, *rest, _plain(value.adoption), list(value.given.items()))
        case Adoption():
            stamps = (value.order, value.call_id, value.similarity, value.clock, value.time)
            vectors = (_plain(value.embedding), _plain(value.reference))
            return (*stamps, *vectors, list(value.preferences.settings.items()), _plain(value.examples))
        case Entry():
            figures = (value.order, value.matched, value.call_id, value.place)
            set_words = list(value.preferences.settings.items())
            refused = [_plain(one) for one in value.refused]
            return (*figures, set_words, _plain(value.embedding), _plain(value.examples), refused)
        case np.ndarray():
            return (str(value.dtype), value.tolist())
        case None:
            return None
    return {word: [(one.model_id, _plain(one.vector)) for one in kept] for word, kept in value.items()}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "journal"


@pytest.fixture
def journal(folder: Path) -> Iterator[Journal]:
    journal = Journal(folder)
    yield journal
    journal.close()


def _reopened(journal: Journal, folder: Path) -> Memory:
    journal.close()
    again = Journal(folder)
    memory = again.load_memory()
    again.close()
    assert memory is not None
    return memory


def _rich() -> Memory:
    memory = first_memory("m1", Preferences.of({"grass": 1.0, "bush": -1.0}), history_limit=4)
    example = Example("m1", np.arange(4, dtype=np.float32))
    memory = replace(memory, examples={"bush": (example, example)})
    for number in range(5):
        embedding = np.eye(8, dtype=np.float32)[number]
        memory = memory.remembering(embedding, number, Place(1.5, 2.5, None, 3.0), move=True)
    return memory


def test_a_new_journal_remembers_nothing(journal: Journal) -> None:
    assert journal.load_memory() is None
    assert journal.load_supervision() is None
    assert journal.load_frame(0) is None
    assert journal.calls() == []
    assert journal.recovered_from is None


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(st.lists(_MEMORIES, min_size=1, max_size=3))
def test_any_memory_over_any_other_comes_back_as_it_was(
    tmp_path_factory: pytest.TempPathFactory, memories: list[Memory]
) -> None:
    folder = tmp_path_factory.mktemp("journal")
    journal = Journal(folder)
    for memory in memories:
        journal.commit(Batch(memory=memory))
    assert _plain(_reopened(journal, folder)) == _plain(memories[-1])


def test_each_step_of_a_drive_comes_back(journal: Journal, folder: Path) -> None:
    memory = _rich()
    steps = [
        memory,
        replace(memory, history=memory.history.touched(memory.history[1], 99), clock=99),
        replace(memory, preferences=memory.preferences.without("bush"), settled={"bush": 100}),
        replace(memory, history=memory.history.without_call(3)),
        replace(memory, examples={}, reference=None),
        replace(memory, history=History(limit=4)),
    ]
    for step in steps:
        journal.commit(Batch(memory=step))
        assert _plain(_reopened(journal, folder)) == _plain(step)
        journal = Journal(folder)
    journal.close()


def test_a_remembered_scene_changes_the_same_words_after_a_restart(journal: Journal, folder: Path) -> None:
    memory = first_memory("m1", Preferences.of({"grass": 1.0, "bush": -1.0, "rock": -1.0, "mud": -1.0}))
    memory = memory.remembering(np.eye(2, dtype=np.float32)[0], 1, Place(), move=True)
    elsewhere = Preferences({"grass": Setting(-1, 2), "bush": Setting(0.2, 3), "rock": Setting(-0.5, 5)})
    memory = replace(memory.using(elsewhere, {}, {"bush": 3, "rock": 4, "mud": 4}), clock=5)
    journal.commit(Batch(memory=memory))
    found = _reopened(journal, folder)
    after, _ = adopted_memory(found, Match(found.history[0], 1.0), str, np.eye(2, dtype=np.float32)[0])
    assert after.preferences == Preferences.of({"grass": 1.0, "bush": 0.2, "rock": -0.5})


def test_the_order_of_words_is_kept(journal: Journal, folder: Path) -> None:
    memory = first_memory("m", Preferences.of({"z": 1, "a": -1, "m": 0.5}))
    journal.commit(Batch(memory=memory))
    journal.commit(Batch(memory=replace(memory, preferences=Preferences.of({"m": 0.5, "z": 1, "a": -1}))))
    assert list(_reopened(journal, folder).preferences) == ["m", "z", "a"]


def test_only_changed_rows_are_written(journal: Journal) -> None:
    memory = _rich()
    journal.commit(Batch(memory=memory))
    connection = journal._database._connection
    before = connection.total_changes
    journal.commit(
        Batch(memory=replace(memory, history=memory.history.touched(memory.history[0], 77), clock=77))
    )
    of_one_entry = 1 + 2 + 2  # itself, its words, its examples
    assert connection.total_changes - before <= 1 + 2 * of_one_entry


def test_an_example_that_many_scenes_share_is_kept_once(journal: Journal, folder: Path) -> None:
    journal.commit(Batch(memory=_rich()))
    journal.close()
    with sqlite3.connect(folder / "journal.db") as connection:
        assert connection.execute("SELECT count(*) FROM vectors").fetchone() == (1,)
    connection.close()


def test_examples_that_nothing_refers_to_are_dropped(journal: Journal, folder: Path) -> None:
    memory = _rich()
    journal.commit(Batch(memory=memory))
    journal.commit(Batch(memory=replace(memory, examples={}, history=History())))
    journal.close()
    with sqlite3.connect(folder / "journal.db") as connection:
        assert connection.execute("SELECT count(*) FROM vectors").fetchone() == (0,)
    connection.close()


@pytest.mark.parametrize(
    "change",
    [
        "UPDATE adoption SET similarity = 9e999",
        "UPDATE adoption SET similarity = 'near'",
        "UPDATE adoption SET clock = 'late'",
        "UPDATE adoption SET time = -9e999",
        "UPDATE adoption SET embedding = x''",
        "INSERT INTO refused SELECT 1, position + 8, embedding FROM refused",
    ],
)
def test_a_match_or_refused_frame_that_cannot_be_makes_a_damaged_journal(tmp_path: Path, change: str) -> None:
    vector = np.ones(4, np.float32)
    scene = Entry(vector, Preferences.parse("grass: 1"), 1, 1, refused=(vector,) * 8)
    memory = replace(first_memory("m", Preferences()), history=History([scene]), clock=2)
    memory, _ = adopted_memory(memory, Match(scene, 0.9), str, vector, 1_790_000_000.0)
    journal = Journal(tmp_path)
    journal.commit(Batch(memory=memory))
    journal.close()
    with sqlite3.connect(tmp_path / "journal.db") as connection:
        connection.execute(change)
    connection.close()
    journal = Journal(tmp_path)
    journal.close()
    assert journal.recovered_from is not None
