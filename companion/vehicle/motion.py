"""Calculates how the vehicle leans against its ground, and where it is by odometry, at the time of a frame.

ATTITUDE counts from the horizon. A slope leans vehicle and ground alike, and the camera sees the ground as
before; a swing or a bump leans only the vehicle. So the slow part of the angles is taken out by a high-pass
filter of the first order. Odometry adds up speed and heading. It drifts, but unlike a position by GNSS it
does not jump: it serves for seconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from anytraverse.frame import Pose

SETTLES = 1.0
"""Seconds: the filter's time constant. Of a rover's swing, at 0.7 Hz, 98 % pass, 13 degrees early.

With less the swing is told worse, with more a slope that begins is taken for it: docs/ground.md has figures.
"""
LONGEST_GAP = 2.0
"""Seconds without a report after which the filter starts anew."""
NEAR_ENOUGH = 0.3
"""Seconds between a frame and the nearest report, at most: reports come every 0.25 s."""

LARGEST_LEAN = 45.0
"""Degrees. A vehicle that leans by more lies on its side: where the ground is, is not known then."""
_LONGEST_STEP = 1.0
"""Seconds between two reports over which speed and heading are added up."""
_HEADING_RESET = 15.0
"""Degrees by which the heading differs from what the turn rates say where the autopilot has corrected it."""
_APART = 1000.0
"""m between a pose and the next one where the odometry starts anew, so that nobody takes them for near."""


class MotionReport(NamedTuple):
    """How the vehicle leans, and how it moves.

    at: seconds of the link's monotonic clock. pitch, bank: degrees against the ground; nose up and right
    side down are positive. pitch_rate, bank_rate: degrees/s.
    pose: None where no speed is known. speed: m/s along the nose, below 0 backwards. yaw_rate: degrees/s,
    counter-clockwise.
    """

    at: float
    pitch: float
    bank: float
    pitch_rate: float
    bank_rate: float
    pose: Pose | None = None
    speed: float = 0.0
    yaw_rate: float = 0.0


class LeanFilter:
    """Takes the slow part out of the reported angles."""

    def __init__(self) -> None:
        self._at = -math.inf
        self._slow = (0.0, 0.0)

    def take(
        self, at: float, angles: tuple[float, float], rates: tuple[float, float] = (0.0, 0.0)
    ) -> MotionReport:
        """Take pitch and bank in degrees, and their rates; return how the vehicle leans.

        The first report after a gap says nothing about the ground: the vehicle counts as not leaning.
        """
        passed, self._at = at - self._at, at
        follows = 1.0 - math.exp(-passed / SETTLES) if 0.0 <= passed <= LONGEST_GAP else 1.0
        slow = [slow + follows * (angle - slow) for slow, angle in zip(self._slow, angles, strict=True)]
        self._slow = (slow[0], slow[1])
        return MotionReport(at, angles[0] - slow[0], angles[1] - slow[1], *rates)


def lean_at(reports: Iterable[MotionReport], at: float) -> tuple[float, float] | None:
    """Return pitch and bank at a time from the nearest report and its rate; None where none is near."""
    nearest = min(reports, key=lambda report: abs(report.at - at), default=None)
    if nearest is None or abs(nearest.at - at) > NEAR_ENOUGH:
        return None
    since = at - nearest.at
    pitch, bank = nearest.pitch + since * nearest.pitch_rate, nearest.bank + since * nearest.bank_rate
    return (pitch, bank) if max(abs(pitch), abs(bank)) <= LARGEST_LEAN else None


class Odometry:
    """Adds up speed and heading to a pose, from report to report.

    It starts anew, `_APART` m away, where it is not known how the vehicle moved meanwhile.
    """

    def __init__(self) -> None:
        self._last: MotionReport | None = None
        self._x = -_APART
        """Of the newest pose."""

    def take(
        self, report: MotionReport, heading: float, yaw_rate: float, speed: float | None
    ) -> MotionReport:
        """Return the report with a pose. heading, yaw_rate: degrees and degrees/s, clockwise.

        speed: m/s along the nose, None: not known. Then there is no pose.
        """
        last = self._last
        if speed is None:
            self._last = None
            return report
        moved = report._replace(speed=speed, yaw_rate=-yaw_rate)
        pose = None if last is None else self._next(last, moved, -heading)
        if pose is None:
            # The other way than the last time, so that it stays near enough to be exact.
            pose = Pose(self._x - math.copysign(_APART, self._x), 0.0, -heading)
        self._x, self._last = pose.x, moved._replace(pose=pose)
        return self._last

    @staticmethod
    def _next(last: MotionReport, report: MotionReport, heading: float) -> Pose | None:
        """Return the pose that follows, None where it is not known how the vehicle moved from the last."""
        assert last.pose is not None
        passed = report.at - last.at
        if not 0.0 <= passed <= _LONGEST_STEP:
            return None
        turned = math.remainder(heading - last.pose.heading, 360.0)
        expected = passed * (last.yaw_rate + report.yaw_rate) / 2.0
        if abs(turned - expected) > _HEADING_RESET:
            return None
        return moved(last.pose, passed * (last.speed + report.speed) / 2.0, turned)


def pose_at(reports: Iterable[MotionReport], at: float) -> Pose | None:
    """Return the pose at a time from the nearest report and its speed; None where none is near."""
    known = (report for report in reports if report.pose is not None)
    nearest = min(known, key=lambda report: abs(report.at - at), default=None)
    if nearest is None or nearest.pose is None or abs(nearest.at - at) > NEAR_ENOUGH:
        return None
    since = at - nearest.at
    return moved(nearest.pose, since * nearest.speed, since * nearest.yaw_rate)


def moved(pose: Pose, way: float, turned: float) -> Pose:
    """Return the pose `way` m farther, where the heading turns by so many degrees on an arc meanwhile.

    way: along the arc's chord; over one report it is as long as the arc.
    """
    middle = math.radians(pose.heading + turned / 2.0)
    return Pose(
        pose.x + way * math.cos(middle), pose.y + way * math.sin(middle), (pose.heading + turned) % 360.0
    )
