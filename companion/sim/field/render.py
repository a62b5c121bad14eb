"""Renders the frames of the rover's camera with true labels; the same moment gives the same frame."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.sim.field import backdrop, sprites
from companion.sim.field.backdrop import Backdrop, Outlook
from companion.sim.field.ground import Footing, Ground
from companion.sim.field.lens import STANDARD, LensMount, SimulatedLens, relative
from companion.sim.field.motion import LEVEL, Tilt
from companion.sim.field.sensor import Sensor
from companion.sim.field.sprites import Tufts
from companion.sim.field.things import KINDS, FieldThing, World
from companion.sim.field.trail import TrailPose
from companion.sim.field.view import View

Bytes = NDArray[np.uint8]
Seen = tuple[FieldThing, float, float]  # a thing, metres ahead, metres to the left

LABELS = ("sky", "grass", "dirt path", "gravel", "bush", "tree", "puddle", "drum", "rock", "log")

GROUND_KINDS = ("grass", "dirt path", "gravel")
"""The labels of drivable ground."""

NEAR, FAR = 0.35, 48.0  # m ahead; things between these distances are drawn
VISIBILITY = 85.0  # m at which haze has taken 63 % of a colour
_GROUND_LABELS = np.array([LABELS.index(name) for name in GROUND_KINDS], np.uint8)
_THING_LABELS = {kind: LABELS.index(kind) for kind in KINDS} | {"tuft": LABELS.index("grass")}
_CROWN = 7.0  # half the width of a tree's crown, in radii of its trunk


class _Scene(NamedTuple):
    """A view, and what is the same in all frames of it."""

    view: View
    footing: Footing
    clear: NDArray[np.float32]
    haze: Bytes
    foot: int  # rows that the backdrop may cover
    outlook: Outlook


class PinholeCamera:
    """A camera that looks along a rover's heading, slightly down; a pinhole without k1.

    Every pixel has the label of the nearest thing that it shows. A forest's floor and the tufts at the verge
    are labelled "grass", woods in the distance "tree". `lens` is that of a level rover, without distortion.
    """

    def __init__(
        self,
        world: World,
        width: int = 320,
        height: int = 240,
        seed: int = 0,
        k1: float = 0.0,
        mount: LensMount = STANDARD,
    ) -> None:
        """k1: of OpenCV's radial distortion, as of `View`."""
        if not (16 <= width <= 4096 and 16 <= height <= 4096):
            raise ValueError(f"no frames of {width} x {height}: give 16 to 4096 pixels a side")
        self.world, self.width, self.height = world, width, height
        self.lens = SimulatedLens(width, height, mount)
        self._k1 = k1
        self._sensor = Sensor(width, height, seed)
        self._ground = Ground(world)
        self._backdrop = Backdrop(world.seed, (LABELS.index("sky"), LABELS.index("tree")))
        self._verge = Tufts(world)
        self._scene = LEVEL, self._look(LEVEL)

    def render(
        self, pose: TrailPose, t: float, tilt: Tilt = LEVEL
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Renders the frame at a rover's pose, time t in s and tilt.

        Returns RGB (H, W, 3) uint8 and labels (H, W) uint8, indices into LABELS.
        """
        import cv2

        if tilt != self._scene[0]:
            self._scene = tilt, self._look(tilt)
        scene = self._scene[1]
        lens, pose = scene.view.lens, TrailPose(pose.x, pose.y, pose.heading + scene.view.yaw)
        picture = np.empty((lens.height, lens.width, 3), np.uint8)
        labels = np.empty((lens.height, lens.width), np.uint8)
        if lens.horizon < lens.height:
            self._draw_ground(picture[lens.horizon :], labels[lens.horizon :], scene, pose)
        above = slice(0, scene.foot)
        self._backdrop.paint(picture[above], labels[above], scene.outlook, pose, t, self._ground)
        for thing, ahead, left in self._in_view(lens, pose):
            if thing.kind == "puddle":
                self._draw_puddle(picture, labels, lens, thing, ahead)
            else:
                self._draw_thing(picture, labels, lens, thing, pose, math.hypot(ahead, left))
        if scene.view.table is not None:
            picture = np.asarray(cv2.remap(picture, *scene.view.table, cv2.INTER_LINEAR), np.uint8)
            labels = np.asarray(cv2.remap(labels, *scene.view.table, cv2.INTER_NEAREST), np.uint8)
        soft = np.asarray(cv2.GaussianBlur(picture, (3, 3), 0.55), np.uint8)
        return self._sensor.expose(soft, self.world.light, t), labels

    def view(self, tilt: Tilt = LEVEL) -> View:
        """Returns the geometry of the frames of a tilt."""
        return View(self.width, self.height, tilt, self._k1, self.lens.mount)

    def distance_ahead(self, row: int) -> float:
        """Returns how far ahead (m) of a level rover the ground in the middle of a picture's row is.

        It is infinite above the horizon.
        """
        ahead = float(self.view().where()[0][min(row, self.height - 1), self.width // 2])
        return math.inf if math.isnan(ahead) else ahead

    def _look(self, tilt: Tilt) -> _Scene:
        view = self.view(tilt)
        lens = view.lens
        clear = _clear(np.hypot(lens.forward, lens.left))
        lost, haze = (1 - clear).astype(np.float64), np.empty((*clear.shape, 3), np.uint8)
        for channel, colour in enumerate(backdrop.HAZE):
            haze[..., channel] = lost * colour
        foot = lens.horizon + round(lens.focal * 1.3 * lens.mount.height / backdrop.NEAREST_FOOT)
        foot = min(lens.height, max(2, foot))
        return _Scene(view, self._ground.footing(lens), clear, haze, foot, Outlook(*lens.directions(foot)))

    def _in_view(self, lens: SimulatedLens, pose: TrailPose) -> list[Seen]:
        """Returns the things that may be visible in drawing order: puddles first, then from far to near."""
        slope = lens.width / 2 / lens.focal
        seen: list[Seen] = []
        for thing in [*self.world.things.values(), *self._verge.near(pose)]:
            ahead, left = relative(pose, thing.x, thing.y)
            reach = max(thing.radius * (_CROWN if thing.kind == "tree" else 1.5), thing.length / 2)
            if NEAR < ahead < FAR and abs(left) < ahead * slope + reach * 1.3:
                seen.append((thing, ahead, left))
        return sorted(seen, key=lambda one: (one[0].kind != "puddle", -math.hypot(one[1], one[2])))

    def _draw_ground(self, picture: Bytes, labels: Bytes, scene: _Scene, pose: TrailPose) -> None:
        import cv2

        colours, kinds, light = self._ground.look(pose, scene.footing)
        scale = np.clip(light * scene.clear * 128, 0, 255).astype(np.uint8)
        lit = cv2.multiply(np.ascontiguousarray(colours), cv2.merge([scale, scale, scale]), scale=1 / 128)
        picture[:] = cv2.add(lit, scene.haze)
        labels[:] = _GROUND_LABELS[kinds]

    def _draw_puddle(
        self, picture: Bytes, labels: Bytes, lens: SimulatedLens, thing: FieldThing, ahead: float
    ) -> None:
        """Draws water that mirrors the backdrop, with a wet rim and a ragged shore."""
        found = np.flatnonzero(np.abs(lens.forward[:, 0] - ahead) < thing.radius * 1.4)
        if len(found) == 0:
            return
        rows = slice(found[0], found[-1] + 1)
        x, y = (
            at[rows] - np.float32(centre)
            for at, centre in zip(self._ground.points, (thing.x, thing.y), strict=True)
        )
        angle = np.arctan2(y, x)
        shore = 0.9 + 0.06 * np.sin(3 * angle + thing.look) + 0.04 * np.sin(5 * angle)
        out = np.hypot(x, y) / (shore * thing.radius)
        water, rim = out < 1, out < 1.18
        mirror = np.clip(lens.horizon - 1 - np.arange(rows.start, rows.stop), 0, max(0, lens.horizon - 1))
        sheen = picture[mirror].astype(np.float32) * 0.62 + np.array([58, 64, 70], np.float32)
        under = picture[lens.horizon :][rows]
        under[rim] = (under[rim] * 0.72).astype(np.uint8)
        under[water] = sheen[water].astype(np.uint8)
        labels[lens.horizon :][rows][water] = _THING_LABELS["puddle"]

    def _draw_thing(
        self,
        picture: Bytes,
        labels: Bytes,
        lens: SimulatedLens,
        thing: FieldThing,
        pose: TrailPose,
        distance: float,
    ) -> None:
        """Draws a thing's sprite, which always faces the camera, over what is behind it."""
        column, foot, depth = lens.project(pose, thing.x, thing.y)
        if depth < NEAR:
            return
        width = 2 * thing.radius
        if thing.length:
            turn = thing.heading - math.atan2(thing.y - pose.y, thing.x - pose.x)
            width += (thing.length - width) * abs(math.sin(turn))
        pixels = lens.focal / depth
        at, size = (column, foot + 0.02 * pixels), (width * pixels, thing.height * pixels)
        light = self._ground.light_on(thing.x, thing.y)
        drawn = sprites.paint(thing.kind, thing.look, self.world.seed).draw(
            picture, at, size, light, backdrop.HAZE, float(_clear(np.float32(distance)))
        )
        if drawn:
            where, opacity = drawn
            labels[where][opacity > 127] = _THING_LABELS[thing.kind]


def _clear(distance: NDArray[np.float32] | np.float32) -> NDArray[np.float32]:
    """Returns the share (0..1) of a colour that the air lets through from a distance in m."""
    return np.asarray(np.exp(-np.minimum(distance, FAR) / VISIBILITY), np.float32)
