"""What a tapped box teaches the built-in perceiver, on drawn pictures."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from anytraverse.errors import ExampleError
from anytraverse.frame import Image
from anytraverse.perception import Prompt
from anytraverse.perception.builtin.lexicon import Lexicon
from anytraverse.regions import Box

COLOURS = {"orange": (222, 118, 28), "blue": (36, 78, 168), "red": (176, 44, 36), "pale": (168, 182, 204)}
FAR = Box(0.46, 0.52, 0.54, 0.68)
NEAR = Box(0.4, 0.5, 0.62, 0.9)


def picture(colour: tuple[int, int, int], where: Box, *, light: float = 1.0, seed: int = 0) -> Image:
    """A thing, shaded from left to right, on a dirt path through grass under a blue sky."""
    rng = np.random.default_rng(seed)
    canvas = np.empty((240, 320, 3))
    canvas[:90] = (150, 185, 235)
    mottle = 1 + 0.13 * rng.standard_normal((150, 320, 1))
    canvas[90:] = np.asarray((84, 116, 48)) * mottle
    canvas[90:, 90:230] = (np.asarray((148, 118, 84)) * mottle)[:, 90:230]
    rows, columns = where.slices(240, 320)
    shade = np.linspace(1.1, 0.6, columns.stop - columns.start)[:, None]
    canvas[rows, columns] = np.asarray(colour) * shade
    return (canvas * light + rng.normal(0, 3, canvas.shape)).clip(0, 255).astype(np.uint8)


def found(taught: Image, tap: Box, shown: Image) -> NDArray[np.float32]:
    """Attention in `shown` to what `tap` showed in `taught`, beside words for the ground."""
    perceiver = Lexicon()
    example = perceiver.example(perceiver.encode(taught), tap)
    prompts = [Prompt("grass"), Prompt("dirt path"), Prompt("sky"), Prompt("thing", (example,))]
    maps: NDArray[np.float32] = perceiver.attend(perceiver.encode(shown), prompts)[3]
    return maps


def assert_found(attention: NDArray[np.float32], where: Box) -> None:
    thing = where.grown(0.75).mask(*attention.shape)
    assert (attention[thing] >= 0.6).mean() > 0.8
    ground = ~where.grown(1.6).mask(*attention.shape)
    ground[: attention.shape[0] * 2 // 5] = False
    assert (attention[ground] < 0.2).mean() > 0.98


@pytest.mark.parametrize("colour", COLOURS)
def test_a_tapped_thing_lights_up_and_the_ground_does_not(colour: str) -> None:
    shown = picture(COLOURS[colour], FAR)
    assert_found(found(shown, FAR, shown), FAR)


@pytest.mark.parametrize("colour", COLOURS)
@pytest.mark.parametrize("light", [0.6, 1.4])
def test_it_is_found_again_nearer_and_under_another_light(colour: str, light: float) -> None:
    nearer = picture(COLOURS[colour], NEAR, light=light, seed=1)
    assert_found(found(picture(COLOURS[colour], FAR), FAR, nearer), NEAR)


@pytest.mark.parametrize("colour", COLOURS)
def test_a_tile_that_holds_only_half_of_the_thing_teaches_the_thing(colour: str) -> None:
    half = Box(FAR.left + 0.03, FAR.top + 0.06, FAR.right + 0.06, FAR.bottom + 0.05)
    nearer = picture(COLOURS[colour], NEAR, seed=1)
    assert_found(found(picture(COLOURS[colour], FAR), half, nearer), NEAR)


@pytest.mark.parametrize("colour", COLOURS)
def test_a_box_much_larger_than_the_thing_teaches_the_thing(colour: str) -> None:
    assert_found(found(picture(COLOURS[colour], FAR), FAR.grown(2.2), picture(COLOURS[colour], NEAR)), NEAR)


def test_a_tap_on_plain_ground_teaches_the_ground() -> None:
    shown = picture(COLOURS["orange"], FAR)
    attention = found(shown, Box(0.05, 0.75, 0.2, 0.9), shown)
    grass = Box(0.02, 0.7, 0.25, 0.98).mask(*attention.shape)
    path = Box(0.35, 0.75, 0.65, 0.98).mask(*attention.shape)
    assert attention[grass].mean() > 0.3
    assert attention[path].mean() < 0.2


def test_a_known_word_with_a_tap_finds_both() -> None:
    perceiver = Lexicon()
    features = perceiver.encode(picture(COLOURS["orange"], FAR))
    example = perceiver.example(features, FAR)
    both = perceiver.attend(features, [Prompt("grass", (example,))])[0]
    assert both[FAR.grown(0.7).mask(*both.shape)].mean() > 0.6
    assert both[Box(0.02, 0.7, 0.2, 0.98).mask(*both.shape)].mean() > 0.6


def test_of_several_taps_each_is_found() -> None:
    perceiver = Lexicon()
    examples = tuple(
        perceiver.example(perceiver.encode(picture(COLOURS[colour], FAR)), FAR)
        for colour in ("orange", "blue")
    )
    for colour in ("orange", "blue"):
        features = perceiver.encode(picture(COLOURS[colour], NEAR))
        maps = perceiver.attend(features, [Prompt("dirt path"), Prompt("drum", examples)])
        assert maps[1][NEAR.grown(0.7).mask(*maps.shape[1:])].mean() > 0.6


def test_a_box_too_small_to_teach_anything_is_refused() -> None:
    perceiver = Lexicon()
    with pytest.raises(ExampleError, match="too small"):
        perceiver.example(perceiver.encode(picture(COLOURS["red"], FAR)), Box(0.5, 0.5, 0.505, 0.505))


def test_a_box_over_the_whole_picture_teaches_something_finite() -> None:
    perceiver = Lexicon()
    example = perceiver.example(perceiver.encode(picture(COLOURS["red"], FAR)), Box(0.0, 0.0, 1.0, 1.0))
    assert example.model_id == perceiver.model_id
    assert np.isfinite(example.vector).all()
    assert example.vector.dtype == np.float32
