"""Films the simulated field with labels, and tells what a call in it is about."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from anytraverse.assessment import Reason
from anytraverse.evaluation.labels import LabelClasses, Labels
from anytraverse.history import Place
from bench.calls.operators import About
from companion.calls.decisions import Call
from companion.desk.drives.drive import DriveFrame
from companion.desk.tuning.episode import LabelOperator
from companion.sim.field.motion import LEVEL, Tilt
from companion.sim.field.render import LABELS, PinholeCamera
from companion.sim.field.things import KINDS, FieldThing, World
from companion.sim.field.trail import TrailPose

DRIVABLE = ("grass", "dirt path", "gravel")
"""Labels of the simulation that are drivable."""
AHEAD_M = 4.0
"""Metres ahead of the rover: the kind of ground there is the one that it sees."""
_METRES_PER_DEGREE = 111_320.0
_BESIDE = 1.5
"""Radii of a thing within which a box on the ground shows the thing's foot or its shadow."""
_NOWHERE = "beyond the ground"


class FilmedField:
    """A camera in the simulated field. What is asked about a call is about the newest frame.

    surprises: the ids of the things on the way, each with the name before it.
    """

    def __init__(
        self,
        world: World,
        *,
        name: str = "",
        east_m: float = 0.0,
        size: tuple[int, int] = (320, 240),
        drivable: Sequence[str] = DRIVABLE,
    ) -> None:
        """name: begins the ids of what is in it, where there are several worlds. east_m: where it lies.

        drivable: the labels that the operator calls so.
        """
        self.world = world
        self.operator: LabelOperator = _Onlooker(self, drivable)
        self.labels: Labels = np.zeros(size[::-1], np.uint8)
        self.surprises = frozenset(name + thing.id for thing in world.things.values() if thing.surprise)
        self._name, self._east_m = name, east_m
        self._things = dict(world.things)
        self._camera = PinholeCamera(world, *size)
        self._pose = world.trail.pose(world.trail.start)

    def frame(self, pose: TrailPose, at: float, travelled: float, tilt: Tilt = LEVEL) -> DriveFrame:
        """Film a frame. at: seconds. travelled: metres driven. tilt: how the rover leans."""
        self._pose = pose
        image, self.labels = self._camera.render(pose, at, tilt)
        return DriveFrame(f"{self._name}{at:.2f} s", at, lambda: image, self.place(pose), travelled)

    def look_back(self, labels: Labels, pose: TrailPose) -> None:
        """Let an earlier frame be the newest one. pose: where it was taken."""
        self.labels, self._pose = labels, pose

    def place(self, pose: TrailPose) -> Place:
        """Return a pose as the autopilot reports it."""
        return Place(
            pose.y / _METRES_PER_DEGREE,
            (pose.x + self._east_m) / _METRES_PER_DEGREE,
            (90.0 - math.degrees(pose.heading)) % 360.0,
        )

    def put_back(self) -> None:
        """Put all things back that were taken away."""
        self.world.things.update(self._things)
        self.world.revision += 1

    def ahead(self, s: float, within: float) -> FieldThing | None:
        """Return the nearest thing on the way, at most so many metres ahead of s; None without one."""
        trail = self.world.trail
        found = [
            ((trail.nearest(thing.x, thing.y)[0] - s) % trail.length, thing)
            for thing in self.world.things.values()
            if thing.surprise
        ]
        near, thing = min(found, key=lambda one: one[0], default=(math.inf, None))
        return thing if near <= within else None

    def about(self, call: Call, _frame: DriveFrame) -> About:
        """Return the thing, or the patch of ground, and the kind of ground that a call is about."""
        place = None
        if Reason.UNKNOWN_SCENE in call.reasons:
            trail = self.world.trail
            s, _ = trail.nearest(self._pose.x, self._pose.y)
            place = self._name + trail.zone(s + AHEAD_M)
        shown = self.shown(call)
        return None if shown is None else self._name + shown[1], place

    def shown(self, call: Call) -> tuple[str, str] | None:
        """Return the label of what a call asks about, and its id; None where no thing is asked about.

        It is the thing that fills most of the tile or stands beside it, or else the patch of ground.
        """
        if Reason.UNKNOWN_OBJECT not in call.reasons or call.seen is None or call.seen.tile is None:
            return None
        box = call.seen.tile.shown
        rows, columns = np.nonzero(box.mask(*self.labels.shape))
        label = LABELS[int(np.bincount(self.labels[rows, columns]).argmax())]
        own = self.labels[rows, columns] == LABELS.index(label)
        at = float(columns[own].mean()), float(rows[own].mean())
        things = self.world.things.values()
        if label in KINDS:
            _, thing = self._nearest([one for one in things if one.kind == label], at)
            return label, label if thing is None else thing.id
        radii, thing = self._nearest([one for one in things if one.surprise], at)
        if thing is None or radii > _BESIDE:
            return label, self._patch(label, at)
        return thing.kind, thing.id

    def _nearest(
        self, things: Iterable[FieldThing], at: tuple[float, float]
    ) -> tuple[float, FieldThing | None]:
        """Return the thing whose picture is nearest to a pixel (column, row), and how many radii away."""
        lens, found = self._camera.lens, list[tuple[float, FieldThing | None]]()
        for thing in things:
            for height in (0.0, thing.height / 2):
                column, row, depth = lens.project(self._pose, thing.x, thing.y, height)
                if depth > 0:
                    radius = lens.focal * max(thing.radius, thing.length / 2) / depth
                    found.append((math.hypot(column - at[0], row - at[1]) / radius, thing))
        return min(found, key=lambda one: one[0], default=(math.inf, None))

    def _patch(self, label: str, at: tuple[float, float]) -> str:
        """Return the connected patch of ground at a pixel: its kind, its zone and its side of the path."""
        (column, row), lens, pose = at, self._camera.lens, self._pose
        if row < lens.horizon or label == "sky":
            return _NOWHERE
        pixel = int(row) - lens.horizon, int(column)
        ahead, left = float(lens.forward[pixel]), float(lens.left[pixel])
        c, s = math.cos(pose.heading), math.sin(pose.heading)
        along, lateral = self.world.trail.nearest(
            pose.x + ahead * c - left * s, pose.y + ahead * s + left * c
        )
        on_path = abs(lateral) < float(self.world.trail.half_width(np.array(along)))
        side = "path" if on_path else "left" if lateral > 0 else "right"
        return f"{label}, {self.world.trail.zone(along)}, {side}"


class _Onlooker(LabelOperator):
    """An operator who sees the whole frame: what stands beside the tile is named, not the ground below it."""

    def __init__(self, film: FilmedField, drivable: Sequence[str]) -> None:
        super().__init__(LabelClasses(LABELS), lambda _: film.labels, drivable)
        self._film = film

    def asked(self, call: Call, _frame: DriveFrame) -> str | None:
        """Return the label of the unknown thing that is asked about; None without one."""
        shown = self._film.shown(call)
        return None if shown is None else shown[0]


def lap(
    field: FilmedField, *, rate: float, speed: float, metres: float | None = None
) -> Iterator[DriveFrame]:
    """Film a lap of the trail on its centre line at an even speed, or its first metres."""
    trail = field.world.trail
    step = speed / rate
    for number in range(math.ceil((trail.length if metres is None else metres) / step)):
        # times are those of a clock that has run before: 0 stands for none
        yield field.frame(trail.pose(trail.start + number * step), (number + 1) / rate, number * step)
