"""What a perceiver saw of a frame is on disk, and comes back as it was."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anytraverse.perception import DefaultThresholds, Example, Prompt
from anytraverse.perception.stored import PerceptionStore, StoredPerceiver
from anytraverse.regions import Box

IMAGE = np.random.default_rng(1).integers(0, 256, (8, 10, 3), dtype=np.uint8)
OTHER = IMAGE.copy()
OTHER[0, 0, 0] ^= 1
WORDS = [Prompt("grass", drivable=True), Prompt("bush", drivable=False)]


class Counting:
    """Sees noise that depends on frame and words, and counts how often it is asked."""

    model_id = "counting-1"
    vocabulary = None
    defaults = DefaultThresholds(roi=0.3, scene=0.9)

    def __init__(self) -> None:
        self.encoded = 0

    def meaning(self, word: str) -> str:
        return word

    def encode(self, image: Any) -> int:
        self.encoded += 1
        return int(image.sum())

    def attend(self, features: int, prompts: Any) -> Any:
        seed = [features, *(ord(one.word[0]) + 1000 * bool(one.drivable) for one in prompts)]
        seed += [round(1000 * float(example.vector[0])) for one in prompts for example in one.examples]
        return np.random.default_rng(seed).random((len(prompts), 3, 4), dtype=np.float32)

    def embed(self, features: int) -> Any:
        return np.random.default_rng(features).random(5, dtype=np.float32)

    def example(self, features: int, box: Box) -> Example:
        return Example(self.model_id, np.array([box.left, features], np.float32))


def opened(folder: Path, most: int = 10**6, model: str = "a") -> StoredPerceiver:
    return StoredPerceiver(Counting(), PerceptionStore(folder, model, most))


def asked(perceiver: StoredPerceiver) -> int:
    own = perceiver.perceiver
    assert isinstance(own, Counting)
    return own.encoded


def seen(perceiver: StoredPerceiver, image: Any = IMAGE, prompts: Any = WORDS) -> tuple[Any, Any]:
    features = perceiver.encode(image)
    return perceiver.attend(features, prompts), perceiver.embed(features)


def test_a_frame_that_was_seen_before_is_not_perceived_again(tmp_path: Path) -> None:
    first, again = opened(tmp_path), opened(tmp_path)
    own = Counting()
    for found, expected in zip(seen(first), (own.attend(int(IMAGE.sum()), WORDS), None), strict=True):
        assert expected is None or np.array_equal(found, expected)
    for one, other in zip(seen(first), seen(again), strict=True):
        assert one.dtype == np.float32
        assert np.array_equal(one, other)
    assert (asked(first), asked(again)) == (1, 0)


@pytest.mark.parametrize(
    ("image", "prompts"),
    [
        (OTHER, WORDS),
        (IMAGE, WORDS[::-1]),
        (IMAGE, [Prompt("grass", drivable=False), WORDS[1]]),
        (IMAGE, [Prompt("grass", (Example("counting-1", np.ones(2, np.float32)),), drivable=True), WORDS[1]]),
    ],
)
def test_another_frame_word_sign_or_tap_is_perceived(tmp_path: Path, image: Any, prompts: Any) -> None:
    seen(opened(tmp_path))
    again = opened(tmp_path)
    attention, _ = seen(again, image, prompts)
    assert asked(again) == 1
    assert np.array_equal(attention, Counting().attend(int(image.sum()), prompts))


def test_maps_that_trials_share_cannot_be_changed(tmp_path: Path) -> None:
    for perceiver in (opened(tmp_path), opened(tmp_path)):
        attention, _ = seen(perceiver)
        with pytest.raises(ValueError, match="read-only"):
            attention[0] = 0.0


def test_another_model_has_maps_of_its_own(tmp_path: Path) -> None:
    seen(opened(tmp_path))
    other = opened(tmp_path, model="b")
    seen(other)
    assert asked(other) == 1


@pytest.mark.parametrize("place", [0, 30, 60, 100, 140, -1])
def test_a_byte_that_changed_on_the_disk_is_noticed(tmp_path: Path, place: int) -> None:
    seen(opened(tmp_path))
    for path in tmp_path.rglob("*.npy"):
        content = bytearray(path.read_bytes())
        content[place] ^= 0x28
        path.write_bytes(content)
    again = opened(tmp_path)
    attention, _ = seen(again)
    assert asked(again) == 1
    assert np.array_equal(attention, Counting().attend(int(IMAGE.sum()), WORDS))


def test_what_others_keep_in_the_folder_is_never_removed(tmp_path: Path) -> None:
    theirs = tmp_path / "labels" / "0001.npy"
    theirs.parent.mkdir()
    np.save(theirs, IMAGE)
    os.utime(theirs, (1000, 1000))
    seen(opened(tmp_path, most=400))
    assert theirs.exists()


def test_a_full_cache_is_not_counted_for_each_frame(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    counted = list[str]()
    glob = Path.glob

    def count(self: Path, name: str) -> Any:
        counted.append(name)
        return glob(self, name)

    monkeypatch.setattr(Path, "glob", count)
    small = opened(tmp_path, most=400)
    for value in range(30):
        seen(small, np.full((2, 2, 3), value, np.uint8))
    assert len(counted) < 10


def test_several_stores_hold_no_more_together_than_one_may(tmp_path: Path) -> None:
    stores = [PerceptionStore(tmp_path, "a", 100_000) for _ in range(4)]
    array = np.zeros(200, np.float32)
    for number in range(150):
        for one, store in enumerate(stores):
            store.put(f"{number:020x}{one:04x}", "scene", array)
    held = sum(path.stat().st_size for path in tmp_path.rglob("*.npy"))
    assert 80_000 < held < 110_000


def test_what_is_left_of_an_unfinished_file_goes_when_room_is_needed(tmp_path: Path) -> None:
    perceiver = opened(tmp_path, most=1000)
    (folder,) = tmp_path.iterdir()
    left = folder / f".{'0' * 24}-sceneabc.part"
    left.write_bytes(bytes(900))
    os.utime(left, (1000, 1000))
    seen(perceiver)
    assert not left.exists()


@pytest.mark.parametrize("left", [0, 20, 130])
def test_a_damaged_file_is_perceived_again(tmp_path: Path, left: int) -> None:
    seen(opened(tmp_path))
    for path in tmp_path.rglob("*.npy"):
        path.write_bytes(path.read_bytes()[:left])
    again = opened(tmp_path)
    attention, _ = seen(again)
    assert asked(again) == 1
    assert np.array_equal(attention, Counting().attend(int(IMAGE.sum()), WORDS))
    third = opened(tmp_path)
    seen(third)
    assert asked(third) == 0


def test_what_was_used_least_recently_goes_first_and_nothing_of_this_run(tmp_path: Path) -> None:
    images = [np.full((2, 2, 3), value, np.uint8) for value in range(8)]
    old = opened(tmp_path, most=4000)
    for image in images[:4]:
        seen(old, image)
    for number, path in enumerate(sorted(tmp_path.rglob("*.npy"), key=lambda one: one.stat().st_mtime_ns)):
        os.utime(path, (1000 + number, 1000 + number))
    new = opened(tmp_path, most=4 * 96 + 700)
    for image in images[4:]:
        seen(new, image)
    assert sum(path.stat().st_size for path in tmp_path.rglob("*.npy")) < 3000
    again = opened(tmp_path)
    seen(again, images[4])
    assert asked(again) == 0
    gone = opened(tmp_path)
    seen(gone, images[0])
    assert asked(gone) == 1


def test_a_full_cache_stores_nothing_and_sees_all_the_same(tmp_path: Path) -> None:
    small = opened(tmp_path, most=10)
    attention, _ = seen(small)
    assert np.array_equal(attention, Counting().attend(int(IMAGE.sum()), WORDS))
    assert not list(tmp_path.rglob("*.npy"))


def test_a_folder_that_cannot_be_written_is_no_error_while_it_works(tmp_path: Path) -> None:
    perceiver = opened(tmp_path)
    (folder,) = tmp_path.iterdir()
    folder.rmdir()
    folder.write_text("a file")
    attention, _ = seen(perceiver)
    assert np.array_equal(attention, Counting().attend(int(IMAGE.sum()), WORDS))


def test_a_box_is_one_example_however_often_it_is_tapped(tmp_path: Path) -> None:
    perceiver = opened(tmp_path)
    features = perceiver.encode(IMAGE)
    box = Box(0.1, 0.2, 0.3, 0.4)
    assert perceiver.example(features, box) is perceiver.example(features, box)
    assert perceiver.example(features, Box(0.2, 0.2, 0.3, 0.4)) is not perceiver.example(features, box)
