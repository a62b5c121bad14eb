"""The frames that a check is given."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.bundle.pictures import MOST_FRAMES, frames_of, spread
from anytraverse.look import PictureError


def silent(_: str) -> None:
    """Nothing to be told."""


def write(path: Path, value: int) -> None:
    """A red picture."""
    cv2.imwrite(str(path), np.full((8, 8, 3), (0, 0, value), dtype=np.uint8))


@given(st.integers(0, 3000), st.integers(2, 300))
def test_what_is_spread_is_even_rising_and_at_most_what_is_asked(count: int, most: int) -> None:
    indices = spread(count, most)
    assert len(indices) == min(count, most)
    steps = np.diff(indices)
    assert (steps > 0).all()
    if indices:
        assert (indices[0], indices[-1]) == (0, count - 1)
    if len(steps):
        assert steps.max() - steps.min() <= 1


def test_pictures_come_in_the_order_of_their_names_as_rgb(tmp_path: Path) -> None:
    for name, value in (("b.png", 20), ("a.PNG", 10), ("c.png", 30)):
        write(tmp_path / name, value)
    (tmp_path / "notes.txt").write_text("no picture")
    reds = [int(image[0, 0, 0]) for image in frames_of(tmp_path, silent)]
    assert reds == [10, 20, 30]


def test_pictures_that_cannot_be_read_are_named_and_skipped(tmp_path: Path) -> None:
    write(tmp_path / "good.png", 10)
    (tmp_path / "empty.jpg").touch()
    (tmp_path / "torn.png").write_bytes(b"\x89PNG")
    said: list[str] = []
    assert len(list(frames_of(tmp_path, said.append))) == 1
    assert [line.split(":")[0] for line in said] == ["empty.jpg", "torn.png"]


def test_a_place_without_pictures_is_refused(tmp_path: Path) -> None:
    (tmp_path / "film.mp4").write_bytes(b"no video")
    (tmp_path / "none").mkdir()
    for name, told in (("none", "no picture"), ("film.mp4", "no picture"), ("absent", "does not exist")):
        with pytest.raises(PictureError, match=told):
            next(frames_of(tmp_path / name, silent))


def test_a_long_video_is_spread_over(tmp_path: Path) -> None:
    path = tmp_path / "drive.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30, (16, 16))
    for number in range(250):
        writer.write(np.full((16, 16, 3), number, dtype=np.uint8))
    writer.release()
    greys = [float(image.mean()) for image in frames_of(path, silent)]
    assert len(greys) == MOST_FRAMES
    assert greys[0] < 5
    assert greys[-1] > 240
    assert np.diff(greys).min() > -1
