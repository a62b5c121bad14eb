"""Tests of the rules by which the companion drives the vehicle round something."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.frame import Pose
from companion.guide.motion import STAND
from companion.guide.plan import Plan
from companion.guide.rules import (
    CLEAR_FOR,
    NEARS,
    NEARS_FOR,
    STUCK_AFTER,
    TAKEN_WITHIN,
    Circumstances,
    Guide,
    GuideAnswer,
    GuideState,
    Orders,
)
from companion.vehicle.ardupilot import AUTO, GUIDED, HOLD

MANUAL = 0
TURN = 0.02
AWAY = ((0.3, 3.0), (-0.3, 3.0))


class Rover:
    """A rover on its way to something that leaves room, by what the companion is told of it."""

    def __init__(self) -> None:
        self.guide = Guide(radius=1.5, freshness=1.0)
        self.now = 100.0
        self.told: dict[str, Any] = {}
        self.plan: dict[str, Any] | None = {"route_clear": 4.0, "route_blocked": True}
        self.all: list[Orders] = []

    @property
    def state(self) -> GuideState:
        return self.guide.state

    @property
    def stuck(self) -> str:
        return self.guide.stuck

    def turn(self, seconds: float = TURN, **told: Any) -> Orders:
        """Lets so much time pass with these circumstances, which last; returns the last orders."""
        self.told |= told
        end = self.now + seconds - TURN / 2
        while self.now < end:
            self.now += TURN
            if self.plan is not None:
                plan: dict[str, Any] = {"arcs": AWAY, "clear": 6.0, "gap": 1.0} | self.plan
                self.guide.planned(Plan(self.now, Pose(0.0, 0.0, 0.0), **plan))
            self.all.append(self.guide.tick(self.circumstances()))
        return self.all[-1]

    def circumstances(self) -> Circumstances:
        now, told = self.now, self.told
        known: dict[str, Any] = {
            "now": now,
            "allowed": True,
            "mode": AUTO,
            "mode_at": now,
            "armed": True,
            "motion_at": now,
            "position_at": now,
            "pose": Pose(0.0, 0.0, 0.0),
            "driven": 1.0,
            "speed": 1.0,
            "held": False,
            "stopped": False,
            "asks": False,
            "shows": False,
            "accepts": False,
            "item": 2,
            "passed": 2,
            "leg": 0.0,
            "left": 30.0,
            "nears": math.inf,
        }
        return Circumstances(**(known | told))

    def guided(self) -> Rover:
        """Takes over, as the script grants it."""
        self.turn(0.2)
        self.guide.answered(GuideAnswer(GUIDED, done=True), self.now)
        self.turn(mode=GUIDED)
        assert self.state is GuideState.GUIDING
        return self


def test_the_target_is_streamed_before_guided_is_requested() -> None:
    rover = Rover()
    rover.turn(0.2)
    targets = [bool(orders.target) for orders in rover.all]
    requests = [orders.request for orders in rover.all if orders.request]
    assert requests == [(GUIDED, AUTO)]
    first = next(n for n, orders in enumerate(rover.all) if orders.request)
    assert targets[first - 1]
    assert rover.guide.guides


def test_it_takes_over_only_for_something_in_the_way() -> None:
    rover = Rover()
    rover.plan = {"route_clear": 5.0}
    rover.turn(2.0)
    assert not rover.guide.guides
    rover.turn(shows=True)
    assert rover.guide.guides


@pytest.mark.parametrize(
    "told",
    [
        {"allowed": False},
        {"armed": False},
        {"leg": None},
        {"pose": None},
        {"mode_at": None},
        {"mode_at": 98.0},
        {"motion_at": 99.0},
        {"position_at": 99.0},
        {"asks": True},
        {"held": True},
        {"mode": MANUAL},
        {"mode": GUIDED},
        {"driven": 3.0},
    ],
)
def test_it_takes_over_only_where_all_is_known_and_the_way_is_clear_to_a_standstill(
    told: dict[str, Any],
) -> None:
    rover = Rover()
    rover.turn(1.0, **told)
    assert not rover.guide.guides
    assert not any(orders.request or orders.target for orders in rover.all)


def test_it_takes_over_only_after_three_plans_with_a_way() -> None:
    rover = Rover()
    rover.turn(2 * TURN)
    assert not rover.guide.guides
    rover.turn()
    assert rover.guide.guides


def test_a_take_over_that_does_not_show_in_time_stops_the_vehicle() -> None:
    rover = Rover()
    rover.turn(TAKEN_WITHIN)
    assert rover.stuck == ""
    assert rover.turn(0.2) == Orders(STAND)
    assert rover.stuck.startswith("no take-over")
    assert not rover.guide.passes


def test_a_refused_take_over_stops_the_vehicle() -> None:
    rover = Rover()
    rover.turn(0.2)
    rover.guide.answered(GuideAnswer(GUIDED, done=False), rover.now)
    rover.turn()
    assert rover.stuck
    assert not rover.guide.passes


def test_what_it_drives_round_stops_nobody_and_nothing_else_is_passed() -> None:
    rover = Rover()
    rover.turn(3 * TURN)
    assert rover.guide.passes
    rover.guided()
    assert rover.guide.passes
    assert rover.turn(asks=True) == Orders(STAND)
    assert rover.stuck == ""


def test_it_drives_slower_where_less_of_the_way_is_clear_and_never_faster_than_allowed() -> None:
    rover = Rover().guided()
    speeds = []
    for clear in (6.0, 2.5, 1.5, 0.6):
        assert rover.plan is not None
        rover.plan["clear"] = clear
        orders = rover.turn()
        assert orders.target is not None
        speeds.append(orders.target.speed)
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[0] <= 1.0
    assert speeds[-1] == 0.0


def test_without_a_way_it_slows_down_at_once_and_is_stopped_soon() -> None:
    rover = Rover().guided()
    rover.plan = {"route_clear": 1.0, "route_blocked": True, "arcs": (), "clear": 0.0}
    assert rover.turn() == Orders(STAND)
    assert rover.stuck == ""
    rover.turn(STUCK_AFTER + 2 * TURN)
    assert rover.stuck.startswith("no way")


def test_without_plans_it_is_stopped() -> None:
    rover = Rover().guided()
    rover.plan = None
    rover.turn(1.0 + STUCK_AFTER + 3 * TURN)
    assert rover.stuck


@pytest.mark.parametrize("told", [{"motion_at": 90.0}, {"position_at": 90.0}, {"mode_at": None}])
def test_without_knowing_how_it_moves_it_is_stopped(told: dict[str, Any]) -> None:
    rover = Rover().guided()
    assert rover.turn(**told) == Orders(STAND)
    assert rover.stuck


def test_where_it_may_not_guide_any_more_nothing_is_streamed_but_it_still_says_that_it_guides() -> None:
    """The script on the autopilot then stops the vehicle, which a companion in policy off may not."""
    rover = Rover().guided()
    assert rover.turn(allowed=False) == Orders(STAND)
    assert rover.turn(0.4) == Orders()
    assert rover.guide.guides
    assert not rover.guide.passes
    rover.turn(5.0)
    assert not rover.guide.guides


@pytest.mark.parametrize("mode", [MANUAL, HOLD, AUTO])
def test_a_mode_that_was_not_requested_ends_it_for_good(mode: int) -> None:
    rover = Rover().guided()
    rover.turn(1.0)
    assert rover.turn(mode=mode) == Orders()
    assert not rover.guide.guides
    rover.all.clear()
    if mode == AUTO:
        rover.turn(5.0)
        assert not any(orders.request or orders.target for orders in rover.all)
    rover.turn(mode=MANUAL)
    rover.turn(0.5, mode=AUTO)
    assert rover.guide.guides


def test_guided_by_a_human_before_the_request_ends_it() -> None:
    rover = Rover()
    rover.turn(3 * TURN)
    assert rover.state is GuideState.TAKING
    assert rover.turn(mode=GUIDED) == Orders()
    assert not rover.guide.guides


def test_it_drives_in_guided_only_once_the_script_says_that_it_is_ours() -> None:
    rover = Rover()
    rover.turn(0.2)
    rover.turn(0.2, mode=GUIDED)
    assert rover.state is GuideState.TAKING
    rover.turn(TAKEN_WITHIN)
    assert rover.stuck


def test_somebody_else_s_target_ends_it() -> None:
    rover = Rover().guided()
    rover.guide.answered(GuideAnswer(GUIDED, done=None), rover.now)
    assert rover.turn() == Orders()
    assert not rover.guide.guides


def test_our_hold_ends_it_and_nothing_is_streamed_whoever_has_guided_then() -> None:
    rover = Rover().guided()
    assert rover.turn(held=True) == Orders()
    assert rover.turn(1.0, held=False) == Orders()
    assert not rover.guide.guides


def test_a_late_report_of_the_mission_s_mode_does_not_end_it() -> None:
    rover = Rover()
    rover.turn(0.2)
    rover.guide.answered(GuideAnswer(GUIDED, done=True), rover.now)
    rover.turn(1.2, mode_at=rover.now)
    del rover.told["mode_at"]
    rover.turn(1.0, mode=GUIDED)
    assert rover.state is GuideState.GUIDING


def test_a_mode_that_is_reported_no_more_is_lost() -> None:
    rover = Rover().guided()
    rover.turn(mode_at=None)
    assert rover.stuck.startswith("motion lost")


def test_without_a_pose_it_stands_and_soon_is_stopped() -> None:
    rover = Rover().guided()
    assert rover.turn(pose=None) == Orders(STAND)
    assert rover.stuck == ""
    rover.turn(STUCK_AFTER + 2 * TURN)
    assert rover.stuck.startswith("no way")


def test_while_it_guides_it_asks_once_a_second_whether_guided_is_still_ours() -> None:
    rover = Rover().guided()
    rover.all.clear()
    rover.turn(3.1)
    assert [orders.request for orders in rover.all if orders.request] == [(GUIDED, GUIDED)] * 3
    rover.guide.answered(GuideAnswer(GUIDED, done=True), rover.now)
    assert rover.state is GuideState.GUIDING
    rover.guide.answered(GuideAnswer(GUIDED, done=False), rover.now)
    assert not rover.guide.guides


def test_a_second_answer_to_giving_back_is_nobody_else_s() -> None:
    rover = Rover().guided()
    behind_it(rover)
    rover.guide.answered(GuideAnswer(AUTO, done=True), rover.now)
    rover.guide.answered(GuideAnswer(AUTO, done=None), rover.now)
    rover.turn(0.7, mode_at=rover.now - TURN)
    assert rover.turn(mode=AUTO, mode_at=rover.now + TURN).target is None
    assert rover.state is GuideState.READY


def test_a_guided_that_shows_after_the_mission_s_mode_was_set_is_somebody_else_s_and_gets_no_target() -> None:
    rover = Rover().guided()
    behind_it(rover)
    rover.guide.answered(GuideAnswer(AUTO, done=True), rover.now)
    rover.all.clear()
    rover.turn(1.0, mode_at=rover.now - TURN)
    assert rover.guide.guides, "no mode was reported since"
    rover.turn(mode_at=rover.now)
    assert set(rover.all) == {Orders()}
    assert rover.guide.ended_by == "by hand"


def test_once_the_mission_s_mode_is_requested_it_passes_only_what_it_could_take_over_for() -> None:
    rover = Rover().guided()
    behind_it(rover)
    assert rover.all[-1].request == (AUTO, GUIDED)
    assert rover.guide.passes
    rover.plan = {"route_clear": 1.0, "route_blocked": True, "arcs": (), "clear": 0.0}
    for answer in (None, GuideAnswer(AUTO, done=True)):
        if answer is not None:
            rover.guide.answered(answer, rover.now)
        rover.turn(0.1, shows=True, mode_at=rover.now - TURN)
        assert not rover.guide.passes
    rover.turn(mode=AUTO, mode_at=rover.now + TURN)
    assert rover.state is GuideState.READY
    assert not rover.guide.passes


@pytest.mark.parametrize("told", [{"shows": True}, {}])
def test_the_mission_s_mode_is_requested_no_more_once_something_is_in_its_way(told: dict[str, Any]) -> None:
    rover = Rover().guided()
    behind_it(rover)
    assert rover.all[-1].request == (AUTO, GUIDED)
    rover.plan = {"route_clear": 4.0, "route_blocked": not told}
    rover.all.clear()
    rover.turn(0.9, **told)
    assert rover.state is GuideState.GUIDING
    assert not any(orders.request == (AUTO, GUIDED) for orders in rover.all)
    rover.turn(mode=AUTO)
    assert (rover.guide.guides, rover.guide.ended_by) == (False, ""), "the request was carried out after all"


def test_a_mission_s_mode_long_after_the_request_for_it_is_a_human_s() -> None:
    rover = Rover().guided()
    behind_it(rover)
    rover.plan = {"route_clear": 4.0, "route_blocked": True}
    rover.turn(3.0)
    rover.turn(mode=AUTO)
    assert rover.guide.ended_by == "by hand"


@pytest.mark.parametrize(("seconds", "cruise"), [(0.2, 0.8), (4.0, 0.6), (9.0, 0.5)])
def test_guided_is_no_faster_than_the_mission_was_of_late(seconds: float, cruise: float) -> None:
    rover = Rover()
    rover.plan = {"route_clear": 5.0}
    rover.turn(1.0, speed=1.2, driven=0.8)
    rover.turn(seconds, driven=0.4)
    rover.plan = {"route_clear": 4.0, "route_blocked": True, "arcs": ((0.0, 6.0),)}
    rover.guided()
    target = rover.turn(driven=1.0).target
    assert target is not None
    assert target.speed == pytest.approx(cruise, abs=0.03)


def test_a_waypoint_that_was_passed_is_set_in_the_hold_that_ended_it() -> None:
    rover = Rover().guided()
    rover.turn(held=True)
    assert rover.turn(mode=HOLD, passed=3).item == 3
    assert rover.turn(0.4).item is None
    rover.turn(60.0)
    assert [orders.item for orders in rover.all].count(3) == 6, "the autopilot refuses it"
    assert rover.turn(item=3).item is None


def test_so_is_one_that_a_hold_out_of_auto_has_rolled_past() -> None:
    rover = Rover()
    rover.plan = {"route_clear": 5.0}
    assert rover.turn(held=True, passed=3).item is None, "AUTO still drives to it"
    assert rover.turn(mode=HOLD).item == 3
    assert rover.turn(item=3).item is None


def test_so_is_it_in_a_hold_of_the_script_s_and_in_no_human_s() -> None:
    rover = Rover().guided()
    assert rover.turn(mode=HOLD, passed=3).item is None
    assert rover.turn(stopped=True).item == 3
    assert rover.turn(item=3).item is None


def test_what_an_operator_accepted_is_driven_over_by_the_mission() -> None:
    rover = Rover()
    rover.turn(1.0, accepts=True)
    assert not rover.guide.guides


def behind_it(rover: Rover, **told: Any) -> Orders:
    rover.plan = {"route_clear": 5.0}
    return rover.turn(CLEAR_FOR + 3 * TURN, **told)


def test_the_mission_has_the_vehicle_again_behind_the_thing() -> None:
    rover = Rover().guided()
    behind_it(rover)
    requests = [orders.request for orders in rover.all if orders.request]
    assert requests[0] == (GUIDED, AUTO)
    assert set(requests[1:-1]) == {(GUIDED, GUIDED)}
    assert requests[-1] == (AUTO, GUIDED)
    rover.guide.answered(GuideAnswer(AUTO, done=True), rover.now)
    rover.turn(0.1)
    rover.turn(mode=AUTO)
    assert rover.state is GuideState.READY
    assert rover.guide.passes


@pytest.mark.parametrize("told", [{"leg": 30.0}, {"leg": -30.0}, {"shows": True}])
def test_it_guides_on_while_the_mission_would_turn_hard_or_something_shows(told: dict[str, Any]) -> None:
    rover = Rover().guided()
    behind_it(rover, **told)
    rover.turn(5.0)
    assert rover.state is GuideState.GUIDING


def test_a_waypoint_that_was_passed_is_set_before_the_mission_goes_on() -> None:
    rover = Rover().guided()
    rover.all.clear()
    behind_it(rover, passed=3)
    assert {orders.item for orders in rover.all} == {None, 3}
    assert not any(orders.request == (AUTO, GUIDED) for orders in rover.all)
    rover.turn(0.6, item=3)
    assert any(orders.request == (AUTO, GUIDED) for orders in rover.all)


def test_a_waypoint_that_is_passed_meanwhile_is_ordered_until_it_shows() -> None:
    rover = Rover().guided()
    behind_it(rover, passed=3)
    rover.turn(0.1, item=3)
    rover.turn(0.6, passed=4)
    assert any(orders.item == 4 for orders in rover.all)
    rover.turn(0.6, item=4)
    assert rover.all[-1].item is None
    assert any(one.request == (AUTO, GUIDED) for one in rover.all)


def test_it_guides_on_to_behind_a_waypoint_that_is_near_but_not_for_long() -> None:
    rover = Rover().guided()
    behind_it(rover, nears=NEARS - 0.1)
    states = [rover.state]
    rover.turn(2 * TURN, nears=NEARS + 0.1)
    assert [*states, rover.state] == [GuideState.GUIDING, GuideState.BACK]
    rover = Rover().guided()
    behind_it(rover, nears=1.0)
    rover.turn(NEARS_FOR)
    assert rover.state is GuideState.BACK


def test_where_only_the_mission_can_go_on_it_has_the_vehicle_at_once_or_the_vehicle_is_stopped() -> None:
    rover = Rover().guided()
    rover.plan = {"route_clear": 5.0}
    rover.turn(3 * TURN, left=3.0)
    assert rover.state is GuideState.BACK
    rover = Rover().guided()
    assert rover.turn(left=0.4) == Orders(STAND)
    rover.turn(1.0)
    assert rover.stuck


def test_a_mission_that_does_not_go_on_stops_the_vehicle() -> None:
    rover = Rover().guided()
    behind_it(rover)
    rover.turn(4.0)
    assert rover.stuck


def test_in_our_hold_it_passes_only_what_three_plans_have_a_way_round() -> None:
    rover = Rover()
    rover.plan = {"route_clear": 1.0, "route_blocked": True, "arcs": (), "clear": 0.0}
    rover.turn(1.0, held=True, mode=HOLD, driven=0.0)
    passes = [rover.guide.passes]
    rover.plan = {"route_clear": 3.0, "route_blocked": True}
    rover.turn(1.0)
    assert [*passes, rover.guide.passes] == [False, True]
    assert not rover.guide.guides


def test_what_stands_right_before_it_keeps_it_in_our_hold_though_the_region_does_not_show_it() -> None:
    rover = Rover()
    rover.plan = {"route_clear": 0.2, "route_blocked": True, "arcs": (), "clear": 0.0}
    rover.turn(1.0, held=True, mode=HOLD, driven=0.0)
    assert rover.stuck.startswith("no way")
    rover.plan = {"route_clear": 2.0, "route_blocked": True, "arcs": (), "clear": 0.0}
    rover.turn()
    assert rover.stuck == ""


def test_so_does_what_has_a_way_round_it_that_is_too_short_to_take_over() -> None:
    rover = Rover()
    rover.plan = {"route_clear": 0.2, "route_blocked": True, "clear": 0.4}
    rover.turn(1.0, held=True, mode=HOLD, driven=0.0)
    assert rover.stuck.startswith("no way"), "the mission would drive into it"
    rover.plan = {"route_clear": 0.2, "route_blocked": True, "clear": 6.0}
    rover.turn(1.0)
    assert rover.stuck == ""


modes = st.sampled_from([MANUAL, HOLD, AUTO, GUIDED])
steps = st.fixed_dictionaries(
    {
        "mode": modes,
        "allowed": st.booleans(),
        "armed": st.booleans(),
        "held": st.booleans(),
        "asks": st.booleans(),
        "shows": st.booleans(),
        "driven": st.floats(0.0, 2.0),
        "leg": st.sampled_from([None, 0.0, 90.0]),
        "arcs": st.sampled_from([(), AWAY]),
        "clear": st.floats(0.0, 6.0),
        "blocked": st.booleans(),
        "answer": st.sampled_from([None, (GUIDED, True), (GUIDED, False), (GUIDED, None), (AUTO, True)]),
    }
)


@pytest.mark.slow
@given(st.lists(steps, max_size=40))
def test_whatever_happens_it_streams_only_while_it_says_that_it_guides(told: list[dict[str, Any]]) -> None:
    rover = Rover()
    for step in told:
        answer, arcs, clear, blocked = (step.pop(name) for name in ("answer", "arcs", "clear", "blocked"))
        if answer is not None:
            rover.guide.answered(GuideAnswer(*answer), rover.now)
        rover.plan = {"arcs": arcs, "clear": clear, "route_clear": 3.0, "route_blocked": blocked}
        orders = rover.turn(0.2, **step)
        if orders.target is not None or orders.request is not None:
            assert rover.guide.guides
            assert rover.told["mode"] in (AUTO, GUIDED)
            assert rover.told["armed"]
            assert not rover.told["held"]
        if orders.target is not None:
            assert 0.0 <= orders.target.speed <= 1.0
            assert math.isfinite(orders.target.yaw_rate)


def test_a_human_s_auto_that_shows_late_ends_it_for_good() -> None:
    rover = Rover().guided()
    rover.guide.answered(GuideAnswer(GUIDED, done=None), rover.now)
    rover.turn(0.5, mode_at=rover.now - TURN)
    rover.turn(2.0, mode=AUTO, mode_at=rover.now)
    assert not rover.guide.guides


@pytest.mark.parametrize("answer", [GuideAnswer(AUTO, done=False), GuideAnswer(GUIDED, done=True)])
def test_auto_is_a_human_s_once_the_script_says_that_it_was_not_set(answer: GuideAnswer) -> None:
    rover = Rover().guided()
    behind_it(rover)
    rover.plan = {"route_clear": 4.0, "route_blocked": True}
    rover.turn(0.1)
    assert rover.state is GuideState.GUIDING
    rover.guide.answered(answer, rover.now)
    rover.turn(2.0, mode=AUTO)
    assert rover.guide.ended_by == "by hand"
    assert not rover.guide.guides


@pytest.mark.parametrize("told", [{"asks": True}, {"mode_at": None}])
def test_where_it_cannot_be_held_its_targets_end_and_the_script_stops_it(told: dict[str, Any]) -> None:
    rover = Rover().guided()
    rover.all.clear()
    rover.turn(2.0, **told)
    targets = [orders.target for orders in rover.all]
    assert targets[0] == STAND
    assert targets[20:] == [None] * (len(targets) - 20)
