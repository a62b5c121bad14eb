"""Labelled folders: whole, chosen from, torn, and wrong."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from anytraverse.evaluation.datasets import Selection, TornPictureError, dataset, open_folder
from anytraverse.evaluation.labels import DatasetError

MakeDrive = Callable[..., Path]
FRAME = ([[40, 90]], [[0, 1]])


def none_torn(what: str) -> None:
    raise AssertionError(what)


@pytest.fixture
def drive(make_drive: MakeDrive) -> Path:
    """Frames 2, 3, 10, 11 and 12."""
    return make_drive(dict.fromkeys((10, 2, 12, 3, 11), FRAME))


def test_frames_come_in_the_order_of_their_numbers(drive: Path) -> None:
    (drive / "2.txt").write_text("left alone")
    (drive / "overview.jpg").write_text("left alone")
    folder = open_folder(drive)
    assert [frame.number for frame in folder.frames(none_torn)] == [2, 3, 10, 11, 12]
    assert len(folder) == 5


def test_a_frame_is_a_picture_in_rgb_and_its_class_ids(make_drive: MakeDrive) -> None:
    folder = make_drive({5: FRAME})
    red = np.zeros((32, 64, 3), dtype=np.uint8)
    red[..., 2] = 255
    cv2.imwrite(str(folder / "0005.jpg"), red)
    frame = open_folder(folder).read(5)
    assert frame.name == "0005.jpg"
    assert (frame.image[..., 0] > 240).all()
    assert (frame.image[..., 1:] < 15).all()
    assert frame.labels.tolist() == [[0] * 32 + [1] * 32] * 32


@pytest.mark.parametrize(
    ("selection", "numbers"),
    [
        (Selection(first=3), (3, 10, 11, 12)),
        (Selection(last=10), (2, 3, 10)),
        (Selection(first=3, last=11), (3, 10, 11)),
        (Selection(every=2), (2, 10, 12)),
        (Selection(first=3, every=3), (3, 12)),
        (Selection(first=-5, last=2), (2,)),
    ],
)
def test_drives_can_be_chosen_by_their_numbers(
    drive: Path, selection: Selection, numbers: tuple[int, ...]
) -> None:
    assert open_folder(drive, selection=selection).numbers == numbers


def test_a_last_number_of_0_is_one(make_drive: MakeDrive) -> None:
    assert open_folder(make_drive({0: FRAME, 1: FRAME}), selection=Selection(last=0)).numbers == (0,)


@pytest.mark.parametrize(("first", "last", "every"), [(5, 4, 1), (None, None, 0), (None, None, -2)])
def test_a_selection_that_chooses_nothing_is_refused(first: int | None, last: int | None, every: int) -> None:
    with pytest.raises(DatasetError, match="give"):
        Selection(first, last, every)


def test_a_range_without_frames_names_those_there_are(drive: Path) -> None:
    with pytest.raises(DatasetError, match="its numbers go from 2 to 12"):
        open_folder(drive, selection=Selection(first=4, last=9))


def test_a_folder_that_is_none_or_empty_is_refused(make_drive: MakeDrive, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="is not a folder"):
        open_folder(tmp_path / "absent")
    with pytest.raises(DatasetError, match="holds no picture"):
        open_folder(make_drive({}))


@pytest.mark.parametrize(
    ("suffix", "why"), [("png", "has no label image 0010.png"), ("jpg", "has no picture")]
)
def test_a_frame_without_its_half_is_refused_before_any_work(drive: Path, suffix: str, why: str) -> None:
    (drive / f"0010.{suffix}").unlink()
    with pytest.raises(DatasetError, match=f"{why}.*add it, or leave the frame out"):
        open_folder(drive)
    assert open_folder(drive, selection=Selection(first=11)).numbers == (11, 12)


def test_two_pictures_of_one_number_are_refused(drive: Path) -> None:
    (drive / "10.jpg").write_bytes((drive / "0010.jpg").read_bytes())
    with pytest.raises(DatasetError, match="same number"):
        open_folder(drive)


@pytest.mark.parametrize(
    ("labels", "why"),
    [
        (
            np.zeros((32, 65), dtype=np.uint8),
            r"0002.png is 65x32 and 0002.jpg is 64x32: save label images in",
        ),
        (np.zeros((32, 64, 3), dtype=np.uint8), "not one channel of 8 bits"),
        (np.zeros((32, 64), dtype=np.uint16), "not one channel of 8 bits"),
        (np.full((32, 64), 4, dtype=np.uint8), "holds the id 4, which classes.json does not name: add it"),
    ],
)
def test_labels_that_do_not_fit_are_refused_with_the_remedy(drive: Path, labels: object, why: str) -> None:
    cv2.imwrite(str(drive / "0002.png"), np.asarray(labels))
    with pytest.raises(DatasetError, match=why) as refused:
        next(open_folder(drive).frames(none_torn))
    assert not isinstance(refused.value, TornPictureError)


@pytest.mark.parametrize("suffix", ["jpg", "png"])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.99])
def test_a_torn_file_is_named_and_the_others_count(drive: Path, suffix: str, share: float) -> None:
    file = drive / f"0003.{suffix}"
    data = file.read_bytes()
    file.write_bytes(data[: int(len(data) * share)])
    told: list[str] = []
    assert [frame.number for frame in open_folder(drive).frames(told.append)] == [2, 10, 11, 12]
    assert told == [f"0003.{suffix}: torn, or not a picture"]


def test_a_folder_of_which_all_is_torn_is_refused(drive: Path) -> None:
    for file in drive.glob("*.jpg"):
        file.write_text("a tale of a picture")
    told: list[str] = []
    with pytest.raises(DatasetError, match="no frame that can be read"):
        list(open_folder(drive).frames(told.append))
    assert len(told) == 5


def test_folders_and_files_have_a_bound(drive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dataset, "_MOST_BYTES", 100)
    with pytest.raises(DatasetError, match="make the picture smaller"):
        open_folder(drive).read(2)
    monkeypatch.setattr(dataset, "MOST_FRAMES", 4)
    with pytest.raises(DatasetError, match="more than 4 frames: split it"):
        open_folder(drive)
