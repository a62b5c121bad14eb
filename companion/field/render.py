"""A camera on the simulated rover: frames of the world with true labels, the same for the same moment."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from companion.field import backdrop, sprites
from companion.field.backdrop import Backdrop
from companion.field.ground import Ground
from companion.field.things import KINDS, Thing, World
from companion.field.trail import Pose
from companion.field.verge import Verge

LABELS = ("sky", "grass", "dirt path", "gravel", "bush", "tree", "puddle", "drum", "rock", "log")

HEIGHT = 1.0  # m of the lens above the ground
PITCH = math.radians(7.0)  # the axis below the horizon
FIELD_OF_VIEW = math.radians(75.0)  # horizontal
FAR = 48.0  # m, beyond which things are too small to draw
NEAR = 0.35  # m
VISIBILITY = 85.0  # m at which haze has taken 63 % of a colour
_THING_LABELS = {kind: LABELS.index(kind) for kind in KINDS} | {"tuft": LABELS.index("grass")}
_GROUND_LABELS = np.array([LABELS.index(name) for name in ("grass", "dirt path", "gravel")], np.uint8)

Bytes = NDArray[np.uint8]


class Camera:
    """A pinhole camera that looks along a rover's heading, slightly down, from HEIGHT metres."""

    def __init__(self, world: World, width: int = 320, height: int = 240, seed: int = 0) -> None:
        if not (16 <= width <= 4096 and 16 <= height <= 4096):
            raise ValueError(
                f"frames of {width} x {height} cannot be rendered: give 16 to 4096 pixels a side"
            )
        self.world, self.width, self.height, self._seed = world, width, height, seed
        self.focal = width / 2 / math.tan(FIELD_OF_VIEW / 2)  # pixels
        across = (np.arange(width) + 0.5 - width / 2) / self.focal
        down = (np.arange(height) + 0.5 - height / 2) / self.focal
        forward = math.cos(PITCH) - down * math.sin(PITCH)
        drop = math.sin(PITCH) + down * math.cos(PITCH)
        self.horizon = int(np.count_nonzero(drop <= 0))  # the first row of ground
        ground = slice(self.horizon, height)
        steep = np.maximum(drop[ground], 1 / 300)
        depth = HEIGHT / steep
        shape = (height - self.horizon, width)
        self._forward = np.broadcast_to((forward[ground] * depth)[:, None], shape).astype(np.float32)
        self._left = (-across[None, :] * depth[:, None]).astype(np.float32)
        footprint = np.sqrt(depth / self.focal * depth**2 / (HEIGHT * self.focal))
        self._ground = Ground(
            world, self._forward, self._left, np.broadcast_to(footprint[:, None], shape).astype(np.float32)
        )
        self._foot = min(height, self.horizon + round(self.focal * 1.3 * HEIGHT / backdrop.NEAREST_FOOT))
        above = slice(0, self._foot)
        azimuth = np.arctan2(-across[None, :], forward[above, None])
        elevation = np.arctan2(-drop[above, None], np.hypot(across[None, :], forward[above, None]))
        self._backdrop = Backdrop(
            world.seed,
            azimuth.astype(np.float32),
            elevation.astype(np.float32),
            (LABELS.index("sky"), LABELS.index("tree")),
        )
        self._clear = clear = np.exp(-np.minimum(np.hypot(self._forward, self._left), FAR) / VISIBILITY)
        self._haze = ((1 - clear)[..., None] * np.asarray(backdrop.HAZE)).astype(np.uint8)
        self._verge = Verge(world)
        self._sprites: dict[tuple[str, int], sprites.Sprite] = {}
        rng = np.random.default_rng([seed, 40])
        grain = rng.normal(0, 2.6, (height + 64, width + 64, 3))
        self._grain = np.clip(np.round(grain), -127, 127).astype(np.int8)
        self._phase = rng.uniform(0, 2 * math.pi, 3)

    def render(self, pose: Pose, t: float) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """The frame at a pose and time t in s: RGB (H, W, 3) and labels (H, W), indices into LABELS."""
        import cv2

        frame = np.empty((self.height, self.width, 3), np.uint8)
        labels = np.empty((self.height, self.width), np.uint8)
        colours, kinds, light = self._ground.look(pose)
        scale = np.clip(light * self._clear * 128, 0, 255).astype(np.uint8)
        lit = cv2.multiply(np.ascontiguousarray(colours), cv2.merge([scale, scale, scale]), scale=1 / 128)
        frame[self.horizon :] = cv2.add(lit, self._haze)
        labels[self.horizon :] = _GROUND_LABELS[kinds]
        self._backdrop.paint(frame[: self._foot], labels[: self._foot], pose, t, self._ground)

        things = [*self.world.things.values(), *self._verge.near(pose)]
        seen = sorted(
            ((self._ahead(pose, thing), thing) for thing in things), key=lambda at: -math.hypot(*at[0])
        )
        seen = [(at, thing) for at, thing in seen if self._in_view(at, thing)]
        for at, thing in seen:
            if thing.kind == "puddle":
                self._draw_puddle(frame, labels, thing, at)
        for at, thing in seen:
            if thing.kind != "puddle":
                self._draw_thing(frame, labels, thing, at, pose)
        blurred = np.asarray(cv2.GaussianBlur(frame, (3, 3), 0.55), np.uint8)
        return self._expose(blurred, t), labels

    def distance_ahead(self, row: int) -> float:
        """How far ahead (m) the level ground in this row is; infinite above the horizon."""
        return (
            math.inf
            if row < self.horizon
            else float(self._forward[min(row, self.height - 1) - self.horizon, 0])
        )

    def project(self, pose: Pose, x: float, y: float, z: float = 0.0) -> tuple[float, float, float]:
        """Where a point (m) falls: column and row in pixels, and its depth in m (not in view when <= 0)."""
        dx, dy = x - pose.x, y - pose.y
        c, s = math.cos(pose.heading), math.sin(pose.heading)
        ahead, left, drop = dx * c + dy * s, dy * c - dx * s, HEIGHT - z
        depth = ahead * math.cos(PITCH) + drop * math.sin(PITCH)
        if depth <= 0:
            return math.nan, math.nan, depth
        down = drop * math.cos(PITCH) - ahead * math.sin(PITCH)
        return self.width / 2 - self.focal * left / depth, self.height / 2 + self.focal * down / depth, depth

    def light_at(self, t: float) -> float:
        """The light at time t: the slow change of a day with clouds, times the world's own."""
        a, b, _ = self._phase
        return self.world.light * (
            1 + 0.09 * math.sin(t * 2 * math.pi / 75 + a) + 0.05 * math.sin(t * 2 * math.pi / 21 + b)
        )

    def _ahead(self, pose: Pose, thing: Thing) -> tuple[float, float]:
        dx, dy = thing.x - pose.x, thing.y - pose.y
        c, s = math.cos(pose.heading), math.sin(pose.heading)
        return dx * c + dy * s, dy * c - dx * s

    def _in_view(self, at: tuple[float, float], thing: Thing) -> bool:
        reach = max(thing.radius * (6 if thing.kind == "tree" else 1.2), thing.length / 2)
        return NEAR < at[0] < FAR and abs(at[1]) - reach * 1.3 < at[0] * self.width / 2 / self.focal

    def _draw_puddle(
        self, frame: NDArray[np.uint8], labels: NDArray[np.uint8], thing: Thing, at: tuple[float, float]
    ) -> None:
        """Water that mirrors the backdrop, in a wet rim, ragged at the shore."""
        found = np.flatnonzero(np.abs(self._forward[:, 0] - at[0]) < thing.radius * 1.4)
        if len(found) == 0:
            return
        rows = slice(found[0], found[-1] + 1)
        x, y = self._ground.points
        x, y = x[rows] - np.float32(thing.x), y[rows] - np.float32(thing.y)
        angle = np.arctan2(y, x)
        shore = thing.radius * (
            1 - 0.12 * (1 + np.sin(3 * angle + thing.look)) / 2 - 0.08 * (1 + np.sin(5 * angle)) / 2
        )
        out = np.hypot(x, y) / shore
        water, rim = out < 1, out < 1.18
        picture = frame[self.horizon :][rows]
        mirror = np.clip(self.horizon - 1 - np.arange(rows.start, rows.stop), 0, max(0, self.horizon - 1))
        sky = frame[mirror].astype(np.float32) * 0.62 + np.array([58, 64, 70], np.float32)
        picture[rim] = (picture[rim] * 0.72).astype(np.uint8)
        picture[water] = sky[water].astype(np.uint8)
        labels[self.horizon :][rows][water] = LABELS.index("puddle")

    def _draw_thing(
        self, frame: Bytes, labels: Bytes, thing: Thing, at: tuple[float, float], pose: Pose
    ) -> None:
        """A picture that faces the camera, over what is behind it."""
        column, foot, depth = self.project(pose, thing.x, thing.y)
        if depth < NEAR:
            return
        width = 2 * thing.radius
        if thing.length:
            turn = thing.heading - math.atan2(thing.y - pose.y, thing.x - pose.x)
            width += (thing.length - width) * abs(math.sin(turn))
        pixels = self.focal / depth
        sprite = self._sprite(thing.kind, thing.look % sprites.looks(thing.kind))
        drawn = sprite.draw(
            frame,
            (column, foot + 0.02 * pixels),
            (width * pixels, thing.height * pixels),
            self._shade_of(thing),
            backdrop.HAZE,
            _clear(math.hypot(*at)),
        )
        if drawn:
            where, opacity = drawn
            labels[where][opacity > 127] = _THING_LABELS[thing.kind]

    def _sprite(self, kind: str, look: int) -> sprites.Sprite:
        if (kind, look) not in self._sprites:
            self._sprites[kind, look] = sprites.paint(kind, look, self.world.seed)
        return self._sprites[kind, look]

    def _shade_of(self, thing: Thing) -> float:
        forest, _ = self._ground.shares(
            np.full((1, 1), thing.x, np.float32), np.full((1, 1), thing.y, np.float32)
        )
        return 1.0 - 0.3 * float(forest[0, 0])

    def _expose(self, frame: NDArray[np.uint8], t: float) -> NDArray[np.uint8]:
        """Light and its colour as a curve with a soft shoulder, then the sensor's noise of this moment."""
        import cv2

        warmth = 0.02 * math.sin(t * 2 * math.pi / 60 + self._phase[2])
        gain = self.light_at(t) ** 0.75 * np.array([1 + warmth, 1.0, 1 - warmth])
        x = np.arange(256)[:, None] / 255 * gain
        curve = np.where(x < 0.8, x, 0.8 + 0.2 * np.tanh((x - 0.8) / 0.2)) * 255
        lit = cv2.LUT(frame, curve.astype(np.uint8)[:, None, :])
        rng = np.random.default_rng([self._seed, round(abs(t) * 1000), int(t < 0)])
        y, x0 = rng.integers(0, 64, 2)
        grain = self._grain[y : y + self.height, x0 : x0 + self.width]
        return np.asarray(cv2.add(lit, grain, dtype=cv2.CV_8U), np.uint8)


def _clear(distance: float) -> float:
    """How much of a colour the air lets through."""
    return math.exp(-min(distance, FAR) / VISIBILITY)
