"""Labelled folders: what their labels mean, how they are split, what is refused."""

from __future__ import annotations

import json
import shutil
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.errors import TrainingError
from anytraverse.evaluation.labels import DatasetError
from anytraverse.training.classes import CLASSES, UNKNOWN, UNLABELLED, class_of, translation
from anytraverse.training.folders import BLOCK, GAP, Folder, Labelled, Split, read_folder, suggested


def made_up(numbers: list[int]) -> Folder:
    nothing = np.zeros((2, 2), np.uint8)
    return Folder(tuple(Labelled(n, np.zeros((2, 2, 3), np.uint8), nothing) for n in sorted(numbers)))


def test_labels_become_classes_and_noise_teaches_nothing(tiny_folder: Path) -> None:
    frame = read_folder(tiny_folder).frames[0]
    assert frame.image.shape == (64, 96, 3)
    assert set(np.unique(frame.labels)) == {CLASSES.index("sky"), CLASSES.index("grass"), 0}
    assert class_of("obstacle") is None
    assert class_of("High_Vegetation") == CLASSES.index("high vegetation")
    assert class_of("barrel") == UNKNOWN
    assert translation(["grass", "nonsense"]).tolist()[:3] == [2, UNLABELLED, UNLABELLED]


@given(st.sets(st.integers(0, 1500), min_size=1), st.sets(st.integers(0, 15), max_size=4), st.data())
def test_splits_share_no_block_and_leave_gaps(
    numbers: set[int], blocks: set[int], data: st.DataObject
) -> None:
    validation = data.draw(st.sets(st.sampled_from(sorted(blocks)))) if blocks else set()
    folder = made_up(sorted(numbers))
    try:
        parts = Split(tuple(validation), tuple(blocks - validation)).parts(folder)
    except TrainingError as refused:
        assert "no frames are left" in str(refused)  # noqa: PT017
        return
    seen = [{frame.number // BLOCK for frame in part.frames} for part in parts]
    assert sum(map(len, seen)) == len(set().union(*seen))
    assert all(frame.number % BLOCK < BLOCK - GAP for part in parts for frame in part.frames)
    together = sorted(frame.number for part in parts for frame in part.frames)
    assert all(b - a > GAP for a, b in pairwise(together) if a // BLOCK != b // BLOCK)


def test_a_block_cannot_be_for_validation_and_for_the_test() -> None:
    with pytest.raises(TrainingError, match="block 3"):
        Split((2, 3), (3,))


def test_a_split_is_suggested_only_where_a_drive_can_be_kept() -> None:
    assert suggested(made_up([1, 101, 201, 301])).validation == (2,)
    assert suggested(made_up([1, 101])).validation == (0,)
    assert suggested(made_up([1, 101, 201]), test=(2,)) == Split((0,), (2,))
    with pytest.raises(TrainingError, match="a hundred of its own"):
        suggested(made_up([1, 2, 3]))
    with pytest.raises(TrainingError, match="a hundred of its own"):
        suggested(made_up([1, 101]), test=(1,))


def test_what_the_folder_leaves_unlabelled_teaches_nothing(tmp_path: Path, tiny_folder: Path) -> None:
    shutil.copytree(tiny_folder, tmp_path, dirs_exist_ok=True)
    (tmp_path / "classes.json").write_text(
        json.dumps({"classes": ["sky", "grass", "smooth_trail"], "ignore": 1})
    )
    labels = read_folder(tmp_path).frames[0].labels
    assert set(np.unique(labels)) == {CLASSES.index("sky"), CLASSES.index("smooth trail"), UNLABELLED}


def test_a_torn_frame_is_told_and_left_out(tmp_path: Path, tiny_folder: Path) -> None:
    shutil.copytree(tiny_folder, tmp_path, dirs_exist_ok=True)
    (tmp_path / "0003.jpg").write_bytes((tmp_path / "0003.jpg").read_bytes()[:-200])
    told: list[str] = []
    assert len(read_folder(tmp_path, torn=told.append)) == 24
    assert len(told) == 1
    assert "0003.jpg" in told[0]


def test_a_folder_without_names_or_frames_is_refused(tmp_path: Path, tiny_folder: Path) -> None:
    with pytest.raises(DatasetError, match=r"classes\.json"):
        read_folder(tmp_path)
    (tmp_path / "classes.json").write_text(json.dumps({"classes": ["grass"]}))
    with pytest.raises(DatasetError, match=r"no picture NNNN\.jpg"):
        read_folder(tmp_path)
    shutil.copytree(tiny_folder, tmp_path, dirs_exist_ok=True)
    (tmp_path / "classes.json").write_text(json.dumps({"classes": ["gnome", "elf", "troll"]}))
    with pytest.raises(TrainingError, match=r"no label of .* is known"):
        read_folder(tmp_path)


def test_a_label_image_of_another_size_is_refused(tmp_path: Path, tiny_folder: Path) -> None:
    import cv2

    folder = Path(shutil.copytree(tiny_folder, tmp_path / "copy"))
    cv2.imwrite(str(folder / "0003.png"), np.zeros((10, 10), np.uint8))
    with pytest.raises(DatasetError, match="0003"):
        read_folder(folder)
