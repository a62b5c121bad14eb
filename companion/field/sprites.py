"""Pictures of the things: painted once by seed, kept at every scale, drawn into the frame with soft edges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.field.tiles import Bytes, noise

DRUM_COLOURS = ((176, 44, 36), (36, 78, 168), (222, 118, 28))  # red, blue, orange
LOOKS = {"bush": 4, "tree": 4, "drum": 3, "rock": 2, "log": 2}


@dataclass(frozen=True)
class Sprite:
    """A thing's picture: RGBA with colour times alpha, largest first, each scale half the one before."""

    scales: tuple[Bytes, ...]
    wide: float  # of the thing's diameter (a log: of its length) that the picture spans
    high: float  # of the thing's height


def paint(kind: str, look: int, seed: int) -> Sprite:
    """The picture of a kind of thing; `look` is taken modulo the kind's number of looks."""
    import cv2

    look %= LOOKS[kind]
    rng = np.random.default_rng([seed, 30, sorted(LOOKS).index(kind), look])
    picture, wide, high = _PAINTERS[kind](rng, look)
    rgba = picture.astype(np.float32)
    rgba[..., :3] *= rgba[..., 3:] / 255
    scales = [rgba]
    while min(scales[-1].shape[:2]) > 3:
        rows, columns = scales[-1].shape[:2]
        smaller = cv2.resize(scales[-1], (columns // 2, rows // 2), interpolation=cv2.INTER_AREA)
        scales.append(np.asarray(smaller, np.float32))
    return Sprite(tuple(scale.astype(np.uint8) for scale in scales), wide, high)


def _blank(rows: int, columns: int) -> Bytes:
    return np.zeros((rows, columns, 4), np.uint8)


def _foliage(
    rng: np.random.Generator,
    picture: Bytes,
    clumps: NDArray[np.float64],
    leaves: int,
    dark: tuple[int, int, int],
    bright: tuple[int, int, int],
    size: tuple[float, float],
) -> None:
    """Leaves in clumps (x, y, radius in pixels), brighter to the upper left of each, inside out."""
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


def _bush(rng: np.random.Generator, look: int) -> tuple[Bytes, float, float]:
    picture = _blank(224, 256)
    x, y = rng.uniform(50, 206, 9), rng.uniform(70, 190, 9)
    y += np.abs(x - 128) * 0.25
    clumps = np.stack([x, np.minimum(y, 180), rng.uniform(28, 48, 9)], axis=1)
    clumps = np.vstack([clumps, [[128, 150, 68], [84, 176, 44], [172, 176, 44]]])
    bright = ((96, 128, 62), (84, 120, 52), (118, 136, 66), (78, 112, 60))[look]
    _foliage(rng, picture, clumps, 1500, (18, 32, 16), bright, (3.0, 7.0))
    return picture, 1.15, 1.05


def _tree(rng: np.random.Generator, look: int) -> tuple[Bytes, float, float]:
    """A trunk that leaves the ground a fifteenth of the picture's width wide, and a crown above it."""
    import cv2

    rows, columns = 640, 320
    picture = _blank(rows, columns)
    bark = ((84, 70, 56), (98, 88, 76), (70, 58, 46), (110, 98, 84))[look]
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

    crown = 12
    low = (330, 300, 380, 280)[look]
    y = rng.uniform(60, low, crown)
    spread = 40 + 75 * np.sin(np.clip((y - 20) / (low + 40), 0, 1) * np.pi)
    clumps = np.stack(
        [160 + lean + rng.uniform(-1, 1, crown) * spread, y, rng.uniform(34, 60, crown)], axis=1
    )
    bright = ((92, 122, 52), (108, 130, 58), (80, 112, 50), (122, 132, 60))[look]
    _foliage(rng, picture, clumps, 2200, (20, 34, 16), bright, (3.0, 8.0))
    return picture, 320 / 30, 1.0


def _drum(rng: np.random.Generator, look: int) -> tuple[Bytes, float, float]:
    """Painted steel, lit from the upper left, with two rolling hoops, a lid, scratches and rust."""
    import cv2

    rows, columns, lid = 256, 160, 9
    picture = _blank(rows, columns)
    body = np.asarray(DRUM_COLOURS[look], np.float32)
    across = np.linspace(-1, 1, columns)
    shade = (
        0.45
        + 0.6 * np.sqrt(np.clip(1 - (across + 0.3) ** 2 / 1.7, 0, 1))
        + 0.25 * np.exp(-(((across + 0.4) / 0.1) ** 2))
    )
    hoops = np.ones(rows)
    for y in (92, 168):
        hoops[y : y + 5], hoops[y + 5 : y + 9] = 1.22, 0.68
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


def _rock(rng: np.random.Generator, look: int) -> tuple[Bytes, float, float]:
    """A light boulder in grey-blue, cut into facets."""
    import cv2

    rows, columns = 168, 240
    picture = _blank(rows, columns)
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
    return picture, 1.0, 1.0


def _log(rng: np.random.Generator, look: int) -> tuple[Bytes, float, float]:
    """A trunk on its side with the cut face, its rings showing, at one end."""
    import cv2

    rows, columns = 84, 512
    picture = _blank(rows, columns)
    down = np.linspace(-1, 1, rows)
    shade = 0.4 + 0.75 * np.sqrt(np.clip(1 - (down + 0.35) ** 2 / 2.0, 0, 1))
    grain = 0.16 * cv2.resize(noise(rng, rows, 64, 2, 12), (columns, rows)) + 0.1 * noise(
        rng, rows, columns, 3, 30
    )
    bark = np.array([104, 76, 52]) * shade[:, None, None] * (1 + grain[..., None])
    mask = np.zeros((rows, columns), np.uint8)
    cv2.rectangle(mask, (22, 2), (columns - 24, rows - 3), 255, -1)
    for end in (22, columns - 24):
        cv2.ellipse(mask, (end, rows // 2), (20, rows // 2 - 2), 0, 0, 360, 255, -1)
    picture[..., :3], picture[..., 3] = np.clip(bark, 0, 255).astype(np.uint8), mask
    cut = 22 if look else columns - 24
    for i, part in enumerate(np.linspace(1, 0.12, 7)):
        colour = (206, 170, 118) if i % 2 else (178, 138, 90)
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


_PAINTERS: dict[str, Callable[[np.random.Generator, int], tuple[Bytes, float, float]]] = {
    "bush": _bush,
    "tree": _tree,
    "drum": _drum,
    "rock": _rock,
    "log": _log,
}
