"""Sources by name, and the kinds that play files."""

from __future__ import annotations

import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from companion.cameras import (
    BadFrame,
    Camera,
    CameraError,
    CameraOptions,
    EndOfFrames,
    NoFrameYet,
    SourceError,
    open_camera,
    split_source,
)
from companion.cameras.folder import pictures
from companion.cameras.video import PlaybackPace

_FAST = CameraOptions(playback=1000.0)


def _paint(path: Path, level: int, *, red: bool = False) -> None:
    picture = np.full((24, 32, 3), level, np.uint8)
    if red:
        picture[:] = (0, 0, 255)
    assert cv2.imwrite(str(path), picture)


def _film(path: Path, levels: list[int], rate: float = 25.0) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), rate, (64, 48))
    assert writer.isOpened()
    for level in levels:
        writer.write(np.full((48, 64, 3), level, np.uint8))
    writer.release()


def _levels(camera: Camera, count: int) -> list[int]:
    return [round(float(camera.read(1.0).image.mean())) for _ in range(count)]


@pytest.mark.parametrize("source", ["", "webcam:0", "drive.mp4", ":x", "VIDEO:x"])
def test_a_source_of_no_known_kind_is_refused_with_the_known_ones(source: str) -> None:
    with pytest.raises(SourceError, match=r"video:.*folder:.*field:"):
        split_source(source)


@pytest.mark.parametrize("source", ["video:rtsp://camera/1", "v4l2:http:/camera/1", "folder:a:b@camera"])
def test_an_address_is_no_file(source: str) -> None:
    with pytest.raises(SourceError, match="begin an address with rtsp:// or http://"):
        split_source(source)


def test_what_a_driver_raises_is_told_without_the_source(monkeypatch: pytest.MonkeyPatch) -> None:
    def driver(place: str, options: CameraOptions) -> Camera:
        raise RuntimeError(f"cannot open {place} with {options.latency}")

    monkeypatch.setitem(sys.modules, "companion.cameras.oak", SimpleNamespace(OakCamera=driver))
    with pytest.raises(CameraError) as refused:
        open_camera("oak:user:SECRET@camera")
    assert str(refused.value) == "oak:camera/... cannot be opened: cannot open ... with ..."
    assert refused.value.__suppress_context__


def test_a_source_without_a_place_is_refused() -> None:
    with pytest.raises(SourceError, match="write video:PLACE"):
        split_source("video:")


def test_a_place_may_hold_colons() -> None:
    assert split_source("field:127.0.0.1:5600") == ("field", "127.0.0.1:5600")


def test_the_cameras_face_brings_neither_opencv_nor_numpy() -> None:
    script = "import sys, companion.cameras; print({'cv2', 'numpy'} & set(sys.modules))"
    result = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    )
    assert result.stdout.strip() == "set()"


def test_a_kind_whose_software_is_missing_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    monkeypatch.delitem(sys.modules, "companion.cameras.video", raising=False)
    with pytest.raises(SourceError, match="pip install"):
        open_camera("video:drive.mp4")


def test_a_folder_is_played_in_name_order(tmp_path: Path) -> None:
    for name, level in [("b.png", 20), ("a.jpg", 10), ("c.bmp", 30)]:
        _paint(tmp_path / name, level)
    camera = open_camera(f"folder:{tmp_path}", _FAST)
    assert _levels(camera, 3) == [10, 20, 30]
    with pytest.raises(EndOfFrames):
        camera.read(1.0)


def test_labels_hidden_files_and_other_files_are_no_frames(tmp_path: Path) -> None:
    for name in ["0.jpg", "0.png", "1.JPEG", "1.PNG", "2.png", ".hidden.jpg"]:
        _paint(tmp_path / name.lower(), 5)
        (tmp_path / name.lower()).rename(tmp_path / name)
    (tmp_path / "notes.txt").write_text("x")
    assert [path.name for path in pictures(tmp_path)] == ["0.jpg", "1.JPEG", "2.png"]


def test_pictures_come_as_rgb(tmp_path: Path) -> None:
    _paint(tmp_path / "a.png", 0, red=True)
    image = open_camera(f"folder:{tmp_path}", _FAST).read(1.0).image
    assert image.dtype == np.uint8
    assert image.shape == (24, 32, 3)
    assert image[0, 0].tolist() == [255, 0, 0]


def test_a_looping_folder_starts_again_and_sees_new_pictures(tmp_path: Path) -> None:
    _paint(tmp_path / "a.png", 10)
    camera = open_camera(f"folder:{tmp_path}", CameraOptions(1000.0, loop=True))
    assert _levels(camera, 2) == [10, 10]
    _paint(tmp_path / "b.png", 20)
    assert _levels(camera, 3) == [10, 20, 10]


@pytest.mark.parametrize("content", [b"", b"not a picture", None])
def test_an_unreadable_picture_is_skipped(tmp_path: Path, content: bytes | None) -> None:
    _paint(tmp_path / "good.jpg", 40)
    torn = (tmp_path / "good.jpg").read_bytes()[:200] if content is None else content
    (tmp_path / "bad.jpg").write_bytes(torn)
    camera = open_camera(f"folder:{tmp_path}", _FAST)
    with pytest.raises(BadFrame, match=r"bad\.jpg"):
        camera.read(1.0)
    assert _levels(camera, 1) == [40]


def test_a_picture_that_vanished_is_skipped(tmp_path: Path) -> None:
    for name in "ab":
        _paint(tmp_path / f"{name}.png", 7)
    camera = open_camera(f"folder:{tmp_path}", _FAST)
    (tmp_path / "a.png").unlink()
    with pytest.raises(BadFrame, match=r"a\.png"):
        camera.read(1.0)
    assert _levels(camera, 1) == [7]


def test_a_folder_that_is_absent_or_empty_says_so(tmp_path: Path) -> None:
    with pytest.raises(CameraError, match="cannot be read"):
        open_camera(f"folder:{tmp_path / 'absent'}")
    with pytest.raises(CameraError, match="holds no picture"):
        open_camera(f"folder:{tmp_path}")


def test_a_video_is_played_to_its_end(tmp_path: Path) -> None:
    _film(tmp_path / "drive.avi", [40, 120, 200])
    camera = open_camera(f"video:{tmp_path / 'drive.avi'}", _FAST)
    assert _levels(camera, 3) == pytest.approx([40, 120, 200], abs=4)
    with pytest.raises(EndOfFrames, match="after 3 frames"):
        camera.read(1.0)
    camera.close()
    camera.close()


def test_a_looping_video_starts_again(tmp_path: Path) -> None:
    _film(tmp_path / "drive.avi", [40, 120])
    camera = open_camera(f"video:{tmp_path / 'drive.avi'}", CameraOptions(1000.0, loop=True))
    assert _levels(camera, 5) == pytest.approx([40, 120, 40, 120, 40], abs=4)


def test_a_video_keeps_its_own_rate_unless_told_otherwise(tmp_path: Path) -> None:
    _film(tmp_path / "drive.avi", [40] * 4, rate=20.0)
    camera = open_camera(f"video:{tmp_path / 'drive.avi'}")
    times = [camera.read(1.0).captured_at for _ in range(4)]
    assert times[3] - times[0] == pytest.approx(0.15, abs=0.05)
    fast = open_camera(f"video:{tmp_path / 'drive.avi'}", _FAST)
    times = [fast.read(1.0).captured_at for _ in range(4)]
    assert times[3] - times[0] < 0.1


def test_a_torn_video_ends_where_it_was_torn(tmp_path: Path) -> None:
    path = tmp_path / "drive.avi"
    _film(path, list(range(0, 200, 5)))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    camera = open_camera(f"video:{path}", _FAST)
    played = 0
    with suppress(EndOfFrames):
        while played < 40:
            with suppress(BadFrame):
                camera.read(1.0)
            played += 1
    assert 0 < played < 40


def test_what_is_no_video_says_so(tmp_path: Path) -> None:
    (tmp_path / "notes.mp4").write_text("not a video")
    with pytest.raises(CameraError, match="no video that can be decoded"):
        open_camera(f"video:{tmp_path / 'notes.mp4'}")
    with pytest.raises(CameraError, match="there is no video"):
        open_camera(f"video:{tmp_path / 'absent.mp4'}")


def test_the_pace_does_not_make_up_for_lost_time() -> None:
    pace = PlaybackPace(50.0)
    pace.wait(1.0)
    time.sleep(0.1)
    late, next_one = pace.wait(1.0), pace.wait(1.0)
    assert next_one - late >= 0.019


def test_a_pace_slower_than_the_patience_says_not_yet() -> None:
    pace = PlaybackPace(1.0)
    pace.wait(1.0)
    started = time.monotonic()
    with pytest.raises(NoFrameYet):
        pace.wait(0.01)
    assert time.monotonic() - started < 0.5
