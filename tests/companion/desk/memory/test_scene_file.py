"""The file of `companion memory export`: what is written is read again, and nothing else is believed."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.history import Entry, Place, is_embedding
from anytraverse.perception import Example
from anytraverse.preferences import MAX_WORDS, Preferences
from companion.desk.memory import scene_file
from companion.desk.memory.scene_file import ExpectedModel, Scene, SceneFileError, read_scenes, write_scenes
from tests.anytraverse.conftest import Painted

cv2 = pytest.importorskip("cv2")

MODEL = Painted.model_id
EXPECTED = ExpectedModel(Painted(), embedding=2, example=1, surroundings=2)


def jpeg(width: int = 32, height: int = 24) -> bytes:
    done, content = cv2.imencode(".jpg", np.full((height, width, 3), 90, np.uint8))
    assert done
    return bytes(content.tobytes())


PICTURE = jpeg()
_VECTORS = st.integers(0, 359).map(
    lambda angle: np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))], np.float32)
)
_TAPS = st.lists(
    st.integers(0, 99).map(lambda code: Example(MODEL, np.array([code], np.float32))), min_size=1, max_size=3
).map(tuple)
_WEIGHTS = st.dictionaries(st.sampled_from(["grass", "drum", "rock", "été", 'a "thing"']), st.floats(-1, 1))
_PLACES = st.builds(
    Place,
    st.none() | st.floats(-90, 90),
    st.none() | st.floats(-180, 180),
    st.none() | st.floats(0, 360),
    st.none() | st.floats(0, 4e9),
    st.none() | st.tuples(*[st.floats(-180, 180)] * 3),
)


@st.composite
def _scenes(draw: st.DrawFn) -> Scene:
    words = Preferences.of(draw(_WEIGHTS))
    tapped = draw(st.sets(st.sampled_from(sorted(words)))) if words else set()
    entry = Entry(
        draw(_VECTORS),
        words,
        order=0,
        matched=0,
        call_id=draw(st.integers(0, 0xFFFF)),
        examples={word: draw(_TAPS) for word in sorted(tapped)},
        place=draw(_PLACES),
        refused=tuple(draw(st.lists(_VECTORS, max_size=8))),
        surroundings=draw(st.none() | _VECTORS),
    )
    return Scene(entry, draw(st.sampled_from([b"", PICTURE])))


def _plain(scene: Scene) -> Any:
    entry = scene.entry
    taps = {word: [tap.vector.tolist() for tap in kept] for word, kept in entry.examples.items()}
    words = list(entry.preferences.items())
    refused = [one.tolist() for one in entry.refused]
    return (
        entry.embedding.tolist(),
        words,
        taps,
        entry.place,
        entry.call_id,
        refused,
        None if entry.surroundings is None else entry.surroundings.tobytes(),
        scene.picture,
    )


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(st.lists(_scenes(), max_size=4))
def test_what_is_written_is_read_again(tmp_path_factory: pytest.TempPathFactory, scenes: list[Scene]) -> None:
    path = tmp_path_factory.mktemp("file") / "scenes"
    assert write_scenes(path, MODEL, scenes) == 0
    assert [_plain(scene) for scene in read_scenes(path, EXPECTED)] == [_plain(scene) for scene in scenes]


def sample(path: Path) -> list[bytes]:
    """Two scenes, one with a tap and a picture, and the lines of their file: header, vector, scenes."""
    tap = Example(MODEL, np.array([99], np.float32))
    east, north = np.array([1, 0], np.float32), np.array([0, 1], np.float32)
    place = Place(47.0, 8.0, 90.0, 1_790_000_000.0, (1.0, -2.0, 90.0))
    words = Preferences.parse("grass: 1; drum: -1")
    scenes = [
        Scene(Entry(east, words, 1, 1, 7, {"drum": (tap,)}, place), PICTURE),
        Scene(Entry(north, Preferences.parse("trail: 0.5"), 2, 2)),
    ]
    write_scenes(path, MODEL, scenes)
    return path.read_bytes().splitlines(keepends=True)


_JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**70), 2**70)
    | st.floats()
    | st.text(max_size=8)
    | st.just("AAAA" * 3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


def _replaced(value: Any, path: list[int], new: Any) -> Any:
    """`value` with one part of it replaced, which `path` chooses."""
    if not path or not isinstance(value, dict | list) or not value:
        return new
    keys = list(value) if isinstance(value, dict) else list(range(len(value)))
    key = keys[path[0] % len(keys)]
    copy = dict(value) if isinstance(value, dict) else list(value)
    copy[key] = _replaced(value[key], path[1:], new)
    return copy


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 3), st.lists(st.integers(0, 9), max_size=3), _JSON)
def test_a_file_in_which_anything_is_replaced_is_refused_or_holds_sound_scenes(
    tmp_path_factory: pytest.TempPathFactory, line: int, path: list[int], new: Any
) -> None:
    file = tmp_path_factory.mktemp("file") / "scenes"
    lines = sample(file)
    lines[line] = json.dumps(_replaced(json.loads(lines[line]), path, new)).encode() + b"\n"
    file.write_bytes(b"".join(lines))
    _refused_or_sound(file)


@settings(max_examples=80, deadline=None)
@given(st.data())
def test_a_file_with_any_other_bytes_is_refused_or_holds_sound_scenes(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    file = tmp_path_factory.mktemp("file") / "scenes"
    whole = b"".join(sample(file))
    begin = data.draw(st.integers(0, len(whole)))
    end = data.draw(st.integers(begin, min(len(whole), begin + 9)))
    file.write_bytes(whole[:begin] + data.draw(st.binary(max_size=9)) + whole[end:])
    _refused_or_sound(file)


def _refused_or_sound(file: Path) -> None:
    scenes = list[Scene]()
    with suppress(SceneFileError):
        scenes = read_scenes(file, EXPECTED)
    for scene in scenes:
        entry = scene.entry
        assert entry.embedding.shape == (2,)
        assert is_embedding(entry.embedding)
        assert len(entry.preferences) <= MAX_WORDS
        assert all(-1 <= weight <= 1 for weight in entry.preferences.values())
        assert set(entry.examples) <= set(entry.preferences)
        assert all(tap.vector_for(MODEL, 1).size for kept in entry.examples.values() for tap in kept)
        assert scene.picture in (b"", PICTURE) or scene.picture[:3] == PICTURE[:3]


Change = Callable[[list[dict[str, Any]]], None]


def _set(line: int, **values: Any) -> Change:
    return lambda rows: rows[line].update(values)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (_set(0, format="zip"), "no file of `companion memory export`"),
        (_set(0, version=2), "install a companion that is as new"),
        (_set(0, model="clipseg-1"), "scenes of two models cannot be compared"),
        (_set(0, scenes=3), "line 5 is cut off"),
        (_set(0, scenes=1), "goes on after the 1 scenes"),
        (_set(0, scenes=10**9), "is not 0 to 10000"),
        (_set(0, scenes=True), "True is not 0 to"),
        (_set(0, vectors=10**9), "is not 0 to 100000"),
        (_set(2, embedding="AAAA"), "line 3: a vector has 3 bytes, and this model's have 8"),
        (_set(2, embedding="AAAAAAAAAAA="), "an embedding is zero"),
        (_set(2, embedding="AADAfwAAgD8="), "not finite"),
        (_set(2, embedding="A" * 999), "at most 8 bytes"),
        (_set(2, embedding="????"), "not base64"),
        (_set(2, words={"grass": 2}), "2 is not -1 to 1"),
        (_set(2, words={"grass": True}), "True is no number"),
        (_set(2, words={"x" * 99: 1}), "99 characters"),
        (_set(2, words={"grass": 1, "lawn": -1}), "contradicts"),
        (_set(2, words={f"kind {n}": 1 for n in range(17)}), "at most 16"),
        (_set(2, examples={"rock": [0]}), "a word that the scene does not have"),
        (_set(2, examples={"drum": [1]}), "1 is not 0 to 0"),
        (_set(2, examples={"drum": [0] * 17}), "1 to 16 examples"),
        (_set(2, place={"latitude": 91}), "91 is not -90 to 90"),
        (_set(2, place={"latitude": 10**400}), "is not -90 to 90"),
        (_set(2, attitude=[1, 2]), "roll, pitch and yaw"),
        (_set(2, call=-1), "-1 is not 0 to 65535"),
        (_set(2, picture="AAAA"), "no JPEG"),
        (_set(2, refused=["AAAA"]), "a vector has 3 bytes"),
        (_set(2, refused=["AADAfwAAgD8="]), "not finite"),
        (_set(2, refused=["AACAPwAAgD8="] * 9), "at most 8 refused frames"),
        (_set(2, refused=None), "at most 8 refused frames"),
        (_set(2, surroundings=1.5), "base64"),
        (_set(2, surroundings="AAAA"), "bytes"),
    ],
)
def test_what_is_wrong_is_told_and_nothing_is_imported(tmp_path: Path, change: Change, told: str) -> None:
    path = tmp_path / "scenes"
    rows = [json.loads(line) for line in sample(path)]
    change(rows)
    path.write_text("".join(f"{json.dumps(row)}\n" for row in rows))
    with pytest.raises(SceneFileError) as refused:
        read_scenes(path, EXPECTED)
    assert told in str(refused.value)
    assert str(refused.value).endswith("nothing is imported")


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "line 1 is cut off"),
        (b"[" * 100_000 + b"\n", "nothing is imported"),
        (b"1" * 5000 + b"\n", "line 1 is no JSON"),
        (b'{"format": NaN}\n', "NaN is no number"),
        (b" " * (scene_file.MAX_LINE + 9) + b"\n", "longer than"),
        (b"\xff\xfe\n", "line 1 is no JSON"),
    ],
)
def test_what_is_no_such_file_is_refused(tmp_path: Path, content: bytes, told: str) -> None:
    path = tmp_path / "scenes"
    path.write_bytes(content)
    with pytest.raises(SceneFileError, match="nothing is imported") as refused:
        read_scenes(path, EXPECTED)
    assert told in str(refused.value)


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="no regular file"):
        read_scenes(tmp_path / "pipe", EXPECTED)


def test_a_file_larger_than_the_bound_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "huge").open("wb") as file:
        file.truncate(scene_file.MAX_FILE + 1)
    with pytest.raises(SceneFileError, match="larger than 128 MiB"):
        read_scenes(tmp_path / "huge", EXPECTED)


def test_a_picture_that_claims_to_be_huge_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scenes"
    lines = sample(path)
    at = PICTURE.index(b"\xff\xc0") + 5
    bomb = PICTURE[:at] + b"\xff\xff\xff\xff" + PICTURE[at + 4 :]
    row = json.loads(lines[2]) | {"picture": scene_file._encoded(bomb)}
    path.write_bytes(b"".join((*lines[:2], scene_file._line(row), *lines[3:])))
    with pytest.raises(SceneFileError, match="4096 x 4096"):
        read_scenes(path, EXPECTED)


def test_pictures_of_the_newest_scenes_are_written_until_there_is_no_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scene_file, "MAX_PICTURES", 2 * len(PICTURE))
    entry = Entry(np.array([1, 0], np.float32), Preferences(), 1, 1)
    scenes = [Scene(replace(entry, call_id=number), PICTURE) for number in range(3)]
    assert write_scenes(tmp_path / "scenes", MODEL, scenes) == 1
    found = read_scenes(tmp_path / "scenes", EXPECTED)
    assert [(one.entry.call_id, bool(one.picture)) for one in found] == [(0, False), (1, True), (2, True)]


def test_a_file_that_is_there_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "scenes").write_text("mine")
    with pytest.raises(SceneFileError, match="name another file"):
        write_scenes(tmp_path / "scenes", MODEL, [])
    assert (tmp_path / "scenes").read_text() == "mine"


def test_an_example_that_many_scenes_share_is_written_once(tmp_path: Path) -> None:
    tap = Example(MODEL, np.array([99], np.float32))
    entry = Entry(np.array([1, 0], np.float32), Preferences.parse("drum: -1"), 1, 1, 0, {"drum": (tap, tap)})
    write_scenes(tmp_path / "scenes", MODEL, [Scene(entry)] * 5)
    assert len((tmp_path / "scenes").read_bytes().splitlines()) == 1 + 1 + 5
