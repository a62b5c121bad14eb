"""A judged frame in 1,500 bytes: of the simulated field, of real trails, and of what compresses worst."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from anytraverse.assessment import Assessment
from anytraverse.frame import Frame, Image
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from companion.sim.field.render import PinholeCamera
from companion.sim.field.things import World
from companion.vision.pictures import LIMIT, thumbnail, unmarked

REGION = Box(1 / 3, 0.6, 2 / 3, 0.95)
REAL = Path(__file__).parents[3].parent / "shared" / "data" / "frames"


def judged(image: Image) -> Assessment:
    return Assessment(Frame(1, 0.0, image), Preferences(), (), 0.0)


def drawn(content: bytes) -> Image:
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return np.asarray(picture[..., ::-1], np.uint8)


@pytest.mark.slow
def test_frames_of_the_field_fit_a_radio_as_wide_as_can_be() -> None:
    world = World(1)
    camera = PinholeCamera(world)
    for metre in (5.0, 40.0, 90.0):
        image, _ = camera.render(world.trail.pose(metre), metre)
        content = thumbnail(judged(image), REGION)
        picture = drawn(content)
        assert len(content) <= LIMIT
        assert picture.shape[:2] in ((120, 160), (96, 128), (72, 96))
        small = cv2.resize(image, picture.shape[1::-1], interpolation=cv2.INTER_AREA)
        assert np.abs(small.astype(float) - picture).mean() < 20


@pytest.mark.slow
@pytest.mark.parametrize(("seen", "shown"), [((640, 480), (480, 360)), ((320, 240), (320, 240))])
def test_the_unmarked_picture_is_the_frame_and_no_wider(
    seen: tuple[int, int], shown: tuple[int, int]
) -> None:
    world = World(1)
    image, _ = PinholeCamera(world, *seen).render(world.trail.pose(5.0), 5.0)
    content = unmarked(np.asarray(image))
    picture = drawn(content)
    assert picture.shape[1::-1] == shown
    assert len(content) < 60_000
    expected = cv2.resize(image, shown, interpolation=cv2.INTER_AREA)
    assert np.abs(expected.astype(float) - picture).max(axis=(0, 1)).mean() < 80
    assert np.abs(expected.astype(float) - picture).mean() < 4


@pytest.mark.skipif(not REAL.is_dir(), reason="needs the frames beside the checkout: ../shared/data")
def test_real_frames_fit_a_radio() -> None:
    for path in sorted(REAL.glob("*.jpg")):
        image = cv2.imread(str(path), cv2.IMREAD_REDUCED_COLOR_2)
        assert image is not None
        assert len(thumbnail(judged(np.asarray(image[..., ::-1], np.uint8)), REGION)) <= LIMIT


def test_the_region_of_interest_is_white_where_it_is() -> None:
    picture = drawn(thumbnail(judged(np.full((240, 320, 3), 90, np.uint8)), REGION))
    height, width = picture.shape[:2]
    left, top = round(REGION.left * (width - 1)), round(REGION.top * (height - 1))
    assert picture[(top + height) // 2, left].min() > 180
    assert picture[top, width // 2].min() > 180
    assert abs(int(picture[height // 4, width // 2].mean()) - 90) < 10


def test_what_cannot_be_pressed_into_it_is_refused_not_sent_too_long() -> None:
    noise = np.random.default_rng(1).integers(0, 256, (480, 640, 3), np.uint8)
    assert len(thumbnail(judged(noise), REGION)) <= LIMIT
    with pytest.raises(ValueError, match="300 bytes"):
        thumbnail(judged(noise), REGION, limit=300)
