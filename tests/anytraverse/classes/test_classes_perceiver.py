"""The perceiver of a user's own network: words, what nobody asked about, taps, places, faults."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from anytraverse.engine import AnyTraverse
from anytraverse.errors import ExampleError, PerceiverError, PreferencesError, UnknownWordError
from anytraverse.frame import Frame, Image
from anytraverse.judging import Settings, Thresholds
from anytraverse.memory import first_memory
from anytraverse.perception import Example, Prompt
from anytraverse.perception.classes.perceiver import Classes
from anytraverse.preferences import Preferences
from anytraverse.regions import Box

Eyes = Callable[..., Classes]
Paint = Callable[..., Image]
HALVES = (np.s_[:, 2:14], np.s_[:, 18:30])
THIRD = Box(0.36, 0.1, 0.64, 0.9)


def words(*names: str) -> list[Prompt]:
    return [Prompt(name) for name in names]


def engine(perceiver: Classes, preferences: str) -> AnyTraverse:
    memory = first_memory(perceiver.model_id, Preferences.parse(preferences))
    return AnyTraverse(perceiver, Settings(thresholds=Thresholds.of(perceiver.defaults)), memory)


def test_a_word_lights_up_where_its_class_is_seen_and_nowhere_else(eyes: Eyes, painted: Paint) -> None:
    perceiver = eyes()
    grass, dirt = perceiver.attend(perceiver.encode(painted("grass", "dirt")), words("grass", "dirt"))
    assert grass.shape == (24, 32)
    assert grass.dtype == np.float32
    left, right = HALVES
    assert grass[left].min() > 0.95
    assert grass[right].max() < 0.05
    assert dirt[right].min() > 0.95
    assert dirt[left].max() < 0.05


def test_names_and_synonyms_are_the_vocabulary_and_ignored_classes_are_not(eyes: Eyes) -> None:
    perceiver = eyes()
    assert perceiver.vocabulary == ("grass", "dirt", "water", "lawn", "green grass", "trail")
    assert perceiver.meaning("Green  GRASS") == perceiver.meaning("lawn") == "grass"
    with pytest.raises(UnknownWordError):
        perceiver.meaning("void")


@pytest.mark.parametrize(("word", "nearest"), [("gras", "grass"), ("dirty", "dirt"), ("traill", "dirt")])
def test_an_unknown_word_is_refused_with_the_nearest_class_first(eyes: Eyes, word: str, nearest: str) -> None:
    with pytest.raises(UnknownWordError) as refused:
        eyes().meaning(word)
    assert refused.value.known[0] == nearest
    assert sorted(refused.value.known) == ["dirt", "grass", "water"]


def test_ground_that_nobody_asked_about_is_uncertain(eyes: Eyes, painted: Paint) -> None:
    perceiver = eyes()
    seen = perceiver.encode(painted("grass", "dirt"))
    left, right = HALVES
    uncertainty = 1 - perceiver.attend(seen, words("grass", "water")).max(axis=0)
    assert uncertainty[left].max() < 0.05
    assert uncertainty[right].min() > 0.95


def test_a_thing_of_an_ignored_class_is_uncertain_whatever_is_asked(eyes: Eyes, painted: Paint) -> None:
    perceiver = eyes()
    maps = perceiver.attend(perceiver.encode(painted("grey")), words("grass", "dirt", "water"))
    assert maps.max() < 0.4


def test_synonyms_asked_together_count_once(eyes: Eyes, painted: Paint) -> None:
    perceiver = eyes()
    seen = perceiver.encode(painted("grass", "grey", "dirt"))
    alone = perceiver.attend(seen, words("grass", "dirt"))
    grass, dirt, lawn = perceiver.attend(seen, words("grass", "dirt", "lawn"))
    np.testing.assert_allclose([grass, dirt], alone, atol=1e-6)
    np.testing.assert_array_equal(grass, lawn)


def test_synonyms_of_opposite_signs_are_refused(eyes: Eyes) -> None:
    with pytest.raises(PreferencesError, match="contradicts"):
        engine(eyes(), "grass: 1; lawn: -1")


def test_no_words_give_no_maps(eyes: Eyes, painted: Paint) -> None:
    perceiver = eyes()
    assert perceiver.attend(perceiver.encode(painted("grass")), []).shape == (0, 24, 32)


def test_classes_of_a_sigmoid_stand_each_for_itself(eyes: Eyes, painted: Paint) -> None:
    perceiver = eyes("--activation", "sigmoid")
    seen = perceiver.encode(painted("grass", "dirt"))
    np.testing.assert_array_equal(
        perceiver.attend(seen, words("grass"))[0], perceiver.attend(seen, words("grass", "dirt", "water"))[0]
    )
    np.testing.assert_allclose(
        seen.values[0, 12, 4], 1 / (1 + np.exp(-(12 * 240 - 12 * 20) / 255)), rtol=1e-5
    )


FORMS: dict[str, dict[str, Any]] = {
    "nhwc": {"shape": (1, 24, 32, 3)},
    "bytes": {"dtype": 2},
    "nhwc bytes": {"dtype": 2, "shape": (1, 24, 32, 3)},
    "free size": {"shape": ("n", 3, "h", "w"), "options": ("--size", "32x24")},
    "its own softmax": {"then": "Softmax"},
}


@pytest.mark.parametrize("name", FORMS)
def test_networks_of_other_forms_see_the_same(eyes: Eyes, painted: Paint, name: str) -> None:
    picture = painted("grass", "grey", "dirt", "water")
    plain, form = eyes(), dict(FORMS[name])
    other = eyes(*form.pop("options", ()), **form)
    expected = plain.attend(plain.encode(picture), words("grass", "dirt", "water"))
    maps = other.attend(other.encode(picture), words("grass", "dirt", "water"))
    np.testing.assert_allclose(maps, expected, atol=2e-5)
    assert plain.model_id != other.model_id


def test_a_network_trained_on_bgr_gets_bgr(eyes: Eyes, painted: Paint) -> None:
    perceiver = eyes("--bgr")
    (water,) = perceiver.attend(perceiver.encode(painted("dirt")), words("water"))
    assert water.min() > 0.95


def test_large_maps_are_thinned_without_moving(eyes: Eyes, painted: Paint) -> None:
    perceiver = eyes(shape=(1, 3, 500, 800))
    (grass,) = perceiver.attend(perceiver.encode(painted("grass", "dirt", size=(800, 500))), words("grass"))
    assert max(grass.shape) <= 360
    assert abs(float((grass > 0.5).mean()) - 0.5) < 1 / grass.shape[1]


def test_a_tapped_thing_is_found_again_and_the_rest_is_not(eyes: Eyes, painted: Paint) -> None:
    perceiver = eyes(features=1.0)
    example = perceiver.example(perceiver.encode(painted("grass", "dirt", "grass")), THIRD)
    (found,) = perceiver.attend(
        perceiver.encode(painted("dirt", "grass", "water")), [Prompt("gnome", (example,))]
    )
    assert found[:, :10].min() > 0.95
    assert found[:, 12:].max() < 0.1


def test_half_way_between_the_thing_and_what_was_around_it_is_a_half(eyes: Eyes, painted: Paint) -> None:
    perceiver = eyes(features=1.0)
    example = perceiver.example(perceiver.encode(painted("grass", "dirt", "grass")), THIRD)
    own, around = example.vector[-2:]
    seen = perceiver.encode(painted("grey"))
    (found,) = perceiver.attend(seen, [Prompt("gnome", (example,))])
    cosine = example.vector[:3].sum() / np.sqrt(3)
    np.testing.assert_allclose(found, (cosine - around) / (own - around), atol=1e-5)


def test_of_a_word_and_its_examples_the_larger_attention_counts(eyes: Eyes, painted: Paint) -> None:
    perceiver = eyes(features=1.0)
    seen = perceiver.encode(painted("grass", "dirt", "grass"))
    example = perceiver.example(seen, THIRD)
    (both,) = perceiver.attend(seen, [Prompt("lawn", (example,))])
    assert both.min() > 0.5
    assert both[:, 12:20].min() > 0.95


@pytest.mark.parametrize(
    ("picture", "box", "said"),
    [
        (("grass", "dirt", "grass"), Box(0.5, 0.5, 0.51, 0.51), "too small"),
        (("grass", "dirt", "grass"), Box(0.0, 0.0, 1.0, 1.0), "whole picture"),
        (("grass",), THIRD, "closer"),
    ],
)
def test_a_tap_that_teaches_nothing_is_refused(
    eyes: Eyes, painted: Paint, picture: tuple[str, ...], box: Box, said: str
) -> None:
    perceiver = eyes(features=1.0)
    with pytest.raises(ExampleError, match=said):
        perceiver.example(perceiver.encode(painted(*picture)), box)


def test_a_network_without_features_says_what_to_do_instead_of_a_tap(eyes: Eyes, painted: Paint) -> None:
    perceiver = eyes()
    with pytest.raises(ExampleError, match='second output called "features"'):
        perceiver.example(perceiver.encode(painted("grass", "dirt")), THIRD)


@pytest.mark.parametrize("wrong", ["model", "length"])
def test_an_example_of_another_network_is_refused(eyes: Eyes, painted: Paint, wrong: str) -> None:
    perceiver = eyes(features=1.0)
    model = "another" if wrong == "model" else perceiver.model_id
    example = Example(model, np.ones(5 if wrong == "model" else 9, dtype=np.float32))
    with pytest.raises(ExampleError, match="tap the thing again"):
        perceiver.attend(perceiver.encode(painted("grass")), [Prompt("gnome", (example,))])


@pytest.mark.parametrize("features", [None, 1.0])
@pytest.mark.parametrize("options", [(), ("--activation", "sigmoid")])
def test_like_places_have_like_embeddings(
    eyes: Eyes, painted: Paint, features: float | None, options: tuple[str, ...]
) -> None:
    perceiver = eyes(*options, features=features)

    def place(*columns: str) -> Any:
        return perceiver.embed(perceiver.encode(painted(*columns)))

    here, nearly, there = (
        place("grass", "dirt", "dirt"),
        place("grass", "grass", "dirt", "dirt", "dirt"),
        place("water"),
    )
    assert here.dtype == np.float32
    for vector in (here, nearly, there):
        assert abs(float(vector @ vector) - 1) < 1e-5
    assert here @ nearly > 0.9
    assert here @ there < 0.75


@pytest.mark.parametrize(
    "wrong", [{"features": float("nan")}, {"scores": np.full((4, 3), np.inf, np.float32)}]
)
def test_what_is_not_finite_anywhere_is_a_fault_and_never_ok(
    painted: Paint, wrong: dict[str, Any], spoilt: Callable[..., Classes]
) -> None:
    perceiver = spoilt(**wrong)
    assessment = engine(perceiver, "grass: 1").step(Frame(1, 0.0, painted("grass")), 0.1)
    assert [(each.reason.value, each.bad) for each in assessment.findings] == [("fault", True)]
    with pytest.raises(PerceiverError, match="not finite"):
        perceiver.encode(painted("grass"))


def test_values_that_break_the_bundles_promise_are_a_fault(
    painted: Paint, spoilt: Callable[..., Classes]
) -> None:
    perceiver = spoilt(activation="none")
    with pytest.raises(PerceiverError, match="--activation softmax or sigmoid"):
        perceiver.encode(painted("grass"))


def test_what_is_no_picture_is_refused(eyes: Eyes) -> None:
    with pytest.raises(PerceiverError, match="RGB"):
        eyes().encode(np.zeros((4, 4), dtype=np.uint8))
