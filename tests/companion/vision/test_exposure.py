"""Black, under- and overexposed pictures: what is called so, when it counts, and what is never called so."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from anytraverse.frame import Image
from anytraverse.regions import Box
from companion.vision.exposure import ADVICE, BLACK, DARK, WHITE, ExposureDetector, exposure_name
from companion.vision.freeze_detector import luma

_ROI = Box(0.333, 0.6, 0.667, 0.95)
_DATA = Path(__file__).parents[4] / "shared" / "data"


def _scene(gain: float = 1.0, seed: int = 0) -> Image:
    """A textured ground of mean 110 under a bright sky."""
    ground = np.random.default_rng(seed).normal(110.0, 25.0, (120, 160, 1))
    scene = np.repeat(ground, 3, axis=2)
    scene[:50] = 230.0
    return np.asarray(np.clip(scene * gain, 0, 255), np.uint8)


@pytest.mark.parametrize(
    ("picture", "name"),
    [
        (_scene(), ""),
        (_scene(0.15), ""),
        (_scene(2.0), ""),
        (np.zeros((120, 160, 3), np.uint8), "picture black"),
        (_scene(0.01), "picture black"),
        (_scene(0.05), "picture underexposed"),
        (_scene(5.0), "picture overexposed"),
        (np.full((120, 160, 3), 255, np.uint8), "picture overexposed"),
        (np.full((120, 160, 3), 128, np.uint8), ""),
    ],
)
def test_a_picture_is_named_by_what_can_be_seen_of_the_ground(picture: Image, name: str) -> None:
    assert exposure_name(luma(picture), _ROI) == name
    assert name in ADVICE


@pytest.mark.parametrize(
    ("level", "name"),
    [
        (BLACK - 0.5, "picture black"),
        (BLACK, "picture underexposed"),
        (DARK - 0.5, "picture underexposed"),
        (DARK, ""),
        (WHITE - 0.5, ""),
        (WHITE, "picture overexposed"),
    ],
)
def test_a_picture_at_a_limit_is_no_longer_dark_and_already_overexposed(level: float, name: str) -> None:
    assert exposure_name(np.full((12, 16), level, np.float32), _ROI) == name


def test_a_bright_sky_does_not_hide_that_the_ground_is_dark() -> None:
    picture = _scene()
    picture[50:] //= 16
    assert exposure_name(luma(picture), _ROI) == "picture underexposed"


def test_a_blown_out_sky_alone_is_no_fault() -> None:
    picture = _scene()
    picture[:60] = 255
    assert exposure_name(luma(picture), _ROI) == ""


def test_a_region_without_a_cell_is_judged_by_the_whole_picture() -> None:
    tiny = Box(0.5, 0.5, 0.501, 0.501)
    assert exposure_name(luma(_scene()), tiny) == ""
    assert exposure_name(luma(np.full((120, 160, 3), 255, np.uint8)), tiny) == "picture overexposed"


def test_the_seconds_count_from_the_first_bad_picture_and_end_with_the_first_good_one() -> None:
    detector = ExposureDetector()
    well = luma(_scene())
    black, white = (luma(np.full((12, 16, 3), level, np.uint8)) for level in (0, 255))
    assert detector.check(well, _ROI, 1.0) == ("", 0.0)
    assert detector.check(black, _ROI, 2.0) == ("picture black", 0.0)
    assert detector.check(white, _ROI, 2.5) == ("picture overexposed", 0.5)
    assert detector.check(well, _ROI, 3.0) == ("", 0.0)
    assert detector.check(black, _ROI, 4.0) == ("picture black", 0.0)


@pytest.mark.slow
def test_real_daylight_is_hardly_ever_called_badly_exposed() -> None:
    paths = sorted((_DATA / "trail").glob("*0.jpg"))
    if not paths:
        pytest.skip("needs the real frames in ../shared/data")
    names = [
        exposure_name(luma(np.asarray(cv2.imread(str(path)), np.uint8)[..., ::-1]), _ROI) for path in paths
    ]
    assert sum(map(bool, names)) <= len(names) // 100
    dark = [np.asarray(cv2.imread(str(path)), np.uint8)[..., ::-1] // 40 for path in paths]
    assert all(exposure_name(luma(picture), _ROI) for picture in dark)
