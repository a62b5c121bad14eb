"""What the built-in perceiver promises, on drawn pictures."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from anytraverse.errors import ExampleError, PerceiverError, UnknownWordError
from anytraverse.frame import Image
from anytraverse.perception import Example, Prompt, make_perceiver
from anytraverse.perception.builtin.features import GRID, ground_features
from anytraverse.perception.builtin.lexicon import LOOKS, Lexicon
from anytraverse.regions import Box

SKY, GRASS, DIRT, GRAVEL = (150, 185, 235), (84, 116, 48), (148, 118, 84), (158, 156, 152)
ORANGE = (222, 118, 28)
WORDS = ("grass", "dirt path", "sky", "bush", "tree")
GROUND = Box(0.0, 0.6, 0.25, 1.0)
PATH = Box(0.4, 0.6, 0.6, 1.0)


def scene(
    ground: tuple[int, int, int] = GRASS,
    path: tuple[int, int, int] = DIRT,
    *,
    light: float = 1.0,
    thing: Box | None = None,
    height: int = 240,
    width: int = 320,
    seed: int = 0,
) -> Image:
    """Sky over mottled ground with a path up the middle, and perhaps an orange thing, under some light."""
    rng = np.random.default_rng(seed)
    picture = np.empty((height, width, 3), dtype=np.float64)
    horizon = int(height * 0.38)
    picture[:horizon] = SKY
    mottle = 1 + 0.13 * rng.standard_normal((height - horizon, width, 1))
    picture[horizon:] = np.asarray(ground) * mottle
    lane = slice(width // 3, 2 * width // 3)
    picture[horizon:, lane] = (np.asarray(path) * mottle)[:, lane]
    if thing is not None:
        picture[thing.slices(height, width)] = ORANGE
    noisy = picture * light + rng.normal(0, 3, picture.shape)
    return noisy.clip(0, 255).astype(np.uint8)


def attend(image: Image, *words: str) -> dict[str, NDArray[np.float32]]:
    """Attention of words on a picture."""
    perceiver = Lexicon()
    maps = perceiver.attend(perceiver.encode(image), [Prompt(word) for word in words])
    return dict(zip(words, maps, strict=True))


def inside(values: NDArray[np.float32], box: Box) -> NDArray[np.float32]:
    """The values in a box."""
    return values[box.mask(*values.shape)]


def test_maps_are_float32_in_0_to_1_at_one_resolution_in_the_order_of_the_prompts() -> None:
    perceiver = Lexicon()
    features = perceiver.encode(scene())
    maps = perceiver.attend(features, [Prompt(word) for word in WORDS])
    assert maps.dtype == np.float32
    assert maps.shape == (len(WORDS), 72, GRID)
    assert maps.min() >= 0.0
    assert maps.max() <= 1.0
    swapped = perceiver.attend(features, [Prompt(word) for word in reversed(WORDS)])
    np.testing.assert_allclose(swapped[::-1], maps, atol=1e-6)


def test_no_prompts_give_no_maps() -> None:
    perceiver = Lexicon()
    assert perceiver.attend(perceiver.encode(scene()), []).shape == (0, 72, GRID)


def test_known_ground_is_known_and_each_word_finds_its_own() -> None:
    maps = attend(scene(), *WORDS)
    for word, box in (("grass", GROUND), ("dirt path", PATH), ("sky", Box(0.0, 0.0, 1.0, 0.3))):
        assert (inside(maps[word], box) >= 0.7).mean() > 0.9, word
        others = [other for other in ("grass", "dirt path", "sky") if other != word]
        assert all(inside(maps[other], box).mean() < 0.5 for other in others), word


@pytest.mark.parametrize("light", [0.5, 1.0, 1.6])
def test_a_thing_that_fits_no_word_is_low_in_every_map_under_any_light(light: float) -> None:
    thing = Box(0.42, 0.5, 0.58, 0.8)
    maps = np.stack(list(attend(scene(thing=thing, light=light), *WORDS).values()))
    assert (inside(maps.max(axis=0), thing.grown(0.8)) < 0.4).mean() > 0.9
    assert (inside(maps.max(axis=0), GROUND) >= 0.7).mean() > 0.9


def test_ground_that_nobody_asked_about_is_not_forced_into_the_asked_words() -> None:
    maps = attend(scene(thing=None), "sky", "gravel")
    assert np.stack([inside(each, GROUND) for each in maps.values()]).max(axis=0).mean() < 0.3


def test_how_well_a_place_is_explained_at_best_does_not_fall_with_more_words() -> None:
    few = np.stack(list(attend(scene(), "grass", "dirt path").values())).max(axis=0)
    more = np.stack(list(attend(scene(), *WORDS).values())).max(axis=0)
    assert (more >= few - 1e-3).all()


def test_attention_hardly_changes_with_the_light() -> None:
    reference = np.stack(list(attend(scene(), *WORDS).values()))
    for light in (0.5, 1.6):
        changed = np.stack(list(attend(scene(light=light, seed=1), *WORDS).values()))
        for box in (GROUND, PATH):
            pairs = zip(changed.max(axis=0)[None], reference.max(axis=0)[None], strict=True)
            assert all(abs(inside(a, box).mean() - inside(b, box).mean()) < 0.1 for a, b in pairs)


def test_synonyms_meet_under_one_name_and_look_alike() -> None:
    perceiver = Lexicon()
    assert perceiver.meaning("path") == perceiver.meaning("Trail") == "trail"
    assert perceiver.meaning("dirt path") == perceiver.meaning("earth") == "dirt"
    assert perceiver.meaning("puddle") == perceiver.meaning("water")
    features = perceiver.encode(scene())
    first, second = (
        perceiver.attend(features, [Prompt("dirt path")]),
        perceiver.attend(features, [Prompt("soil")]),
    )
    np.testing.assert_array_equal(first, second)


def test_every_word_of_the_vocabulary_can_be_grounded() -> None:
    perceiver = Lexicon()
    features = perceiver.encode(scene())
    assert {perceiver.meaning(word) for word in perceiver.vocabulary} == set(LOOKS)
    asked = [Prompt(word) for word in perceiver.vocabulary]
    assert np.isfinite(perceiver.attend(features, asked)).all()


def test_a_word_that_is_not_known_is_refused_by_name_with_what_is_known() -> None:
    perceiver = Lexicon()
    with pytest.raises(UnknownWordError, match=r'"gnome".*knows: .*grass.*tap'):
        perceiver.meaning("gnome")
    with pytest.raises(UnknownWordError, match="gnome"):
        perceiver.attend(perceiver.encode(scene()), [Prompt("grass"), Prompt("gnome")])


def test_the_scene_is_a_unit_vector_that_tells_kinds_of_ground_apart_but_not_light_or_things() -> None:
    perceiver = Lexicon()
    meadow = perceiver.embed(perceiver.encode(scene()))
    assert meadow.dtype == np.float32
    assert float(meadow @ meadow) == pytest.approx(1.0, abs=1e-5)
    limit = perceiver.defaults.scene
    for changed in (
        scene(light=0.5),
        scene(light=1.5),
        scene(thing=Box(0.42, 0.5, 0.58, 0.8)),
        scene(seed=5),
    ):
        assert float(meadow @ perceiver.embed(perceiver.encode(changed))) > limit + 0.03
    gravel = perceiver.embed(perceiver.encode(scene(GRAVEL, GRAVEL)))
    assert float(meadow @ gravel) < limit - 0.03


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (2, 3), (3, 900), (900, 3), (17, 31), (480, 640)])
def test_pictures_of_any_size_are_judged(shape: tuple[int, int]) -> None:
    perceiver = Lexicon()
    image = np.full((*shape, 3), 90, dtype=np.uint8)
    features = perceiver.encode(image)
    maps = perceiver.attend(features, [Prompt("grass")])
    assert np.isfinite(maps).all()
    assert max(maps.shape[1:]) == GRID
    assert np.linalg.norm(perceiver.embed(features)) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("level", [0, 255])
def test_black_and_white_pictures_stay_finite(level: int) -> None:
    perceiver = Lexicon()
    features = perceiver.encode(np.full((24, 32, 3), level, dtype=np.uint8))
    assert np.isfinite(features).all()
    assert np.isfinite(perceiver.embed(features)).all()


def test_what_is_no_picture_is_refused() -> None:
    pictures: list[Any] = [np.zeros((4, 4), np.uint8), np.zeros((4, 4, 3)), np.zeros((0, 4, 3), np.uint8)]
    for wrong in pictures:
        with pytest.raises(PerceiverError, match="RGB"):
            Lexicon().encode(wrong)


def test_features_are_the_same_for_a_picture_twice_as_bright() -> None:
    dim, bright = ground_features(scene(light=0.5)), ground_features(scene(light=1.0))
    below = np.abs(dim - bright)[30:]
    assert np.median(below, axis=(0, 1))[:3].max() < 0.05


def test_an_example_of_another_model_is_refused() -> None:
    perceiver = Lexicon()
    stranger = Example("another-1", np.zeros(8, dtype=np.float32))
    with pytest.raises(ExampleError, match="another-1"):
        perceiver.attend(perceiver.encode(scene()), [Prompt("drum", (stranger,))])


def test_it_is_made_by_name_and_another_name_is_refused_with_the_choices() -> None:
    assert make_perceiver("builtin:lexicon").model_id == "builtin-lexicon-1"
    assert make_perceiver("builtin").model_id.startswith("builtin-net-")
    with pytest.raises(PerceiverError, match=r"builtin, builtin:lexicon or builtin:FILE\.onnx"):
        make_perceiver("builtin:large")


def test_looks_of_the_lexicon_are_ordered_sanely() -> None:
    for concept, looks in LOOKS.items():
        for look in looks:
            assert all(spread > 0 for _, spread in look[:4]), concept
            assert all(low < high for low, high in pairwise(look.rows)), concept
