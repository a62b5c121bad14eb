"""Frames resized: the same bytes as Pillow's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from anytraverse.errors import PerceiverError
from anytraverse.frame import Image
from anytraverse.perception.resizing import Fit, Resizer


def noise(width: int, height: int) -> Image:
    """A picture in which every pixel is something else."""
    return np.random.default_rng(width * 5000 + height).integers(0, 256, (height, width, 3), dtype=np.uint8)


def resized(image: Image, fit: Fit) -> Image:
    return Resizer(fit)(image)


def by_pillow(image: Image, fit: Fit) -> Image:
    """As transformers does it: Pillow's resize, then the middle."""
    from PIL import Image as pillow  # noqa: N813 a module

    filters = {"bilinear": pillow.Resampling.BILINEAR, "bicubic": pillow.Resampling.BICUBIC}
    height, width = image.shape[:2]
    size = (fit.width, fit.height)
    if fit.crop:
        longer = int(fit.width * max(width, height) / min(width, height))
        size = (fit.width, longer) if width <= height else (longer, fit.height)
    picture = np.asarray(pillow.fromarray(image).resize(size, filters[fit.filter]))
    top, left = (picture.shape[0] - fit.height) // 2, (picture.shape[1] - fit.width) // 2
    return picture[top : top + fit.height, left : left + fit.width]


@pytest.mark.needs_export
@pytest.mark.parametrize("name", ["bilinear", "bicubic"])
@pytest.mark.parametrize(
    ("frame", "size"),
    [
        ((640, 480), (352, 352)),
        ((1280, 720), (352, 352)),
        ((301, 200), (352, 352)),
        ((97, 61), (33, 129)),
        ((352, 100), (352, 50)),
        ((64, 48), (64, 48)),
        ((1, 1), (7, 5)),
        ((500, 3), (1, 1)),
        ((1, 40), (16, 16)),
        ((640, 400), (2, 3)),
    ],
)
def test_a_stretched_frame_is_pillows_to_the_byte(
    frame: tuple[int, int], size: tuple[int, int], name: str
) -> None:
    fit = Fit(*size, name)
    ours = resized(noise(*frame), fit)
    assert ours.shape == (size[1], size[0], 3)
    assert ours.dtype == np.uint8
    np.testing.assert_array_equal(ours, by_pillow(noise(*frame), fit))


@pytest.mark.needs_export
@pytest.mark.parametrize("frame", [(640, 480), (480, 641), (1280, 720), (99, 77), (224, 224), (3, 1), (1, 1)])
@pytest.mark.parametrize("name", ["bilinear", "bicubic"])
def test_a_cropped_frame_is_clips_to_the_byte(frame: tuple[int, int], name: str) -> None:
    fit = Fit(64, 64, name, crop=True)
    np.testing.assert_array_equal(resized(noise(*frame), fit), by_pillow(noise(*frame), fit))


@pytest.mark.needs_export
@pytest.mark.parametrize("name", ["bilinear", "bicubic"])
@pytest.mark.parametrize(("width", "height"), [(31, 200), (150, 40), (20, 12)])
def test_pictures_of_extremes_do_not_overflow(width: int, height: int, name: str) -> None:
    stripes = np.zeros((90, 70, 3), dtype=np.uint8)
    stripes[::3], stripes[:, ::4] = 255, 255
    rows_first = by_pillow(by_pillow(stripes, Fit(width, 90, name)), Fit(width, height, name))
    np.testing.assert_array_equal(resized(stripes, Fit(width, height, name)), rows_first)


@pytest.mark.needs_export
def test_a_tall_frame_differs_from_pillows_by_roundings_alone() -> None:
    fit = Fit(120, 120, "bicubic")
    gaps = np.abs(resized(noise(200, 480), fit).astype(int) - by_pillow(noise(200, 480), fit))
    assert gaps.mean() < 0.5
    assert gaps.max() <= 6


def test_one_colour_stays_that_colour() -> None:
    image = np.full((50, 70, 3), (255, 0, 77), dtype=np.uint8)
    assert (resized(image, Fit(33, 120, "bicubic")) == image[0, 0]).all()


def test_clips_size_is_cut_off_not_rounded() -> None:
    assert Fit(224, 224, "bicubic", crop=True).window(640, 480) == (298, 224, 37, 0)
    assert Fit(224, 224, "bicubic", crop=True).window(720, 1280) == (224, 398, 0, 87)


@pytest.mark.parametrize("view", [np.s_[3:40, 5:77], np.s_[::2, ::3], np.s_[::-1, :, ::-1]])
def test_a_view_of_a_larger_picture_counts_as_what_it_shows(view: Any) -> None:
    shown = noise(120, 90)[view]
    fit = Fit(32, 24)
    np.testing.assert_array_equal(resized(shown, fit), resized(shown.copy(), fit))


def test_frames_of_another_size_may_come_at_any_time() -> None:
    resizer = Resizer(Fit(20, 30))
    for size in ((64, 48), (48, 64), (64, 48)):
        np.testing.assert_array_equal(resizer(noise(*size)), resized(noise(*size), Fit(20, 30)))


def test_the_frame_itself_is_left_as_it_is() -> None:
    image = noise(30, 20)
    image.flags.writeable = False
    before = image.copy()
    made = resized(image, Fit(30, 20))
    assert not np.shares_memory(made, image)
    np.testing.assert_array_equal(image, before)


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((0, 4, 3), np.uint8),
        np.zeros((4, 4), np.uint8),
        np.zeros((4, 4, 3)),
        np.zeros((4, 4, 4), np.uint8),
    ],
)
def test_what_is_no_rgb_picture_is_refused(image: NDArray[Any]) -> None:
    with pytest.raises(PerceiverError, match="RGB"):
        resized(image, Fit(8, 8))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"width": 0}, "width"),
        ({"height": 4097}, "height"),
        ({"width": 3.5}, "width"),
        ({"width": True}, "width"),
        ({"filter": "nearest"}, "bilinear or bicubic"),
        ({"width": 9, "crop": True}, "square"),
    ],
)
def test_a_size_or_filter_that_cannot_be_is_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(PerceiverError, match=said):
        Fit(**{"width": 8, "height": 8} | given)
