"""What counts as a call that asks again about what was answered."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from companion.sim.repeats import PLACE_AGAIN_M, THING_AGAIN_M, AskedBefore

metres = st.floats(0.0, 1e4, allow_nan=False)


def test_a_first_call_about_anything_is_no_repeat() -> None:
    assert not AskedBefore().asks_again(10.0, "drum-1", "meadow")


def test_a_call_about_nothing_that_is_known_is_no_repeat() -> None:
    asked = AskedBefore()
    asked.answered(10.0, None, None)
    assert not asked.asks_again(10.0, None, None)


def test_a_call_about_the_same_thing_less_than_25_m_later_is_a_repeat() -> None:
    asked = AskedBefore()
    asked.answered(10.0, 7, None)
    assert asked.asks_again(34.9, 7, None)
    assert not asked.asks_again(35.0, 7, None)


def test_a_call_about_another_thing_is_no_repeat() -> None:
    asked = AskedBefore()
    asked.answered(10.0, 7, "meadow")
    assert not asked.asks_again(11.0, 8, None)


def test_a_call_about_the_same_place_less_than_100_m_later_is_a_repeat() -> None:
    asked = AskedBefore()
    asked.answered(10.0, None, "gravel")
    assert asked.asks_again(109.9, None, "gravel")
    assert not asked.asks_again(110.0, None, "gravel")
    assert not asked.asks_again(11.0, None, "forest")


def test_a_new_thing_in_an_answered_place_is_no_repeat_but_the_place_is() -> None:
    asked = AskedBefore()
    asked.answered(10.0, None, "gravel")
    assert not asked.asks_again(20.0, "log-1", None)
    assert asked.asks_again(20.0, "log-1", "gravel")


def test_a_later_answer_begins_the_distance_again() -> None:
    asked = AskedBefore()
    asked.answered(0.0, 1, None)
    asked.answered(20.0, 1, None)
    assert asked.asks_again(44.0, 1, None)


@given(at=metres, later=metres)
def test_a_repeat_depends_on_the_metres_between_answer_and_call_alone(at: float, later: float) -> None:
    asked = AskedBefore()
    asked.answered(at, 1, "meadow")
    now = at + later
    assert asked.asks_again(now, 1, None) == (now - at < THING_AGAIN_M)
    assert asked.asks_again(now, None, "meadow") == (now - at < PLACE_AGAIN_M)
