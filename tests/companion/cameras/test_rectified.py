"""Rectified pictures: what the camera bends is straight, and where an exact pinhole shows it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anytraverse.frame import Intrinsics
from companion.cameras import BadFrame, CameraOptions, Capture, open_camera
from companion.cameras.calibration import LensCalibration, read_calibration
from companion.cameras.newest import CameraState, CameraThread, Patience
from companion.cameras.rectified import RectifiedCamera
from tests.companion.cameras.test_calibration import DISTORTION, MATRIX, written
from tests.waiting import wait_for

cv2 = pytest.importorskip("cv2")

PITCH = 0.1
"""Distance of two lines of the grid, at a distance of 1."""


class _OneCapture:
    """Delivers the same capture again and again."""

    def __init__(self, capture: Capture) -> None:
        self.capture, self.closed = capture, False

    def read(self, _: float) -> Capture:
        return self.capture._replace(captured_at=time.monotonic())

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def lens(tmp_path: Path) -> LensCalibration:
    return read_calibration(written(tmp_path / "lens.yml"))


def _rays(width: int, height: int) -> Any:
    """Where each pixel of the distorted camera looks, (height, width, 2), at a distance of 1."""
    scale = width / 640
    u, v = np.meshgrid((np.arange(width) + 0.5) / scale - 0.5, (np.arange(height) + 0.5) / scale - 0.5)
    wanted = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
    until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-4)
    if hasattr(cv2, "undistortPointsIter"):  # OpenCV 4
        rays = cv2.undistortPointsIter(wanted, MATRIX, DISTORTION, np.eye(3), np.eye(3), until)
    else:
        rays = cv2.undistortPoints(wanted, MATRIX, DISTORTION, criteria=until)
    points = cv2.convertPointsToHomogeneous(rays)
    again, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), MATRIX, DISTORTION)
    assert np.abs(again - wanted).max() < 1e-3
    return rays.reshape(height, width, 2)


def _grid(rays: Any, axis: int) -> Any:
    """The picture of thin white lines at multiples of `PITCH`, upright for axis 0."""
    off = (rays[..., axis] + PITCH / 2) % PITCH - PITCH / 2
    bright = 255.0 * np.exp(-((off / 0.006) ** 2))
    return np.repeat(np.rint(bright).astype(np.uint8)[..., None], 3, axis=2)


def _deviation(picture: Any, axis: int, intrinsics: Intrinsics) -> float:
    """The most pixels by which the lines of a grid are elsewhere than this lens shows them."""
    picture = (picture[..., 0] if axis == 0 else picture[..., 0].T).astype(float)
    focal, centre = intrinsics[axis], intrinsics[2 + axis]
    worst, lines = 0.0, 0
    half = round(0.3 * PITCH * focal)
    for number in range(-12, 13):
        at = focal * number * PITCH + centre
        first = round(at) - half
        if first < 0 or first + 2 * half >= picture.shape[1]:
            continue
        window = picture[:, first : first + 2 * half + 1]
        found = window @ np.arange(first, first + 2 * half + 1) / np.maximum(window.sum(axis=1), 1.0)
        worst, lines = max(worst, float(np.abs(found - at).max())), lines + 1
    assert lines > 6
    return worst


@pytest.mark.slow
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("size", [(640, 480), (320, 240), (1280, 960)])
def test_the_lines_of_a_grid_are_straight_and_where_a_pinhole_shows_them(
    lens: LensCalibration, size: tuple[int, int], axis: int
) -> None:
    bent = _grid(_rays(*size), axis)
    capture = RectifiedCamera(_OneCapture(Capture(1.0, bent, "sensor")), lens).read(1.0)
    assert capture.image.shape == bent.shape
    assert capture.intrinsics is not None
    assert _deviation(bent, axis, capture.intrinsics) > 5.0
    assert _deviation(capture.image, axis, capture.intrinsics) < 0.25


def test_the_intrinsics_are_those_that_the_calibration_tells_in_pixels(lens: LensCalibration) -> None:
    white = np.full((240, 320, 3), 255, np.uint8)
    capture = RectifiedCamera(_OneCapture(Capture(1.0, white)), lens).read(1.0)
    fx, fy, *_ = lens.rectified
    assert capture.intrinsics == (fx * 320, fy * 240, 159.5, 119.5)  # the middle, between two pixels


def test_no_border_enters_a_rectified_picture(lens: LensCalibration) -> None:
    white = np.full((480, 640, 3), 255, np.uint8)
    camera = RectifiedCamera(_OneCapture(Capture(1.0, white)), lens)
    assert camera.read(1.0).image.min() == 255
    far = np.full((480, 640), 9000, np.uint16)
    depth = RectifiedCamera(_OneCapture(Capture(1.0, white, depth=far)), lens).read(1.0).depth
    assert depth is not None
    assert depth.min() == 9000


def test_depth_stays_aligned_with_the_picture_and_no_depth_is_made_up(lens: LensCalibration) -> None:
    near = np.zeros((480, 640), np.uint16)
    image = np.zeros((480, 640, 3), np.uint8)
    chance = np.random.default_rng(0)
    for x, y in chance.integers((40, 40), (600, 440), (60, 2)):
        near[y - 6 : y + 7, x - 6 : x + 7], image[y - 6 : y + 7, x - 6 : x + 7] = 5000, 255
    capture = RectifiedCamera(_OneCapture(Capture(1.0, image, "sensor", near)), lens).read(1.0)
    assert capture.depth is not None
    assert capture.depth.dtype == np.uint16
    assert set(np.unique(capture.depth)) == {0, 5000}
    assert np.mean((capture.image[..., 0] > 127) != (capture.depth > 0)) < 2e-3


def test_each_depth_is_the_nearest_pixel_s(lens: LensCalibration) -> None:
    image = np.zeros((480, 640, 3), np.uint8)
    columns = np.tile(np.arange(640, dtype=np.uint16), (480, 1))
    capture = RectifiedCamera(_OneCapture(Capture(1.0, image, "sensor", columns)), lens).read(1.0)
    assert capture.depth is not None
    assert capture.intrinsics is not None
    fx, fy, cx, cy = capture.intrinsics
    new = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    exact, _ = cv2.initUndistortRectifyMap(MATRIX, DISTORTION, np.eye(3), new, (640, 480), cv2.CV_32FC1)
    assert np.abs(capture.depth - exact).max() <= 0.51


def test_time_and_what_it_is_from_stay(lens: LensCalibration) -> None:
    capture = Capture(1.0, np.zeros((480, 640, 3), np.uint8), "stream")
    before = time.monotonic()
    rectified = RectifiedCamera(_OneCapture(capture), lens).read(1.0)
    assert rectified.captured_at >= before
    assert rectified.timed_by == "stream"
    assert rectified.depth is None


def test_a_picture_of_another_shape_is_refused_and_said(lens: LensCalibration) -> None:
    wide = Capture(1.0, np.zeros((360, 640, 3), np.uint8))
    with pytest.raises(BadFrame) as caught:
        RectifiedCamera(_OneCapture(wide), lens).read(1.0)
    assert str(caught.value) == (
        "the pictures are 640 x 360, and the calibration is of 640 x 480: "
        "calibrate in the shape of the pictures, or make [camera] width and height so"
    )


def test_a_camera_that_changes_its_size_is_rectified_in_each(lens: LensCalibration) -> None:
    inner = _OneCapture(Capture(1.0, np.full((480, 640, 3), 255, np.uint8)))
    camera = RectifiedCamera(inner, lens)
    assert camera.read(1.0).image.shape == (480, 640, 3)
    inner.capture = Capture(1.0, np.full((240, 320, 3), 255, np.uint8))
    capture = camera.read(1.0)
    assert capture.image.shape == (240, 320, 3)
    assert capture.image.min() == 255


@pytest.mark.parametrize(
    ("image", "depth"),
    [
        (np.zeros((480, 640), np.uint8), None),
        (np.zeros((0, 640, 3), np.uint8), None),
        (np.zeros((480, 640, 3), np.float32), None),
        (np.zeros((480, 640, 3), np.uint8), np.zeros((48, 64), np.uint16)),
        (np.zeros((480, 640, 3), np.uint8), np.zeros((480, 640), np.float32)),
    ],
)
def test_a_picture_that_is_none_is_refused_as_ever(lens: LensCalibration, image: Any, depth: Any) -> None:
    def connect() -> RectifiedCamera:
        return RectifiedCamera(_OneCapture(Capture(1.0, image, "sensor", depth)), lens)

    thread = CameraThread(connect, patience=Patience(0.005, 5.0, 60.0, opening=0.05))
    try:
        wait_for(lambda: thread.state is CameraState.FAILED)
        assert "not an RGB picture" in thread.status.reason or "the depth map does" in thread.status.reason
    finally:
        thread.close()


def test_every_kind_of_camera_is_rectified_where_it_is_opened(lens: LensCalibration, tmp_path: Path) -> None:
    (tmp_path / "pictures").mkdir()
    bent = _grid(_rays(640, 480), 0)
    cv2.imwrite(str(tmp_path / "pictures/1.png"), bent)
    plain = open_camera(f"folder:{tmp_path}/pictures", CameraOptions(playback=100.0)).read(1.0)
    assert (plain.image == bent).all()
    assert plain.intrinsics is None
    options = CameraOptions(playback=100.0, calibration=lens)
    capture = open_camera(f"folder:{tmp_path}/pictures", options).read(1.0)
    assert capture.intrinsics is not None
    assert _deviation(capture.image, 0, capture.intrinsics) < 0.25


def test_closing_closes_the_camera(lens: LensCalibration) -> None:
    inner = _OneCapture(Capture(1.0, np.zeros((480, 640, 3), np.uint8)))
    RectifiedCamera(inner, lens).close()
    assert inner.closed
