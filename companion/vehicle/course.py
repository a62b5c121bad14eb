"""Judges whether the vehicle drives where its camera does not look: backwards, or out of the view.

Pure: time is an input. At a standstill a course is only noise, hence the limits of speed.
"""

from __future__ import annotations

import math

from companion.vehicle.state import Vehicle

BACKWARDS = 0.3
"""m/s against the camera's axis above which the vehicle drives backwards."""
ASIDE = 0.5
"""m/s above which a course outside the camera's view counts."""
LASTS = 0.5
"""Seconds for which a report and at least one more must say so until it is a fault."""
WAY = 1.0
"""Metres that it must have driven so until it is a fault: a rover that stops may roll back by less."""
OVER = 1.0
"""Seconds for which reports must say that it is over until the fault ends."""
STALE = 1.5
"""Seconds after which a report is too old to judge by. Positions come every 0.5 s."""


def offset(degrees: float) -> float:
    """Return an angle as the turn of least size, in degrees: [-180, 180]."""
    return math.remainder(degrees, 360.0)


def heading_of(vehicle: Vehicle, now: float) -> float | None:
    """Return the vehicle's heading in degrees clockwise from north; None where it is not known."""
    if vehicle.position is not None and vehicle.position[2] is not None:
        return vehicle.position[2]
    fresh = vehicle.attitude_at is not None and now - vehicle.attitude_at <= STALE
    return vehicle.attitude[2] if vehicle.attitude is not None and fresh else None


def along_nose(vehicle: Vehicle, heading: float, now: float) -> float | None:
    """Return the speed in m/s along a heading, below 0 backwards; None where it is not known."""
    if vehicle.speed is None or vehicle.position_at is None or now - vehicle.position_at > STALE:
        return None
    return vehicle.speed * math.cos(math.radians(heading - (vehicle.course or 0.0)))


def unknown(vehicle: Vehicle | None, now: float) -> str:
    """Say what is not known, so that the course is not judged: "position" or "heading"; "": nothing."""
    if vehicle is None or vehicle.position_at is None or now - vehicle.position_at > STALE:
        return "position"
    if vehicle.position is None or vehicle.speed is None:
        return "position"
    return "heading" if heading_of(vehicle, now) is None else ""


class CourseJudge:
    """Judges the reports of position and heading while the autopilot drives.

    told: the fault in two or three words, "" for none.
    """

    def __init__(self, mount: float, view: float) -> None:
        """mount: degrees clockwise from the nose at which the camera looks.

        view: its horizontal field of view in degrees, 0: unknown. Then only driving backwards is judged.
        """
        self._mount = mount
        self._aside = view / 2.0 if view > 0.0 else 180.0
        self.told = ""
        self._newest: float | None = None
        self._wrong, self._reports, self._since = "", 0, math.inf
        self._way = self._speed = 0.0
        """Metres from the first of these reports to the newest one, and its speed."""

    def judge(self, vehicle: Vehicle | None, now: float, *, drives: bool, held: bool) -> str:
        """Return the fault that stands now, see `told`.

        drives: whether the autopilot drives by itself; a human may reverse. held: whether our hold waits for
        an answer. Standing still in it does not end the fault: what the vehicle would do next is the same.
        """
        if not drives or unknown(vehicle, now):
            self._forget()
            if not drives and not held:
                self.told = ""
            return self.told
        assert vehicle is not None
        assert vehicle.position_at is not None
        if vehicle.position_at != self._newest:
            self._take(vehicle, now, vehicle.position_at)
        for_long = now - self._since >= (LASTS if self._wrong else OVER) and self._reports >= 2
        if for_long and self._wrong:
            if self._way + self._speed * (now - vehicle.position_at) >= WAY:
                self.told = self.told or self._wrong
        elif for_long and not held:
            self.told = ""
        return self.told

    def _take(self, vehicle: Vehicle, now: float, at: float) -> None:
        """Take a report that came at `at`. Reports that follow each other and say the same are counted."""
        wrong, before = self._name(vehicle, now), self._newest
        if before is not None and at - before <= STALE and bool(wrong) == bool(self._wrong):
            self._reports += 1
            self._way += self._speed * (at - before)
        else:
            self._reports, self._since, self._way = 1, now, 0.0
        self._wrong, self._newest, self._speed = wrong, at, vehicle.speed or 0.0

    def _name(self, vehicle: Vehicle, now: float) -> str:
        """Name what is wrong with a report, "" for nothing."""
        heading, speed, course = heading_of(vehicle, now), vehicle.speed, vehicle.course
        if heading is None or speed is None or course is None:
            return ""
        aside = abs(offset(course - heading - self._mount))
        if speed * math.cos(math.radians(aside)) >= -BACKWARDS and not (
            speed > ASIDE and aside > self._aside
        ):
            return ""
        return "drives backwards" if abs(offset(course - heading)) > 90.0 else "drives out of view"

    def _forget(self) -> None:
        """Forget the reports; the fault stays."""
        self._wrong, self._reports, self._since, self._newest = "", 0, math.inf, None
