"""Whether the vehicle drives where its camera looks, by its course and heading."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.vehicle.course import ASIDE, BACKWARDS, LASTS, OVER, STALE, WAY, CourseJudge, unknown
from companion.vehicle.state import Vehicle

PERIOD, TURN = 0.5, 0.02
VIEW = 60.0
ANGLE = st.floats(0.0, 360.0)
MOUNT = st.floats(-180.0, 180.0)


def at(
    now: float,
    speed: float,
    course: float | None,
    heading: float | None = 0.0,
    attitude: tuple[float, float, float] | None = None,
    attitude_at: float | None = None,
) -> Vehicle:
    """A report of the autopilot that came at `now`."""
    course = None if course is None else course % 360.0
    heading = None if heading is None else heading % 360.0
    return Vehicle(
        1,
        3,
        10,
        armed=True,
        heard_at=now,
        position=(47.0, 8.0, heading),
        speed=speed,
        position_at=now,
        attitude=attitude,
        attitude_at=attitude_at,
        course=course,
    )


class Drive:
    """Reports every half second, judged fifty times a second."""

    def __init__(self, view: float = VIEW, mount: float = 0.0) -> None:
        self.judge = CourseJudge(mount, view)
        self.now = 100.0
        self.vehicle: Vehicle | None = None
        self.reported_at = -math.inf

    def on(
        self,
        seconds: float,
        speed: float,
        course: float | None,
        heading: float | None = 0.0,
        *,
        drives: bool = True,
        held: bool = False,
        period: float = PERIOD,
    ) -> str:
        """Lets time pass in which this is reported; what stands at its end."""
        for _ in range(round(seconds / TURN)):
            if self.now - self.reported_at >= period - 1e-9:
                self.vehicle, self.reported_at = at(self.now, speed, course, heading), self.now
            self.judge.judge(self.vehicle, self.now, drives=drives, held=held)
            self.now += TURN
        return self.judge.told


@given(ANGLE, MOUNT, st.floats(0.0, 30.0), st.floats(-29.0, 29.0), st.floats(0.1, 2.0))
def test_driving_within_the_view_is_never_a_fault(
    heading: float, mount: float, speed: float, aside: float, period: float
) -> None:
    drive = Drive(mount=mount)
    assert drive.on(3.0, speed, heading + mount + aside, heading, period=period) == ""


@given(ANGLE, ANGLE, st.floats(0.0, BACKWARDS - 0.001))
def test_a_course_at_a_standstill_is_noise(heading: float, course: float, speed: float) -> None:
    assert Drive().on(3.0, speed, course, heading) == ""


@given(ANGLE, MOUNT, st.floats(BACKWARDS + 0.01, 30.0), st.floats(0.1, PERIOD))
def test_reversing_is_a_fault_half_a_second_and_a_metre_after_its_first_report(
    heading: float, mount: float, speed: float, period: float
) -> None:
    drive = Drive(mount=mount)
    after = max(LASTS, WAY / speed)
    assert drive.on(after - 2 * TURN, speed, heading + mount + 180.0, heading, period=period) == ""
    assert drive.on(4 * TURN, speed, heading + mount + 180.0, heading, period=period) != ""


@given(st.floats(0.0, PERIOD), st.floats(0.1, 1.0))
def test_a_rover_that_rolls_back_as_it_stops_at_its_last_waypoint_is_no_fault(
    before: float, period: float
) -> None:
    drive, lasts, most = Drive(), 1.75, 0.64  # 0.7 m, as ArduPilot Rover was seen to do
    assert drive.on(2.0 + before, 1.0, 0.0, period=period) == ""
    for turn in range(round(lasts / TURN)):
        speed = most * math.sin(math.pi * turn * TURN / lasts)
        assert drive.on(TURN, speed, 180.0, period=period) == ""
    assert drive.on(3.0, 0.0, None, period=period) == ""


def test_each_way_begins_with_the_first_report_of_it() -> None:
    drive = Drive()
    for _ in range(5):
        assert drive.on(2.5, 0.35, 180.0) == ""
        assert drive.on(0.5, 0.0, None) == ""


@given(ANGLE, st.floats(ASIDE + 0.01, 30.0), st.floats(31.0, 180.0), st.sampled_from((-1, 1)))
def test_driving_out_of_the_view_is_a_fault(heading: float, speed: float, aside: float, side: int) -> None:
    after = max(LASTS, WAY / speed) + 4 * TURN
    assert Drive().on(after, speed, heading + side * aside, heading) != ""


@given(
    st.lists(
        st.tuples(
            st.floats(0.1, 3.0), st.floats(0.0, 5.0), ANGLE, st.none() | ANGLE, st.booleans(), st.booleans()
        )
    )
)
def test_no_fault_outlives_a_human_s_mode(
    parts: list[tuple[float, float, float, float | None, bool, bool]],
) -> None:
    drive = Drive()
    for seconds, speed, course, heading, drives, held in parts:
        drive.on(seconds, speed, course, heading, drives=drives, held=held)
    assert drive.on(TURN, 2.0, 180.0, drives=False) == ""


@pytest.mark.parametrize(
    ("mount", "course", "told"),
    [
        (0.0, 180.0, "drives backwards"),
        (0.0, 31.0, "drives out of view"),
        (0.0, 330.5, ""),
        (180.0, 180.0, ""),
        (180.0, 0.0, "drives out of view"),
        (-90.0, 270.0, ""),
        (90.0, 180.0, "drives backwards"),
    ],
)
def test_it_is_named_by_the_vehicle_s_nose_and_judged_by_the_camera_s_axis(
    mount: float, course: float, told: str
) -> None:
    assert Drive(mount=mount).on(2.0, 1.0, course) == told


def test_slow_reversing_counts_by_the_speed_along_the_axis() -> None:
    assert Drive().on(3.0, 0.29, 180.0) == ""
    assert Drive().on(3.0, 0.4, 120.0) == "", "0.2 m/s along the axis"
    assert Drive().on(3.0, 0.4, 160.0) == "drives backwards"


def test_neither_limit_of_speed_is_a_fault_itself() -> None:
    assert Drive().on(3.0, BACKWARDS, 180.0) == ""
    assert Drive().on(3.0, ASIDE, 90.0) == ""


def test_without_a_known_view_only_driving_backwards_is_judged() -> None:
    assert Drive(view=0.0).on(3.0, 0.6, 100.0) == ""
    assert Drive(view=0.0).on(3.0, 2.0, 120.0) == "drives backwards"


def test_one_report_is_not_enough() -> None:
    drive = Drive()
    assert drive.on(PERIOD, 2.0, 180.0) == ""
    assert drive.on(PERIOD, 2.0, 0.0) == ""
    assert drive.on(PERIOD, 2.0, 180.0) == ""
    assert drive.on(3.0, 2.0, 0.0) == ""


def test_it_ends_when_it_was_gone_for_a_second() -> None:
    drive = Drive()
    drive.on(2.0, 2.0, 180.0)
    assert drive.on(OVER, 2.0, 0.0) != ""
    assert drive.on(2 * TURN, 2.0, 0.0) == ""


def test_reports_that_go_to_and_fro_neither_begin_nor_end_it() -> None:
    drive = Drive()
    for _ in range(5):
        assert drive.on(PERIOD, 2.0, 180.0) == ""
        assert drive.on(PERIOD, 2.0, 0.0) == ""
    drive.on(2.0, 2.0, 180.0)
    for _ in range(5):
        assert drive.on(PERIOD, 2.0, 0.0) != ""
        assert drive.on(PERIOD, 2.0, 180.0) != ""


def test_an_old_position_begins_and_ends_nothing() -> None:
    drive = Drive()
    assert drive.on(10.0, 2.0, 180.0, period=STALE + 0.2) == ""
    drive.on(2.0, 2.0, 180.0)
    assert drive.on(10.0, 2.0, 0.0, period=STALE + 0.2) != "", "what is not seen is not over"


def test_a_report_is_old_after_a_second_and_a_half_and_not_before() -> None:
    assert unknown(at(10.0, 1.0, 0.0), 10.0 + STALE) == ""
    yawed = at(10.0 + STALE, 1.0, 0.0, None, (0.0, 0.0, 0.0), 10.0)
    assert unknown(yawed, 10.0 + STALE) == ""
    assert unknown(yawed, 10.125 + STALE) == "heading"
    judge = CourseJudge(0.0, VIEW)
    for now in (10.0, 10.0 + STALE):
        told = judge.judge(at(now, 2.0, 180.0), now, drives=True, held=False)
    assert told == "drives backwards", "they follow each other"


def test_a_hold_that_is_not_carried_out_yet_does_not_end_it_either() -> None:
    drive = Drive()
    drive.on(2.0, 2.0, 180.0)
    assert drive.on(3.0, 0.0, 180.0, held=True) == "drives backwards"
    assert drive.on(2 * TURN, 0.0, 180.0) == ""


def test_a_standstill_in_our_hold_does_not_end_it_and_a_go_does() -> None:
    drive = Drive()
    drive.on(2.0, 2.0, 180.0)
    assert drive.on(20.0, 0.0, None, drives=False, held=True) == "drives backwards"
    assert drive.on(TURN, 0.0, None, drives=False) == ""


def test_the_attitude_gives_the_heading_where_the_position_has_none() -> None:
    seen = at(10.0, 2.0, 90.0, None)
    assert unknown(seen, 10.0) == "heading"
    yawed = at(10.0, 2.0, 90.0, None, (0.0, 0.0, 270.0), 10.0)
    assert unknown(yawed, 10.0) == ""
    assert unknown(at(10.0, 2.0, 90.0, None, (0.0, 0.0, 270.0), 8.0), 10.0) == "heading"
    judge = CourseJudge(0.0, VIEW)
    for step in range(3):
        now = 10.0 + step * PERIOD
        told = judge.judge(at(now, 2.0, 90.0, None, (0.0, 0.0, 270.0), now), now, drives=True, held=False)
    assert told == "drives backwards"


def test_without_position_or_heading_nothing_is_judged() -> None:
    assert unknown(None, 0.0) == unknown(at(0.0, 1.0, 0.0), STALE + 0.1) == "position"
    assert Drive().on(5.0, 2.0, 180.0, None) == ""
