"""Out of AUTO the script on the autopilot brakes in GUIDED before it holds. Whose GUIDED it is, it tells."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.calls.decisions import HoldMoved, SetMode
from companion.calls.hold import HoldEvent, HoldState
from companion.calls.mode_monitor import ModeAnswer
from companion.vehicle import px4
from companion.wire.ids import Motion, Policy
from tests.companion.calls.scenes import AUTO, CLEAR, DRUM, GUIDED, HOLD, MANUAL, RTL, Scene

BRAKE = 2.0
BOUND = BRAKE + 2.0 + 0.1
"""s after the command to hold that leaves last, for which GUIDED may be the script's."""


def braking(mode: int = AUTO, *, brake: float = BRAKE, compares: bool = True) -> Scene:
    """A rover in front of a drum, whose hold was just commanded. The test plays the script."""
    scene = Scene(Policy.HOLD, mode=mode)
    scene.autopilot.brake = brake
    scene.autopilot.compares = compares
    scene.autopilot.deaf = True
    scene.run(2.0, CLEAR)
    while not [one for one in scene.log if isinstance(one[1], SetMode)]:
        scene.run(0.05, DRUM)
    return scene


def shows(scene: Scene, mode: int, seconds: float = 0.1) -> list[HoldEvent]:
    """The autopilot shows a mode for a while. Returns what happened to the hold."""
    scene.autopilot.mode = mode
    return events(scene, seconds)


def events(scene: Scene, seconds: float = 0.1) -> list[HoldEvent]:
    return [one.event for one in scene.run(seconds) if isinstance(one, HoldMoved)]


def answers(scene: Scene, *, accepted: bool = True, by_hand: bool = False) -> list[HoldEvent]:
    """The script answers the hold."""
    decisions = scene.keep(scene.calls.mode_answered(ModeAnswer(HOLD, accepted, by_hand), scene.now))
    return [one.event for one in decisions if isinstance(one, HoldMoved)]


def commanded(scene: Scene) -> list[int]:
    return [one.mode for _, one in scene.log if isinstance(one, SetMode)]


@pytest.mark.parametrize("heard", [True, False], ids=["the answers come", "the answers are lost"])
def test_guided_on_the_way_to_hold_is_the_brake(heard: bool) -> None:
    scene = braking()
    if heard:
        assert answers(scene) == []
    assert shows(scene, GUIDED, 1.9) == []
    assert scene.calls.hold is not None
    assert scene.calls.hold.state is HoldState.REQUESTED
    if heard:
        assert answers(scene) == []
    assert shows(scene, HOLD) == [HoldEvent.CONFIRMED]


def test_the_answer_may_come_after_the_report() -> None:
    scene = braking()
    assert shows(scene, GUIDED) == []
    assert answers(scene) == []
    assert shows(scene, HOLD, 1.0) == [HoldEvent.CONFIRMED]


def test_a_brake_is_no_failure_however_often_it_is_asked_about() -> None:
    scene = braking(brake=4.0)
    scene.numbers.mode_retry = 0.2
    answers(scene)
    assert shows(scene, GUIDED, 4.0) == []
    assert set(commanded(scene)) == {HOLD}
    assert len(commanded(scene)) > 10
    assert shows(scene, HOLD) == [HoldEvent.CONFIRMED]


def test_guided_that_lasts_longer_than_any_brake_is_a_human_s() -> None:
    scene = braking()
    answers(scene)
    assert shows(scene, GUIDED, BOUND - 0.3) == []
    assert events(scene, 1.5) == [HoldEvent.TAKEN_OVER]


def test_guided_is_a_human_s_where_the_script_says_so() -> None:
    scene = braking()
    shows(scene, GUIDED)
    assert answers(scene, accepted=False, by_hand=True) == [HoldEvent.TAKEN_OVER]
    scene = braking()
    assert answers(scene, accepted=False, by_hand=True) == []
    assert shows(scene, GUIDED) == [HoldEvent.TAKEN_OVER]


@pytest.mark.parametrize("mode", [MANUAL, RTL, AUTO])
@pytest.mark.parametrize("heard", [True, False])
def test_any_other_mode_after_the_brake_has_begun_is_a_human_s(mode: int, heard: bool) -> None:
    scene = braking()
    if heard:
        answers(scene)
    shows(scene, GUIDED)
    assert HoldEvent.TAKEN_OVER in shows(scene, mode)


def test_a_human_s_hold_in_the_brake_takes_over() -> None:
    scene = braking()
    answers(scene)
    shows(scene, GUIDED)
    assert answers(scene, accepted=False, by_hand=True) == [HoldEvent.TAKEN_OVER]


@pytest.mark.parametrize(("brake", "compares"), [(0.0, True), (BRAKE, False)], ids=["no brake", "no script"])
def test_where_nobody_brakes_guided_is_a_human_s(brake: float, compares: bool) -> None:
    scene = braking(brake=brake, compares=compares)
    assert shows(scene, GUIDED) == [HoldEvent.TAKEN_OVER]


def test_a_hold_out_of_guided_does_not_brake() -> None:
    scene = braking(GUIDED)
    answers(scene)
    assert shows(scene, AUTO) == [HoldEvent.TAKEN_OVER]


def test_no_other_autopilot_brakes() -> None:
    assert px4.LOITERING.brake_mode is None


def test_nothing_goes_past_the_script_over_guided_that_may_be_a_human_s() -> None:
    scene = braking()
    shows(scene, GUIDED)
    scene.autopilot.compares = False  # the link has lost the script
    scene.autopilot.told = None
    scene.run(0.1)
    before = len(commanded(scene))
    assert events(scene, BOUND - 0.5) == []
    assert len(commanded(scene)) == before
    assert events(scene, 2.0) == [HoldEvent.TAKEN_OVER]


def test_a_go_in_the_brake_counts_once_the_rover_holds() -> None:
    scene = braking()
    answers(scene)
    shows(scene, GUIDED)
    scene.answer(Motion.GO, {"drum": 1.0})
    scene.run(1.0, CLEAR)
    assert set(commanded(scene)) == {HOLD}
    assert shows(scene, HOLD, 1.0) == [HoldEvent.CONFIRMED]
    assert commanded(scene)[-1] == AUTO
    assert shows(scene, AUTO) == [HoldEvent.RESUMED]


def test_a_resume_that_is_cancelled_brakes_again() -> None:
    scene = braking()
    answers(scene)
    shows(scene, GUIDED)
    shows(scene, HOLD)
    scene.answer(Motion.GO, {"drum": 1.0})
    while commanded(scene)[-1] != AUTO:
        scene.run(0.05, CLEAR)
    scene.answer(Motion.STAY)
    scene.run(0.1)
    assert commanded(scene)[-1] == HOLD
    assert shows(scene, AUTO) == []
    assert answers(scene) == []
    assert shows(scene, GUIDED, 1.0) == []
    assert shows(scene, HOLD) == [HoldEvent.CONFIRMED]


@pytest.mark.parametrize("seen", [True, False], ids=["GUIDED was seen before", "only AUTO was seen"])
def test_a_companion_that_restarts_in_the_brake_still_knows_it(seen: bool) -> None:
    scene = braking()
    if seen:
        answers(scene)
        shows(scene, GUIDED)
    scene.restarted()
    before = len(commanded(scene))
    assert HoldEvent.TAKEN_OVER not in shows(scene, GUIDED, 1.5)
    assert 1 <= len(commanded(scene)) - before <= 3
    assert shows(scene, HOLD) == [HoldEvent.CONFIRMED]


def test_one_that_restarts_where_nobody_brakes_takes_guided_for_a_human_s() -> None:
    scene = braking(brake=0.0)
    scene.restarted()
    assert shows(scene, GUIDED) == [HoldEvent.TAKEN_OVER]


def test_an_autopilot_that_reboots_in_the_brake_is_held_again() -> None:
    scene = braking()
    answers(scene)
    shows(scene, GUIDED)
    scene.autopilot.reboots += 1
    scene.autopilot.armed = False
    assert shows(scene, HOLD) == [HoldEvent.REBOOTED]
    assert scene.calls.hold is not None


def test_a_rover_that_is_disarmed_in_the_brake_is_commanded_nothing() -> None:
    scene = braking()
    shows(scene, GUIDED)
    scene.autopilot.armed = False
    scene.run(0.1)
    before = len(commanded(scene))
    scene.run(1.5)
    assert len(commanded(scene)) == before


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("time"), st.sampled_from([0.05, 0.3, 1.0, 3.0])),
        st.tuples(st.just("answer"), st.sampled_from([0, 1])),
        st.tuples(st.just("human"), st.sampled_from([MANUAL, RTL, AUTO, GUIDED, HOLD])),
        st.tuples(st.just("lost"), st.sampled_from([0, 1])),
        st.tuples(st.just("restart"), st.just(0)),
    ),
    max_size=12,
)


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(STEPS)
def test_whoever_sets_what_and_whatever_is_lost_a_human_is_not_asked_over_for_long(
    steps: list[tuple[str, float]],
) -> None:
    """The test plays a script that brakes, and is right: it holds nobody who has set another mode."""
    scene = braking()
    scene.autopilot.mode = GUIDED
    human = False
    for kind, value in steps:
        if kind == "human":
            scene.autopilot.mode, human = int(value), True
        elif kind == "answer" and scene.calls.hold is not None:
            scene.keep(scene.calls.mode_answered(ModeAnswer(HOLD, not human, human), scene.now))
        elif kind == "lost":
            scene.autopilot.silent = bool(value)
        elif kind == "restart":
            scene.restarted()
        scene.run(value if kind == "time" else 0.05)
    scene.autopilot.silent = False
    scene.camera, scene.view = True, CLEAR
    if human and scene.autopilot.mode in (MANUAL, RTL):
        scene.run(1.2)
        assert scene.calls.hold is None
        before = len(commanded(scene))
        scene.run(3.0)
        assert len(commanded(scene)) == before
    elif scene.calls.hold is not None and not human:
        scene.autopilot.mode = HOLD
        scene.run(1.2)
        assert scene.calls.hold is None or scene.calls.hold.state is not HoldState.REQUESTED


def test_a_hold_that_begins_in_the_script_s_own_brake_ends_in_the_mission_and_not_in_guided() -> None:
    scene = braking(GUIDED)
    assert scene.calls.hold is not None
    assert scene.calls.hold.mode_before == GUIDED
    scene.keep(scene.calls.mode_answered(ModeAnswer(HOLD, accepted=True, brakes_out_of=AUTO), scene.now))
    assert shows(scene, GUIDED, 1.5) == []
    assert shows(scene, HOLD) == [HoldEvent.CONFIRMED]
    assert scene.calls.hold.mode_before == AUTO
