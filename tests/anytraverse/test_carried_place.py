"""An answered place is carried along on the way on from it, a little below the threshold, and ends."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

from anytraverse.answers import Changes
from anytraverse.assessment import Assessment, Reason
from anytraverse.history import Place

if TYPE_CHECKING:
    from tests.anytraverse.conftest import Rover

HERE = Place(47.0, 8.0)
CLOSE, FAR = Place(47.0, 8.0 + 40 / 76_000), Place(47.0, 8.0 + 52 / 76_000)
"""Some 40 and 52 m to the east."""
START = 90
THRESHOLD = math.degrees(math.acos(0.85))
LAST = math.degrees(math.acos(0.80))
"""Degrees from the answered scene up to which it is carried."""


@pytest.fixture
def answered(rover: Rover) -> Rover:
    """A rover that was told go at a new place."""
    call = rover.call(START)
    assert Reason.UNKNOWN_SCENE in rover.see(START).reasons
    rover.answer(call=call, call_id=7, go=True)
    return rover


def drives(rover: Rover, *scenes: int, place: Place | None = None) -> Assessment:
    for scene in scenes:
        seen = rover.engine.step(rover.frame(scene), rover.now, place)
    return seen


def test_frames_that_lead_on_from_an_answered_place_do_not_call_though_they_are_less_alike(
    answered: Rover,
) -> None:
    history, reference = answered.memory.history, answered.memory.reference
    assert THRESHOLD < 36 < LAST
    seen = drives(answered, *range(START, START + 37, 3), START + 36)
    assert seen.ok
    assert seen.similarity == pytest.approx(math.cos(math.radians(36))), "told as it is"
    assert answered.memory.history is history
    assert answered.memory.reference is reference


def test_it_ends_where_they_are_too_unlike_the_answered_one(answered: Rover) -> None:
    seen = drives(answered, *range(START, START + 37, 3), START + 38)
    assert seen.reasons == {Reason.UNKNOWN_SCENE}


def test_another_place_that_no_frames_lead_to_calls(answered: Rover) -> None:
    assert drives(answered, START, START + 36).reasons == {Reason.UNKNOWN_SCENE}


def test_a_single_strange_frame_does_not_end_it(answered: Rover) -> None:
    assert not drives(answered, START, START + 20, START + 80).ok
    assert drives(answered, START + 30, START + 36).ok


def test_it_ends_after_a_minute(answered: Rover) -> None:
    way = [START + 20, START + 36]
    answered.now += 59
    assert drives(answered, *way).ok
    answered.now += 1
    assert drives(answered, START + 36).reasons == {Reason.UNKNOWN_SCENE}


def test_it_ends_after_fifty_metres_where_positions_are_known(rover: Rover) -> None:
    call = rover.call(START)
    rover.engine.answer(Changes(), rover.now, call=call, call_id=7, go=True, place=HERE)
    assert drives(rover, START + 20, START + 36, place=CLOSE).ok
    assert drives(rover, START + 36, place=Place()).ok, "a position that is lost says nothing"
    assert drives(rover, START + 36, place=FAR).reasons == {Reason.UNKNOWN_SCENE}
    assert drives(rover, START + 36, place=HERE).reasons == {Reason.UNKNOWN_SCENE}, "it has ended"


def test_a_place_that_was_left_before_the_answer_is_not_carried(rover: Rover) -> None:
    call = rover.call(START)
    drives(rover, 0)
    rover.answer(call=call, call_id=7, go=True)
    assert drives(rover, 20).ok
    assert drives(rover, 36).reasons == {Reason.UNKNOWN_SCENE}


def test_a_thing_that_is_named_in_a_known_place_makes_no_place_that_is_carried(rover: Rover) -> None:
    call = rover.call(20, thing="gnome")
    assert Reason.UNKNOWN_SCENE not in rover.see(20).reasons
    rover.answer(call=call, call_id=7, go=True)
    assert drives(rover, *range(20, 51, 3), 20 + 30).ok
    assert drives(rover, 20 + 34).reasons == {Reason.UNKNOWN_SCENE}


def test_a_thing_that_is_named_on_the_way_neither_ends_nor_lengthens_it(answered: Rover) -> None:
    answered.now += 50
    answered.answer(call=answered.call(START + 20, thing="gnome"), call_id=8, go=True)
    assert drives(answered, START, START - 15).ok, "35 degrees from the thing's scene, 15 from the place's"
    answered.now += 10
    assert drives(answered, START - 15).reasons == {Reason.UNKNOWN_SCENE}


def test_a_new_episode_ends_it(answered: Rover) -> None:
    answered.answer(call=answered.call(START + 20), call_id=8, go=True, new_episode=True)
    assert drives(answered, START, START - 15).reasons == {Reason.UNKNOWN_SCENE}


def test_frames_that_creep_on_from_each_other_lead_into_no_other_place(make_rover: type[Rover]) -> None:
    rover = make_rover("grass: 1; rock: -1")
    rover.eyes.spoil_embedding = round_the_place
    rover.see()
    rover.answer(call=rover.call(START), call_id=7, go=True)
    assert drives(rover, *range(START, START + 46)).ok, "on to its edge, and a little along that"
    seen = drives(rover, *range(START + 46, START + 91))
    assert seen.similarity == pytest.approx(math.cos(math.radians(35))), "as far from the answered as before"
    assert seen.reasons == {Reason.UNKNOWN_SCENE}


def round_the_place(vector: NDArray[np.float32]) -> NDArray[np.float32]:
    """Scenes 90 to 125 lead 35 degrees away from the one at 90; those to 180 lead round it, as far away."""
    scene = math.degrees(math.atan2(vector[1], vector[0]))
    away, along = math.radians(min(abs(scene - 90), 35)), math.radians(3 * max(0, scene - 125))
    if scene < 90:
        away, along = math.radians(90), math.radians(180)
    across = math.sin(away)
    return np.array([across * math.cos(along), across * math.sin(along), math.cos(away)], dtype=np.float32)


def test_a_remembered_scene_that_is_adopted_ends_it(answered: Rover) -> None:
    drives(answered, START, 0, 0, 0)
    assert drives(answered, START + 20, START + 36).reasons & {Reason.UNKNOWN_SCENE}


@pytest.mark.parametrize(
    ("one", "other", "metres"),
    [
        (HERE, Place(47.0, 8.001), 75.9),
        (HERE, Place(47.001, 8.0), 111.3),
        (Place(0.0, 179.9999), Place(0.0, -179.9999), 22.3),
        (HERE, Place(), None),
        (Place(47.0), HERE, None),
    ],
)
def test_the_way_between_two_places(one: Place, other: Place, metres: float | None) -> None:
    assert one.metres_to(other) == (None if metres is None else pytest.approx(metres, abs=0.1))
