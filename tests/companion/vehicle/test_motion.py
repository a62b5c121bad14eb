"""How the vehicle leans against the ground, and where it is: a frame gets what was at its own moment."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.frame import Pose
from companion.vehicle.motion import (
    LONGEST_GAP,
    NEAR_ENOUGH,
    LeanFilter,
    MotionReport,
    Odometry,
    lean_at,
    pose_at,
)

EVERY = 0.25


def leaned(pitches: list[float], every: float = EVERY) -> list[float]:
    """The pitch that is told for reports of these pitches."""
    told = LeanFilter()
    return [told.take(index * every, (pitch, 0.0)).pitch for index, pitch in enumerate(pitches)]


def swing(seconds: float, degrees: float = 2.0) -> list[float]:
    return [degrees * math.sin(math.tau * 0.7 * at * EVERY) for at in range(round(seconds / EVERY))]


def test_a_swing_passes_nearly_whole() -> None:
    reported = swing(60.0)
    errors = [abs(one - other) for one, other in zip(leaned(reported), reported, strict=True)]
    assert sorted(errors[40:])[int(0.9 * len(errors[40:]))] < 0.5


def test_a_slope_on_which_it_stays_is_no_lean() -> None:
    assert leaned([0.0, *[8.0] * 80])[-1] == pytest.approx(0.0, abs=0.05)


def test_the_first_report_and_the_first_after_a_gap_say_nothing() -> None:
    told = LeanFilter()
    assert told.take(100.0, (12.0, -3.0))[1:3] == (0.0, 0.0)
    assert told.take(100.2, (14.0, -3.0)).pitch == pytest.approx(2.0, abs=0.4)
    assert told.take(100.3 + LONGEST_GAP, (9.0, 5.0))[1:3] == (0.0, 0.0)
    assert told.take(90.0, (1.0, 1.0))[1:3] == (0.0, 0.0), "a clock that ran backwards"


def test_a_frame_between_two_reports_gets_the_nearest_one_moved_on_by_its_rate() -> None:
    reports = [MotionReport(1.0, 1.0, -1.0, 4.0, 2.0), MotionReport(1.25, 3.0, 0.0, 8.0, 0.0)]
    assert lean_at(reports, 1.1) == pytest.approx((1.4, -0.8))
    assert lean_at(reports, 1.2) == pytest.approx((2.6, 0.0))
    assert lean_at(reports, 1.3) == pytest.approx((3.4, 0.0))


def test_a_frame_without_a_report_near_it_has_no_lean() -> None:
    assert lean_at([], 1.0) is None
    assert lean_at([MotionReport(1.0, 0.0, 0.0, 0.0, 0.0)], 1.01 + NEAR_ENOUGH) is None
    assert lean_at([MotionReport(1.0, 60.0, 0.0, 0.0, 0.0)], 1.0) is None, "it lies on its side"


def test_at_four_reports_a_second_nine_of_ten_frames_of_a_swing_are_right_to_half_a_degree() -> None:
    told, rate = LeanFilter(), math.tau * 0.7
    reports = [
        told.take(at, (2.0 * math.sin(rate * at), 0.0), (2.0 * rate * math.cos(rate * at), 0.0))
        for at in [EVERY * index for index in range(240)]
    ]
    errors = []
    for index in range(600):
        at = 20.0 + index * 0.061
        lean = lean_at(reports, at)
        assert lean is not None
        errors.append(abs(lean[0] - 2.0 * math.sin(rate * at)))
    assert sorted(errors)[540] < 0.5


@given(st.lists(st.tuples(st.floats(0.0, 5.0), st.floats(-90, 90)), min_size=1, max_size=40))
def test_whatever_is_reported_the_lean_is_no_more_than_twice_the_largest_angle(
    reported: list[tuple[float, float]],
) -> None:
    told, at = LeanFilter(), 0.0
    for after, pitch in reported:
        at += after
        lean = told.take(at, (pitch, -pitch))
        assert abs(lean.pitch) <= 2.0 * max(abs(angle) for _, angle in reported) + 1e-9


def driven(moves: list[tuple[float, float, float | None]], every: float = EVERY) -> list[MotionReport]:
    """The reports of a vehicle that had so much heading, turn rate (both clockwise) and speed."""
    odometry = Odometry()
    return [
        odometry.take(MotionReport(index * every, 0.0, 0.0, 0.0, 0.0), *move)
        for index, move in enumerate(moves)
    ]


@given(speed=st.floats(-2.0, 3.0), rate=st.floats(-40.0, 40.0), start=st.floats(0.0, 360.0, exclude_max=True))
def test_it_drives_an_arc_to_where_the_arc_ends(speed: float, rate: float, start: float) -> None:
    seconds = 4.0
    reports = driven([((start + rate * at * EVERY) % 360.0, rate, speed) for at in range(17)])
    first, last = reports[0].pose, reports[-1].pose
    assert first is not None
    assert last is not None
    turned = math.radians(rate * seconds)
    chord = speed * seconds * (math.sin(turned / 2) / (turned / 2) if abs(turned) > 1e-9 else 1.0)
    middle = math.radians(first.heading) - turned / 2
    assert last.x - first.x == pytest.approx(chord * math.cos(middle), abs=0.05)
    assert last.y - first.y == pytest.approx(chord * math.sin(middle), abs=0.05)
    assert math.remainder(last.heading + start + rate * seconds, 360.0) == pytest.approx(0.0, abs=1e-6)


def test_a_frame_between_two_reports_gets_the_nearest_pose_moved_on_by_its_speed() -> None:
    reports = driven([(0.0, 0.0, 2.0)] * 3)
    assert pose_at(reports, 0.3) == pytest.approx((0.6, 0.0, 0.0))
    assert pose_at(reports, 0.2) == pytest.approx((0.4, 0.0, 0.0))
    assert pose_at(reports, 0.5 + 1.1 * NEAR_ENOUGH) is None
    assert pose_at([], 0.0) is None


def test_without_a_speed_there_is_no_pose() -> None:
    reports = driven([(0.0, 0.0, None)] * 3)
    assert [report.pose for report in reports] == [None] * 3
    assert pose_at(reports, 0.3) is None


@pytest.mark.parametrize(
    ("gap", "heading", "speed"),
    [(1.2, 0.0, 1.0), (-0.5, 0.0, 1.0), (0.25, 40.0, 1.0)],
    ids=["a gap", "a clock that ran backwards", "a heading that the autopilot corrected"],
)
def test_where_it_is_not_known_how_it_moved_it_starts_far_away(
    gap: float, heading: float, speed: float
) -> None:
    odometry = Odometry()
    before = odometry.take(MotionReport(5.0, 0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 1.0).pose
    after = odometry.take(MotionReport(5.0 + gap, 0.0, 0.0, 0.0, 0.0), heading, 0.0, speed).pose
    assert before is not None
    assert after is not None
    assert math.dist(before[:2], after[:2]) > 900.0


def test_however_often_it_starts_anew_it_stays_near_enough_to_be_exact() -> None:
    odometry, before = Odometry(), None
    for number in range(2000):
        pose = odometry.take(MotionReport(2.0 * number, 0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 1.0).pose
        assert pose is not None
        assert abs(pose.x) < 3000.0
        assert before is None or math.dist(before[:2], pose[:2]) > 900.0
        before = pose


def test_after_a_while_without_a_speed_it_starts_far_away() -> None:
    reports = driven([(0.0, 0.0, speed) for speed in (1.0, None, 1.0)])
    before, _, after = (report.pose for report in reports)
    assert before == Pose(0.0, 0.0, 0.0)
    assert after is not None
    assert math.dist(before[:2], after[:2]) > 900.0
