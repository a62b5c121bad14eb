"""A new place in surroundings that answered scenes have shown does not call; other surroundings do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from anytraverse.assessment import Assessment, Reason
from anytraverse.frame import Image
from anytraverse.history import ALONE, NEIGHBOURS, Entry, History
from anytraverse.preferences import Preferences
from tests.anytraverse.conftest import Painted, Rover

GRASS = Preferences.of({"grass": 1.0})
_HERE, _THERE = 0.0, 10.0


class Surrounded(Painted):
    """Sees surroundings: a point on a line, as far from 0 as the picture's corner pixel is green."""

    def surroundings(self, features: Image) -> NDArray[np.float32]:
        """One number, a tenth of the pixel."""
        return np.array([features[0, -1, 1] / 10], dtype=np.float32)


class Traveller(Rover):
    """A rover that goes to scenes at an angle, in surroundings of a number."""

    def __init__(self, words: str = "grass: 1; rock: -1") -> None:
        super().__init__(words)
        self.eyes = Surrounded()
        self.engine.perceiver = self.eyes

    def goes(self, scene: int, around: float) -> Assessment:
        """Judge a frame of a scene."""
        frame = self.frame(scene)
        image = frame.image.copy()
        image[0, -1, 1] = round(10 * around)
        return self.engine.step(replace(frame, image=image), self.now)

    def told_go(self, scene: int, around: float, call_id: int, **weights: float) -> None:
        """Answer the call of a new place."""
        seen = self.goes(scene, around)
        assert Reason.UNKNOWN_SCENE in seen.reasons
        self.answer(weights, call=seen.observation, call_id=call_id, go=True)


@pytest.fixture
def at_home() -> Traveller:
    """A rover that began at one scene and was told go at another one, in the same region."""
    rover = Traveller()
    rover.goes(0, _HERE)
    rover.told_go(60, _HERE + 1.3, 7)
    return rover


def test_a_new_place_in_the_surroundings_of_two_answered_scenes_does_not_call(at_home: Traveller) -> None:
    seen = at_home.goes(120, _HERE + 0.5)
    assert seen.ok
    assert seen.similarity == pytest.approx(0.5), "told as it is"
    assert at_home.memory.reference is at_home.memory.history[-1].embedding, "the place in force stays"


def test_foreign_surroundings_call(at_home: Traveller) -> None:
    seen = at_home.goes(120, _THERE)
    assert seen.reasons == {Reason.UNKNOWN_SCENE}
    assert seen.likeness is not None
    assert seen.likeness.similarity == pytest.approx(0.5), "to the place, whatever surrounds it"


def test_a_frame_of_the_place_in_force_calls_where_its_surroundings_are_foreign(at_home: Traveller) -> None:
    covered = _HERE + 3.0
    seen = at_home.goes(60, covered)
    assert seen.similarity == pytest.approx(1.0), "what a covered lens shows resembles it"
    assert seen.reasons == {Reason.UNKNOWN_SCENE}
    assert at_home.goes(60, _HERE + 1.0).ok
    at_home.answer(call=seen.observation, call_id=9, go=True)
    assert at_home.goes(60, covered).ok, "answered"


def test_a_remembered_place_does_not_match_where_the_surroundings_are_foreign(at_home: Traveller) -> None:
    at_home.told_go(150, _THERE, 8, trail=1.0)
    for scene in (150, 0, 0):
        at_home.goes(scene, _THERE + 3.0)
    assert at_home.memory.adoption is None


def test_one_known_scene_is_enough_to_tell_what_is_foreign() -> None:
    rover = Traveller()
    rover.goes(0, _HERE)
    assert rover.goes(0, _HERE + 3.0).reasons == {Reason.UNKNOWN_SCENE}


def test_one_known_scene_makes_only_what_is_near_it_familiar() -> None:
    rover = Traveller()
    rover.goes(0, _HERE)
    assert len(rover.memory.history) == 1
    assert rover.goes(60, _HERE + 1.1).ok
    assert rover.goes(60, _HERE + 1.3).reasons == {Reason.UNKNOWN_SCENE}, "two scenes would allow it"


def test_a_rover_that_goes_to_another_region_learns_it_and_knows_the_first_one_still(
    at_home: Traveller,
) -> None:
    at_home.told_go(120, _THERE, 8)
    assert at_home.goes(179, _THERE + 1).ok, "the mean of all three is far away, and one of them near"
    assert at_home.goes(179, _THERE + 1.3).reasons == {Reason.UNKNOWN_SCENE}
    assert at_home.goes(120, _HERE + 1).ok


def test_scenes_whose_words_were_changed_since_say_nothing(at_home: Traveller) -> None:
    assert at_home.goes(120, _HERE).ok
    at_home.answer({"grass": 0.5})
    assert at_home.goes(120, _HERE).reasons == {Reason.UNKNOWN_SCENE}


def test_a_remembered_place_gives_its_words_where_the_surroundings_are_familiar(at_home: Traveller) -> None:
    at_home.told_go(150, _THERE, 8, trail=1.0)
    at_home.answer(forget=("trail",))
    at_home.goes(60, _HERE)
    at_home.goes(60, _HERE)
    for _ in range(3):
        seen = at_home.goes(150, _HERE)
        assert not seen.reasons
        if seen.adopted is not None:
            break
    assert seen.adopted is not None
    assert seen.adopted.call_id == 8


def test_a_frame_that_an_operator_said_is_another_place_calls_in_familiar_surroundings(
    at_home: Traveller,
) -> None:
    for _ in range(3):
        at_home.goes(10, _HERE)
    assert at_home.memory.adoption is not None
    at_home.answer(other_place=0)
    assert at_home.goes(10, _HERE).reasons == {Reason.UNKNOWN_SCENE}
    assert at_home.goes(120, _HERE).ok, "elsewhere they are as familiar as before"
    at_home.told_go(10, _HERE, 8)
    assert at_home.goes(10, _HERE).ok


def test_a_new_episode_knows_no_surroundings(at_home: Traveller) -> None:
    assert at_home.goes(120, _HERE + 1.3).ok
    seen = at_home.goes(60, _HERE)
    at_home.answer(call=seen.observation, call_id=9, go=True, new_episode=True)
    assert at_home.goes(120, _HERE + 1.3).reasons == {Reason.UNKNOWN_SCENE}


def test_a_raised_threshold_of_the_scene_makes_surroundings_less_familiar(at_home: Traveller) -> None:
    limits = at_home.engine.settings.thresholds
    assert at_home.goes(120, _HERE + 2.2).ok
    at_home.engine.settings = replace(at_home.engine.settings, thresholds=replace(limits, scene=0.99))
    assert at_home.goes(120, _HERE).ok
    assert at_home.goes(120, _HERE + 2.2).reasons == {Reason.UNKNOWN_SCENE}


@pytest.mark.parametrize("broken", [np.nan, np.inf])
def test_surroundings_that_are_not_finite_make_nothing_familiar_and_are_not_remembered(
    at_home: Traveller, broken: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Surrounded, "surroundings", lambda *_: np.array([broken], np.float32))
    at_home.told_go(120, _HERE, 8)
    assert at_home.memory.history[-1].surroundings is None


def test_a_perceiver_without_surroundings_calls_as_before() -> None:
    rover = Rover("grass: 1; rock: -1")
    rover.see(0)
    for scene, call_id in ((60, 7), (120, 8)):
        rover.answer(call=rover.call(scene), call_id=call_id, go=True)
    assert rover.see(179).reasons == {Reason.UNKNOWN_SCENE}
    assert all(one.surroundings is None for one in rover.memory.history)


def history(*points: list[float]) -> History:
    """Scenes with these surroundings."""
    return History(
        [
            Entry(np.ones(2, np.float32), GRASS, n, n, surroundings=np.array(point, np.float32))
            for n, point in enumerate(points)
        ]
    )


def test_strangeness_is_the_distance_to_the_nearest_scenes_mean_that_few_make_uncertain() -> None:
    two = history([0.0, 0.0], [2.0, 0.0])
    assert two.strangeness(np.array([1.0, 1.0], np.float32), GRASS) == pytest.approx(1.0 * 2 / 3)
    assert two.strangeness(np.array([0.0, 0.5], np.float32), GRASS) == pytest.approx(0.25 / 2 / ALONE)
    afar = [[90.0, 90.0]] * 5
    near = [[1.0, side] for side in (-1.0, 1.0)] * (NEIGHBOURS // 2)
    many = history(*afar, *near)
    found = many.strangeness(np.array([0.0, 0.0], np.float32), GRASS)
    assert found == pytest.approx(NEIGHBOURS / (NEIGHBOURS + 1))


def test_scenes_of_another_length_or_other_words_are_not_compared() -> None:
    known = history([0.0, 0.0], [1.0, 0.0])
    assert known.strangeness(np.array([0.0], np.float32), GRASS) is None
    here, more = np.array([0.0, 0.0], np.float32), Preferences.of({"grass": 1.0, "rock": -1.0})
    assert known.strangeness(here, Preferences.of({"grass": -1.0})) is None
    assert known.strangeness(here, more) is not None


def test_the_nearest_scene_of_any_words_says_what_is_strange_to_all() -> None:
    known = history([0.0, 0.0], [9.0, 0.0])
    assert known.nearest_strangeness(np.array([0.0, 2.0], np.float32)) == pytest.approx(2.0)
    assert known.nearest_strangeness(np.array([9.0, 3.0], np.float32)) == pytest.approx(4.5)
    assert known.nearest_strangeness(np.array([99.0], np.float32)) is None, "of another length"
    assert History().nearest_strangeness(np.array([99.0], np.float32)) is None, "nothing is known"


@given(st.lists(st.floats(-1e3, 1e3, width=32), min_size=2, max_size=20), st.floats(-1e3, 1e3, width=32))
def test_strangeness_is_never_below_0_and_does_not_depend_on_the_order(
    points: list[float], at: float
) -> None:
    vector = np.array([at], np.float32)
    one = history(*([point] for point in points)).strangeness(vector, GRASS)
    other = history(*([point] for point in reversed(points))).strangeness(vector, GRASS)
    assert one is not None
    assert other is not None
    assert one >= 0.0
    assert other == pytest.approx(one, rel=1e-6, abs=1e-6)
