"""Gathers cut-outs of each kind: photographs, labelled regions of frames abroad, and made ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.evaluation.labels import fold
from bench.perception.frames import LabelledSet
from bench.perception.pasting import Cutout
from companion.sim.field.sprites import paint_all
from companion.sim.field.tiles import noise

LARGE, SMALL, OTHER = "person, vehicle, barrel", "rock, log, animal", "wall, tarp, other"
ACROSS = "trunk, long wall"
"""What crosses the whole picture before a rover stands before it."""


@dataclass(frozen=True)
class _Kind:
    """Holds a kind's height (of a tarp: its depth along the ground) in metres, and the group it counts in."""

    height: float
    group: str


KINDS: dict[str, _Kind] = {
    "person": _Kind(1.7, LARGE),
    "vehicle": _Kind(1.5, LARGE),
    "barrel": _Kind(0.9, LARGE),
    "rock": _Kind(0.45, SMALL),
    "log": _Kind(0.3, SMALL),
    "animal": _Kind(0.6, SMALL),
    "wall": _Kind(1.0, OTHER),
    "tarp": _Kind(1.2, OTHER),
    "thing": _Kind(0.35, OTHER),
    "trunk": _Kind(0.44, ACROSS),
    "long wall": _Kind(1.0, ACROSS),
}
PHOTOGRAPH, SPRITE, MADE = "photograph", "simulation's sprite", "made"
REGION, CHIP = "region of a frame abroad", "rock's surface of a frame abroad, made outline"
_LOOKS = 3
_SPRITES = {"rock": "rock", "log": "log", "drum": "barrel"}
_LEAST = 24  # pixels: a smaller region shows too little
_FILLED = 0.4  # share of its box that a region fills
_ACROSS = 16  # length over thickness of what crosses the picture
_LONG = 1.5  # a log's region is at least so many times as wide as high

Bytes = NDArray[np.uint8]


def gather(photographs: Path | None, abroad: Sequence[LabelledSet], seed: int) -> dict[str, list[Cutout]]:
    """Return kind -> its cut-outs. photographs: a folder KIND/NAME.png of RGBA pictures; None: without any.

    A kind without any cut-out has an empty list.
    """
    found: dict[str, list[Cutout]] = {kind: [] for kind in KINDS}
    if photographs is not None:
        for kind, pictures in photographs_in(photographs).items():
            found[kind] += [Cutout(one, KINDS[kind].height, PHOTOGRAPH) for one in pictures]
    rng = np.random.default_rng([seed, 6])
    found["log"] += [Cutout(one, KINDS["log"].height, REGION) for one in regions(abroad, "log", _LONG)]
    stones = regions(abroad, "rock", 0.0)
    found["rock"] += [Cutout(_chipped(rng, one), KINDS["rock"].height, CHIP) for one in stones * _LOOKS]
    sprites = paint_all(seed)
    for name, kind in _SPRITES.items():
        found[kind] += [Cutout(_plain(s.scales[0]), KINDS[kind].height, SPRITE) for s in sprites[name]]
    found["wall"] += [Cutout(wall(rng, look), KINDS["wall"].height, MADE) for look in range(_LOOKS)]
    found["tarp"] += [
        Cutout(tarp(rng, look), KINDS["tarp"].height, MADE, flat=True) for look in range(_LOOKS)
    ]
    for look in range(_LOOKS):
        found["trunk"].append(Cutout(trunk(rng, look), KINDS["trunk"].height, MADE))
        row = np.concatenate([wall(rng, look) for _ in range(4)], axis=1)
        found["long wall"].append(Cutout(row, KINDS["long wall"].height, MADE))
    return found


def photographs_in(folder: Path) -> dict[str, list[Bytes]]:
    """Read DIR/KIND/*.png with an opacity channel; kinds that are not in `KINDS` are left out."""
    found: dict[str, list[Bytes]] = {}
    for kind in KINDS:
        for path in sorted((folder / kind).glob("*.png")):
            picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            if (
                picture is not None
                and picture.ndim == 3
                and picture.shape[2] == 4
                and picture.dtype == np.uint8
            ):
                found.setdefault(kind, []).append(_rgba(picture.astype(np.uint8)))
    return found


def regions(sets: Sequence[LabelledSet], label: str, long: float) -> list[Bytes]:
    """Cut the largest region of a label out of every frame that has one, RGBA.

    long: a region is at least so many times as wide as high.
    """
    found = []
    for one in sets:
        ids = [number for number, name in enumerate(one.names) if fold(name) == label]
        for frame in one.frames:
            mask = np.isin(frame.labels, ids).astype(np.uint8)
            count, _, boxes, _ = cv2.connectedComponentsWithStats(mask)
            if count < 2:
                continue
            left, top, wide, high, area = boxes[1 + int(np.argmax(boxes[1:, 4]))]
            if min(wide, high) < _LEAST or area < _FILLED * wide * high or wide < long * high:
                continue
            inside = slice(top, top + high), slice(left, left + wide)
            found.append(np.dstack([frame.image[inside], mask[inside] * 255]).astype(np.uint8))
    return found


def _chipped(rng: np.random.Generator, region: Bytes) -> Bytes:
    """Cut a stone with a made outline out of a region of rocks: where its label leaves most room."""
    room = cv2.distanceTransform(np.pad(region[..., 3], 1), cv2.DIST_L2, 5)[1:-1, 1:-1]
    wide_enough = np.argwhere(room >= 0.6 * room.max())
    y, x = wide_enough[rng.integers(len(wide_enough))]
    half = max(8, int(room[y, x]))
    piece = region[max(0, y - half) : y + half, max(0, x - half) : x + half].copy()
    rows, columns = piece.shape[:2]
    angles = np.linspace(0, 2 * np.pi, 11, endpoint=False)
    reach = rng.uniform(0.75, 1.0, 11)
    outline = _outline(angles, reach, rows, columns)
    piece[..., 3] = np.minimum(piece[..., 3], outline)
    return piece


def wall(rng: np.random.Generator, look: int) -> Bytes:
    """Paint a wall 3 m long for each metre of height: bricks, field stones or grey blocks with mortar."""
    rows, columns = 200, 600
    course, length = ((20, 48), (34, 60), (50, 100))[look]
    base = np.array([(140, 74, 56), (128, 122, 110), (134, 134, 132)][look], dtype=np.float64)
    picture = np.full((rows, columns, 3), (150, 145, 135), dtype=np.float64)
    for number, y in enumerate(range(0, rows, course)):
        x = -int(rng.integers(0, length)) - length * (number % 2) // 2
        while x < columns:
            wide = int(length * (rng.uniform(0.6, 1.3) if look == 1 else 1.0))
            shade = base * rng.normal(1.0, 0.16 if look == 1 else 0.09)
            picture[y + 2 : y + course, max(0, x + 2) : max(0, x + wide)] = shade
            x += wide
    rough = 1 + 0.07 * noise(rng, rows, columns, 2, 8) + 0.06 * noise(rng, rows, columns, 20, 80)
    shaded = np.clip(picture * rough[..., None], 0, 255).astype(np.uint8)
    return np.dstack([shaded, np.full((rows, columns), 255, dtype=np.uint8)])


def trunk(rng: np.random.Generator, look: int) -> Bytes:
    """Paint the side of a fallen trunk, `_ACROSS` times as long as thick: brown, grey or pale bark."""
    rows, columns = 60, 60 * _ACROSS
    base = np.array([(112, 78, 54), (110, 108, 102), (178, 170, 152)][look], dtype=np.float64)
    bark = noise(rng, rows, columns, 2, 30) + 0.6 * noise(rng, rows, columns, 8, 200)
    body = 0.35 + 0.8 * np.sin(np.linspace(0.25, 0.95, rows) * np.pi) * np.linspace(1.1, 0.7, rows)
    picture = base * np.clip(1 + 0.2 * bark, 0.4, 1.6)[..., None] * body[:, None, None]
    opaque = np.full((rows, columns), 255, dtype=np.uint8)
    return np.dstack([np.clip(picture, 0, 255).astype(np.uint8), opaque])


def tarp(rng: np.random.Generator, look: int) -> Bytes:
    """Paint a crumpled tarp from above, with a ragged outline: blue, green or grey."""
    rows, columns = 200, 280
    base = np.array([(40, 86, 160), (60, 96, 62), (124, 126, 128)][look], dtype=np.float64)
    folds = noise(rng, rows, columns, 8, 40) + 0.6 * noise(rng, rows, columns, 3, 12)
    slope = np.gradient(folds, axis=0) + 0.5 * np.gradient(folds, axis=1)
    shade = np.clip(1 + 0.25 * slope / (slope.std() + 1e-6), 0.45, 1.7)
    angles = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    reach = np.clip(rng.normal(0.92, 0.05, 40), 0.75, 1.0)
    # a square with rounded corners
    square = reach / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles))) ** 0.85
    mask = _outline(angles, square, rows, columns)
    colours = np.clip(base * shade[..., None], 0, 255).astype(np.uint8)
    return np.dstack([colours, mask])


def _outline(angles: NDArray[np.float64], reach: NDArray[np.float64], rows: int, columns: int) -> Bytes:
    """Fill the polygon around the middle with 255; reach: 1 touches the picture's edge."""
    x, y = (1 + np.cos(angles) * reach) * columns / 2, (1 + np.sin(angles) * reach) * rows / 2
    mask = np.zeros((rows, columns), dtype=np.uint8)
    cv2.fillPoly(mask, [np.stack([x, y], axis=1).astype(np.int32)], 255)
    return mask


def _rgba(picture: Bytes) -> Bytes:
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGRA2RGBA), dtype=np.uint8)


def _plain(premultiplied: Bytes) -> Bytes:
    """Undo the multiplication of colours with the opacity."""
    opacity = np.maximum(premultiplied[..., 3:].astype(np.float32), 1.0) / 255
    colours = np.clip(premultiplied[..., :3] / opacity, 0, 255).astype(np.uint8)
    return np.dstack([colours, premultiplied[..., 3]])
