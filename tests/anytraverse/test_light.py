"""The light of a picture: what is named dark or veiled, and that every assessment tells it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.evaluation.degrade import degraded
from anytraverse.light import Light, light_name, measure_light
from tests.anytraverse.conftest import Rover

FRAMES = Path(__file__).parents[3] / "shared" / "data" / "trail"


@pytest.mark.parametrize(
    ("mean", "darkest", "name"),
    [(110, 30, ""), (59.9, 5, "dark"), (60, 5, ""), (170, 101, "low sun or haze"), (170, 100, "")],
)
def test_unusual_light_has_a_name(mean: float, darkest: float, name: str) -> None:
    assert light_name(Light(mean, darkest)) == name


def test_without_a_measurement_there_is_no_name() -> None:
    assert light_name(None) == ""


@given(level=st.integers(0, 255), height=st.integers(1, 40), width=st.integers(1, 40))
def test_a_plain_picture_of_any_size_has_its_own_level(level: int, height: int, width: int) -> None:
    found = measure_light(np.full((height, width, 3), level, np.uint8))
    assert (found.mean, found.darkest) == pytest.approx((level, level), abs=0.01)


def test_an_assessment_tells_the_light_of_its_picture(rover: Rover) -> None:
    seen = rover.see(0)
    assert seen.light == measure_light(seen.frame.image)


@pytest.mark.skipif(not FRAMES.is_dir(), reason="needs the frames beside the checkout: ../shared/data")
def test_frames_by_day_have_no_name_and_dusk_and_a_low_sun_have() -> None:
    names: dict[str, list[str]] = {"as filmed": [], "dusk": [], "glare": []}
    for number, path in enumerate(sorted(FRAMES.glob("02*.jpg"))[::6]):
        picture = cv2.imread(str(path))
        assert picture is not None
        image = np.ascontiguousarray(picture[..., ::-1], dtype=np.uint8)
        names["as filmed"].append(light_name(measure_light(image)))
        for light in ("dusk", "glare"):
            names[light].append(light_name(measure_light(degraded(image, light, number))))
    assert set(names["as filmed"]) == {""}
    assert set(names["dusk"]) == {"dark"}
    assert set(names["glare"]) == {"low sun or haze"}
