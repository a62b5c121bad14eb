"""Each degradation does what its name says, to a picture of any size, and always the same."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.evaluation.degrade import DEGRADATIONS, degraded, infrared, magenta
from anytraverse.evaluation.light import Light, coded, linear
from anytraverse.frame import Image

NAMES = sorted(DEGRADATIONS)
ROWS, COLUMNS = 120, 160
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def scene() -> Image:
    """White sky over grey ground with a checked pattern, a green meadow on the left."""
    rng = np.random.default_rng(7)
    picture = np.full((ROWS, COLUMNS, 3), 120, dtype=np.float64)
    checks = (np.add.outer(np.arange(ROWS) // 8, np.arange(COLUMNS) // 8) % 2) * 60.0 - 30.0
    picture += checks[..., None]
    picture[48:, :60] = (70, 110, 40)
    picture[:48] = (225, 230, 235)
    picture += rng.normal(0, 3, picture.shape)
    return np.clip(picture, 0, 255).astype(np.uint8)


def mean_colour(picture: Image, rows: slice = slice(None), columns: slice = slice(None)) -> Light:
    return np.asarray(linear(picture[rows, columns]).reshape(-1, 3).mean(axis=0), dtype=np.float32)


def luminance(picture: Image) -> float:
    return float(mean_colour(picture) @ LUMINANCE)


def contrast(picture: Image, rows: slice) -> float:
    return float(linear(picture)[rows, 70:].mean(axis=2).std())


def sharpness(picture: Image, axis: int | None = None) -> float:
    grey = linear(picture).mean(axis=2)
    return float(
        np.mean([np.abs(np.diff(grey, axis=one)).mean() for one in ((0, 1) if axis is None else (axis,))])
    )


@settings(max_examples=60, deadline=None)
@given(
    name=st.sampled_from(NAMES),
    size=st.tuples(st.integers(1, 70), st.integers(1, 90)),
    number=st.integers(0, 10**9),
    level=st.sampled_from([None, 0, 255]),
)
def test_a_picture_of_any_size_keeps_shape_and_type_and_is_always_degraded_in_the_same_way(
    name: str, size: tuple[int, int], number: int, level: int | None
) -> None:
    picture = np.random.default_rng(number).integers(0, 256, (*size, 3), dtype=np.uint8)
    if level is not None:
        picture[:] = level
    before = picture.copy()
    once, again = degraded(picture, name, number), degraded(picture, name, number)
    assert once.shape == picture.shape
    assert once.dtype == np.uint8
    assert np.array_equal(once, again)
    assert np.array_equal(picture, before)


@pytest.mark.parametrize("name", NAMES)
def test_each_degradation_changes_the_picture(name: str) -> None:
    picture = scene()
    assert np.abs(degraded(picture, name, 1).astype(int) - picture).mean() > 1


@pytest.mark.parametrize("name", ["white-balance", "dusk", "glare", "shadows", "rain", "motion-blur"])
def test_chance_is_drawn_by_the_number_of_the_frame(name: str) -> None:
    picture = scene()
    assert not np.array_equal(degraded(picture, name, 1), degraded(picture, name, 2))


@pytest.mark.parametrize("name", ["green", "magenta", "cold", "warm", "infrared", "fog", "defocus", "jpeg"])
def test_what_has_no_chance_is_the_same_for_all_frames(name: str) -> None:
    picture = scene()
    assert np.array_equal(degraded(picture, name, 1), degraded(picture, name, 2))


def test_linear_light_and_back_is_the_picture() -> None:
    picture = np.arange(256, dtype=np.uint8).repeat(3).reshape(16, 16, 3)
    assert np.array_equal(coded(linear(picture)), picture)


@pytest.mark.parametrize(
    ("name", "order"), [("green", (1, 0)), ("magenta", (0, 1)), ("cold", (2, 0)), ("warm", (0, 2))]
)
def test_a_cast_turns_grey_into_its_colour_and_keeps_its_luminance(name: str, order: tuple[int, int]) -> None:
    grey = np.full((8, 8, 3), 100, dtype=np.uint8)
    picture = degraded(grey, name, 1)
    colour = mean_colour(picture)
    assert colour[order[0]] > 2 * colour[order[1]]
    assert luminance(picture) == pytest.approx(luminance(grey), rel=0.03)


def test_a_cast_of_no_strength_is_none() -> None:
    picture = scene()
    assert np.array_equal(magenta(picture, 0.0), picture)
    assert np.array_equal(infrared(picture, 0.0), picture)


def test_infrared_shows_plants_brighter_and_more_purple_than_grey_ground_and_leaves_the_sky() -> None:
    picture = infrared(scene())
    plants, ground = (mean_colour(picture, slice(60, None), part) for part in (slice(0, 50), slice(70, None)))
    sky = mean_colour(picture, slice(0, 40))
    before = mean_colour(scene(), slice(60, None), slice(0, 50))
    assert before[1] > before[0] > before[2]
    assert plants[0] > plants[2] > plants[1]
    assert plants[1] / plants[0] < ground[1] / ground[0] < sky[1] / sky[0]
    assert (
        plants.mean() / ground.mean()
        > 2 * before.mean() / mean_colour(scene(), slice(60, None), slice(70, None)).mean()
    )


def test_a_wrong_white_balance_is_cold_or_warm() -> None:
    grey = np.full((8, 8, 3), 100, dtype=np.uint8)
    blues = [mean_colour(degraded(grey, "white-balance", number)) for number in range(40)]
    ratios = np.array([colour[2] / colour[0] for colour in blues])
    assert (ratios > 1.3).any()
    assert (ratios < 0.75).any()
    assert not ((ratios > 0.8) & (ratios < 1.25)).any()


def test_light_is_halved_and_multiplied_by_1_7() -> None:
    grey = np.full((8, 8, 3), 100, dtype=np.uint8)
    for name, factor in (("half-light", 0.5), ("bright", 1.7)):
        assert luminance(degraded(grey, name, 1)) == pytest.approx(factor * luminance(grey), rel=0.02)


def test_dusk_is_dark_bluish_and_noisy() -> None:
    grey = np.full((64, 64, 3), 150, dtype=np.uint8)
    picture = degraded(grey, "dusk", 1)
    assert luminance(picture) == pytest.approx(0.18 * luminance(grey), rel=0.1)
    assert mean_colour(picture)[2] > 1.3 * mean_colour(picture)[0]
    assert picture[..., 1].std() > 3


def test_glare_lies_over_the_suns_side_and_takes_contrast() -> None:
    grey = np.full((90, 160, 3), 60, dtype=np.uint8)
    sides = []
    for number in range(12):
        picture = degraded(grey, "glare", number)
        left, right = (luminance(picture[:40, part]) for part in (slice(0, 30), slice(-30, None)))
        sides.append(left > right)
        assert max(left, right) > 3 * min(left, right) > 3 * luminance(grey)
    assert set(sides) == {True, False}
    assert contrast(degraded(scene(), "glare", 1), slice(60, None)) < 0.8 * contrast(scene(), slice(60, None))


def test_shadows_lie_on_the_ground_and_have_a_fifth_of_the_light() -> None:
    grey = np.full((120, 160, 3), 150, dtype=np.uint8)
    for number in range(8):
        light = linear(degraded(grey, "shadows", number)) / linear(grey)
        assert light[:45].min() > 0.99
        below = light[60:, :, 1]
        assert below.min() == pytest.approx(0.22, abs=0.02)
        assert 0.03 < np.mean(below < 0.4) < 0.9


def test_fog_takes_contrast_towards_the_top() -> None:
    stripes = np.zeros((100, 100, 3), dtype=np.uint8)
    stripes[:, ::2] = 200
    picture = linear(degraded(stripes, "fog", 1))[..., 1]
    left = np.abs(picture[:, 0] - picture[:, 1]) / linear(stripes)[0, 0, 1]
    assert (np.diff(left) > -0.01).all()
    assert left[0] == pytest.approx(np.exp(-3 * 30 / 50), abs=0.02)
    assert left[-1] > 0.75


def test_rain_is_soft_and_has_streaks_from_above() -> None:
    grey = np.full((120, 160, 3), 90, dtype=np.uint8)
    picture = degraded(grey, "rain", 3)
    assert sharpness(picture, axis=1) > 1.5 * sharpness(picture, axis=0)
    assert sharpness(degraded(scene(), "rain", 3)[:, 70:]) < sharpness(scene()[:, 70:])


def test_blurs_soften_and_motion_blur_does_so_in_one_direction() -> None:
    noise = np.random.default_rng(1).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    assert sharpness(degraded(noise, "defocus", 1)) < 0.4 * sharpness(noise)
    ratios = []
    for number in range(10):
        picture = degraded(noise, "motion-blur", number)
        assert sharpness(picture) < 0.8 * sharpness(noise)
        ratios.append(sharpness(picture, axis=0) / sharpness(picture, axis=1))
    assert max(ratios) > 1.4
    assert min(ratios) < 1 / 1.4


def test_strong_jpeg_draws_blocks_of_eight() -> None:
    ramp = np.linspace(0, 255, 160).astype(np.uint8)
    picture = np.repeat(np.repeat(ramp[None, :, None], 120, axis=0), 3, axis=2)
    steps = np.abs(np.diff(degraded(picture, "jpeg", 1)[..., 1].astype(int), axis=1)).mean(axis=0)
    edges = steps[7::8].mean()
    assert edges > 2 * np.delete(steps, np.arange(7, len(steps), 8)).mean()
