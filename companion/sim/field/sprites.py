"""Paints the pictures of things when they are first seen, keeps them at every scale and draws them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from companion.sim.field.things import FieldThing, World
from companion.sim.field.tiles import Bytes, Colour, blank, noise
from companion.sim.field.trail import ZONES, TrailPose

Picture = tuple[Bytes, float, float]  # RGBA; its width in diameters of the thing, its height in heights of it


def _foliage(
    rng: np.random.Generator,
    picture: Bytes,
    clumps: NDArray[np.float64],
    leaves: int,
    dark: Colour,
    bright: Colour,
    size: tuple[float, float],
) -> None:
    """Paints leaves in clumps (x, y, radius in pixels), from inside out, brighter at a clump's upper left."""
    import cv2

    weights = clumps[:, 2] ** 2 / (clumps[:, 2] ** 2).sum()
    clump = clumps[rng.choice(len(clumps), leaves, p=weights)]
    angle, reach = rng.uniform(0, 2 * np.pi, leaves), np.sqrt(rng.uniform(0, 1, leaves))
    dx, dy = np.cos(angle) * reach, np.sin(angle) * reach
    light = np.clip(0.45 - 0.25 * dx - 0.4 * dy + rng.normal(0, 0.17, leaves), 0, 1)
    light *= 1 - 0.35 * clump[:, 1] / picture.shape[0]
    order = np.argsort(reach * 0.3 + light + rng.uniform(0, 0.5, leaves))
    colours = np.asarray(dark) + light[:, None] * (np.asarray(bright) - np.asarray(dark))
    for i in order:
        centre = int(clump[i, 0] + dx[i] * clump[i, 2]), int(clump[i, 1] + dy[i] * clump[i, 2])
        long = rng.uniform(*size)
        colour = (*(int(c) for c in colours[i]), 255)
        cv2.ellipse(
            picture, centre, (int(long), int(long * 0.55) + 1), float(rng.uniform(0, 180)), 0, 360, colour, -1
        )


def bush(rng: np.random.Generator, look: int) -> Picture:
    picture = blank(224, 256)
    x, y = rng.uniform(50, 206, 9), rng.uniform(70, 190, 9)
    y += np.abs(x - 128) * 0.25
    clumps = np.stack([x, np.minimum(y, 180), rng.uniform(28, 48, 9)], axis=1)
    clumps = np.vstack([clumps, [[128, 150, 68], [84, 176, 44], [172, 176, 44]]])
    bright = ((96, 128, 62), (84, 120, 52), (118, 136, 66), (78, 112, 60))[look]
    _foliage(rng, picture, clumps, 1500, (18, 32, 16), bright, (3.0, 7.0))
    return picture, 1.15, 1.05


def tree(rng: np.random.Generator, look: int) -> Picture:
    """Paints a trunk, whose foot is a tenth of the picture's width wide, and a crown above it."""
    import cv2

    rows, columns = 640, 320
    picture = blank(rows, columns)
    bark = ((84, 70, 56), (98, 88, 76), (70, 58, 46), (110, 98, 84), (90, 78, 66))[look]
    lean = rng.uniform(-12, 12)
    foot, top = np.array([160.0, rows - 1]), np.array([160.0 + lean, 150.0])
    outline = np.array(
        [foot - (15, 0), foot - (10, 40), top - (4, 0), top - (-4, 0), foot - (-10, 40), foot - (-15, 0)]
    )
    cv2.fillPoly(picture, [outline.astype(np.int32)], (*bark, 255))
    for _ in range(7):
        start = foot + (top - foot) * rng.uniform(0.4, 0.9)
        end = start + np.array([rng.choice([-1, 1]) * rng.uniform(40, 100), -rng.uniform(30, 90)])
        cv2.line(
            picture, tuple(map(int, start)), tuple(map(int, end)), (*(int(c * 0.8) for c in bark), 255), 4
        )
    across = np.clip((np.arange(columns) - 160) / 16, -1, 1)[None, :, None]
    grain = (
        noise(rng, rows, columns, 2, 60)[..., None] * 0.1
        + noise(rng, 1, columns, 2, 8)[0][None, :, None] * 0.14
    )
    shaded = picture[..., :3] * np.clip(1 - 0.35 * across + grain, 0.4, 1.5)
    picture[..., :3] = np.clip(shaded, 0, 255).astype(np.uint8)

    count = 22
    low = (330, 290, 390, 270, 350)[look]
    y = rng.uniform(46, low, count)
    spread = 24 + 84 * np.sin(np.clip((y - 10) / (low + 30), 0, 1) * np.pi) ** 0.8
    clumps = np.stack(
        [160 + lean + rng.uniform(-1, 1, count) * spread, y, rng.uniform(20, 50, count)], axis=1
    )
    bright = ((92, 122, 52), (110, 130, 58), (80, 112, 50), (124, 132, 60), (88, 114, 62))[look]
    _foliage(rng, picture, clumps, 2600, (20, 34, 16), bright, (2.5, 7.0))
    return picture, 320 / 30, 1.0


def tuft(rng: np.random.Generator, look: int) -> Picture:
    """Paints blades that spread from one foot. look: 0, 1 green; 2, 3 dark fern; 4, 5 straw."""
    import cv2

    rows, columns, blades = 96, 120, 70
    picture = blank(rows, columns)
    dark, bright = (
        ((50, 78, 24), (126, 152, 68)),
        ((26, 42, 18), (76, 100, 46)),
        ((118, 106, 66), (196, 182, 126)),
    )[look // 2]
    reach, tall = rng.normal(0, 22, blades), rng.uniform(0.35, 1.0, blades) * (rows - 6)
    part = np.linspace(0, 1, 7)[:, None]
    for i in np.argsort(-tall):
        foot = 60 + rng.normal(0, 7)
        curve = np.hstack(
            [foot + reach[i] * part**1.8, rows - 1 - tall[i] * (part - 0.25 * part**3 * abs(reach[i]) / 40)]
        )
        colour = np.asarray(dark) + rng.uniform(0.1, 1.0) * (np.asarray(bright) - np.asarray(dark))
        thick = 4 if look // 2 == 1 else 2
        cv2.polylines(picture, [curve.astype(np.int32)], False, (*(int(c) for c in colour), 255), thick)  # noqa: FBT003
    return picture, 1.0, 1.0


DRUM_COLOURS = ((176, 44, 36), (36, 78, 168), (222, 118, 28))  # red, blue, orange


def drum(rng: np.random.Generator, look: int) -> Picture:
    """Paints a steel drum, lit from the upper left, with two rolling hoops, a lid, scratches and rust."""
    import cv2

    rows, columns, lid = 256, 160, 9
    picture = blank(rows, columns)
    body = np.asarray(DRUM_COLOURS[look], np.float32)
    across = np.linspace(-1, 1, columns)
    shade = (
        0.3
        + 0.6 * np.sqrt(np.clip(1 - (across + 0.3) ** 2 / 1.7, 0, 1))
        + 0.25 * np.exp(-(((across + 0.4) / 0.1) ** 2))
    )
    hoops = np.ones(rows)
    for y in (92, 168):
        hoops[y : y + 5], hoops[y + 5 : y + 10] = 1.2, 0.55
    rust = np.clip(noise(rng, rows, columns, 6, 60) - 1.3, 0, 1)[..., None] * 0.9
    rust += np.clip(np.linspace(-2.2, 0.5, rows), 0, 1)[:, None, None]
    skin = body * (1 - np.clip(rust, 0, 0.8)) + np.array([104, 66, 42]) * np.clip(rust, 0, 0.8)
    skin = (
        skin
        * (shade[None, :, None] * hoops[:, None, None])
        * (1 + 0.04 * noise(rng, rows, columns, 2, 20)[..., None])
    )
    mask = np.zeros((rows, columns), np.uint8)
    cv2.rectangle(mask, (2, lid), (columns - 3, rows - lid - 1), 255, -1)
    cv2.ellipse(mask, (columns // 2, rows - lid - 2), (columns // 2 - 3, lid), 0, 0, 360, 255, -1)
    cv2.ellipse(mask, (columns // 2, lid), (columns // 2 - 3, lid), 0, 0, 360, 255, -1)
    picture[..., :3], picture[..., 3] = np.clip(skin, 0, 255).astype(np.uint8), mask
    rim = tuple(int(min(255, c * 1.2)) for c in body)
    cv2.ellipse(
        picture,
        (columns // 2, lid),
        (columns // 2 - 3, lid),
        0,
        0,
        360,
        (*(int(c * 0.8) for c in body), 255),
        -1,
    )
    cv2.ellipse(picture, (columns // 2, lid), (columns // 2 - 3, lid), 0, 0, 360, (*rim, 255), 2)
    return picture, 1.0, 1.04


def rock(rng: np.random.Generator, look: int) -> Picture:
    """Paints a light grey-blue boulder of facets."""
    import cv2

    rows, columns = 168, 240
    picture = blank(rows, columns)
    angles = np.linspace(np.pi, 2 * np.pi, 9)
    jag = rng.uniform(0.82, 1.0, 9)
    rim = np.stack([120 + 114 * jag * np.cos(angles), 150 + 146 * jag * np.sin(angles)], axis=1)
    rim = np.vstack([rim, [[226, 160], [120, 167], [14, 160]]])
    peak = np.array([120 + rng.uniform(-30, 30), 78 + rng.uniform(-14, 14)])
    for i in range(len(rim)):
        facet = np.array([rim[i], rim[(i + 1) % len(rim)], peak])
        middle = facet.mean(axis=0)
        light = (
            0.98 - 0.18 * (middle[0] - 120) / 114 - 0.34 * (middle[1] - 80) / 80 + rng.uniform(-0.06, 0.06)
        )
        base = np.array([(168, 182, 204), (158, 172, 198)][look])
        cv2.fillPoly(
            picture, [facet.astype(np.int32)], (*(int(c) for c in np.clip(base * light, 0, 255)), 255)
        )
    rough = 0.07 * noise(rng, rows, columns, 2, 10) + 0.06 * noise(rng, rows, columns, 10, 60)
    picture[..., :3] = np.clip(
        cv2.GaussianBlur(picture[..., :3], (0, 0), 2.0) * (1 + rough[..., None]), 0, 255
    ).astype(np.uint8)
    shown = np.flatnonzero(picture[..., 3].any(axis=0))
    return picture[:, shown[0] : shown[-1] + 1], 1.0, 1.0


def log(rng: np.random.Generator, look: int) -> Picture:
    """Paints a Scots pine trunk on its side: red bark, and the cut face with its rings at one end."""
    import cv2

    rows, columns = 84, 512
    picture = blank(rows, columns)
    down = np.linspace(-1, 1, rows)
    shade = 0.4 + 0.75 * np.sqrt(np.clip(1 - (down + 0.35) ** 2 / 2.0, 0, 1))
    grain = 0.16 * cv2.resize(noise(rng, rows, 64, 2, 12), (columns, rows)) + 0.1 * noise(
        rng, rows, columns, 3, 30
    )
    bark = np.array([114, 56, 42]) * shade[:, None, None] * (1 + grain[..., None])
    mask = np.zeros((rows, columns), np.uint8)
    cv2.rectangle(mask, (22, 2), (columns - 24, rows - 3), 255, -1)
    for end in (22, columns - 24):
        cv2.ellipse(mask, (end, rows // 2), (20, rows // 2 - 2), 0, 0, 360, 255, -1)
    picture[..., :3], picture[..., 3] = np.clip(bark, 0, 255).astype(np.uint8), mask
    cut = 22 if look else columns - 24
    for i, part in enumerate(np.linspace(1, 0.12, 7)):
        colour = (214, 150, 92) if i % 2 else (186, 112, 66)
        cv2.ellipse(
            picture,
            (cut, rows // 2),
            (int(20 * part), int((rows // 2 - 2) * part)),
            0,
            0,
            360,
            (*colour, 255),
            -1,
        )
    return picture, 1.0, 1.0


_REACH = 8.0  # m, beyond which a tuft is only texture
_PER_METRE = {"meadow": 7.0, "forest": 6.0, "gravel": 3.5}
_SPREAD = {"meadow": 4.0, "forest": 4.5, "gravel": 4.0}  # m outward from the path's edge
_MOST = 60  # tufts in one frame


class Tufts:
    """Places a world's tufts of grass: look 0 or 1 in the meadow, 2 or 3 in the forest, 4 or 5 on gravel."""

    def __init__(self, world: World) -> None:
        rng = np.random.default_rng([world.seed, 50])
        trail = world.trail
        self._tufts: list[FieldThing] = []
        for zone, (begin, end) in trail.borders.items():
            for s in rng.uniform(begin, end, int((end - begin) * _PER_METRE[zone])):
                out = float(trail.half_width(np.asarray(s))) + 0.12 + _SPREAD[zone] * rng.uniform() ** 2.2
                side = math.copysign(out, rng.uniform(-1, 1))
                at = trail.pose(float(s))
                x, y = at.x - side * math.sin(at.heading), at.y + side * math.cos(at.heading)
                height, look = float(rng.uniform(0.14, 0.42)), 2 * ZONES.index(zone) + int(rng.integers(0, 2))
                self._tufts.append(
                    FieldThing("", "tuft", x, y, height * 0.6, height, surprise=False, look=look)
                )
        self._places = np.array([(tuft.x, tuft.y) for tuft in self._tufts])

    def near(self, pose: TrailPose) -> list[FieldThing]:
        """Returns the tufts ahead of a pose within 8 m, the 60 nearest at most."""
        dx, dy = (self._places - (pose.x, pose.y)).T
        c, s = math.cos(pose.heading), math.sin(pose.heading)
        ahead, left = dx * c + dy * s, dy * c - dx * s
        seen = np.flatnonzero((ahead > 0.9) & (np.abs(left) < ahead) & (np.hypot(ahead, left) < _REACH))
        return [self._tufts[i] for i in seen[np.argsort(ahead[seen])[:_MOST]]]


_PAINTERS: dict[str, tuple[int, Callable[[np.random.Generator, int], Picture]]] = {
    "bush": (4, bush),
    "tree": (5, tree),
    "tuft": (6, tuft),
    "drum": (3, drum),
    "rock": (2, rock),
    "log": (2, log),
}


@dataclass(frozen=True)
class Sprite:
    """A thing's picture, RGBA with colour times alpha, at all scales: largest first, each half the last."""

    scales: tuple[Bytes, ...]
    wide: float  # of the thing's diameter (a log: of its length) that the picture spans
    high: float  # of the thing's height

    def draw(
        self,
        frame: Bytes,
        foot: tuple[float, float],
        size: tuple[float, float],
        light: float,
        haze: Colour,
        clear: float,
    ) -> tuple[tuple[slice, slice], Bytes] | None:
        """Blends the picture over a frame. `foot` (column, row) and `size` (width, height) are in pixels.

        `light` scales its brightness; a share `clear` (0..1) of its colour is left, the rest is `haze`.
        Returns its place in the frame and its opacity there (0..255), or None when it lies outside the frame.
        """
        import cv2

        wide, high = size[0] * self.wide, size[1] * self.high
        left, top = foot[0] - wide / 2, foot[1] - high
        x0, x1 = max(0, math.floor(left)), min(frame.shape[1], math.ceil(left + wide) + 1)
        y0, y1 = max(0, math.floor(top)), min(frame.shape[0], math.ceil(foot[1]) + 1)
        if x1 <= x0 or y1 <= y0 or min(wide, high) < 1.2:
            return None
        scale = next((small for small in self.scales[::-1] if small.shape[0] >= high), self.scales[0])
        matrix = np.array([[wide / scale.shape[1], 0, left - x0], [0, high / scale.shape[0], top - y0]])
        warped = cv2.warpAffine(scale, matrix, (x1 - x0, y1 - y0), flags=cv2.INTER_LINEAR)
        patch = np.asarray(warped, np.uint8)
        shown = np.zeros((3, 4))
        shown[:, :3] = np.eye(3) * light * clear
        shown[:, 3] = (1 - clear) * np.asarray(haze) / 255
        hidden = np.array([[0.0, 0, 0, -1, 255]] * 3)
        into = frame[y0:y1, x0:x1]
        behind = cv2.multiply(into, cv2.transform(patch, hidden), scale=1 / 255)
        into[:] = cv2.add(behind, cv2.transform(patch, shown))
        return (slice(y0, y1), slice(x0, x1)), patch[..., 3]


def paint_all(seed: int) -> dict[str, tuple[Sprite, ...]]:
    """Paints all kinds of things: kind -> one sprite for each look."""
    return {
        kind: tuple(paint(kind, look, seed) for look in range(looks))
        for kind, (looks, _) in _PAINTERS.items()
    }


def paint(kind: str, look: int, seed: int) -> Sprite:
    """Paints one kind of thing, once for each of its looks. look: counted from 0, and on after the last."""
    return _paint(kind, look % _PAINTERS[kind][0], seed)


@lru_cache(maxsize=128)
def _paint(kind: str, look: int, seed: int) -> Sprite:
    import cv2

    rng = np.random.default_rng([seed, 30, list(_PAINTERS).index(kind), look])
    picture, wide, high = _PAINTERS[kind][1](rng, look)
    rgba = picture.astype(np.float32)
    rgba[..., :3] *= rgba[..., 3:] / 255
    scales = [rgba]
    while min(scales[-1].shape[:2]) > 3:
        rows, columns = scales[-1].shape[:2]
        smaller = cv2.resize(scales[-1], (columns // 2, rows // 2), interpolation=cv2.INTER_AREA)
        scales.append(np.asarray(smaller, np.float32))
    return Sprite(tuple(scale.astype(np.uint8) for scale in scales), wide, high)
