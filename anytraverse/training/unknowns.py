"""Pastes things into frames, which teach the network the class of things without a name.

Made things have random shapes and surfaces. They are meant to resemble nothing in particular: no drum, rock
or short log is drawn on purpose. Some cross the whole view. Others are photographs without a background.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.frame import Image
from anytraverse.training.classes import GROUND, UNKNOWN, UNLABELLED
from anytraverse.training.cutouts import Cutout
from anytraverse.training.folders import Labels
from anytraverse.training.surfaces import recoloured, relief, surface

Rng = np.random.Generator
Floats = NDArray[np.float32]
Window = tuple[slice, slice]

_ACROSS = 0.12  # share of made things that cross the whole view
EDGE = 1  # pixels around a thing that are left unlabelled


def paste_unknowns(
    image: Image, labels: Labels, rng: Rng, cutouts: Sequence[Cutout] = ()
) -> tuple[Image, Labels]:
    """Paste one to three things of some 5 to 50 % of the frame's height, mostly on the ground; label them.

    Where there are `cutouts`, photographs of things, half of the things are of these.
    """
    picture, names = image.copy(), labels.copy()
    for _ in range(int(rng.integers(1, 4))):
        chosen = cutouts[int(rng.integers(len(cutouts)))] if cutouts and rng.random() < 0.5 else None
        paste_thing(picture, names, image, rng, chosen)
    return picture, names


def move_patches(image: Image, labels: Labels, rng: Rng) -> tuple[Image, Labels]:
    """Copy one to four patches of ground or plants to other places in the frame, with their labels.

    They teach that a difference from the surroundings alone, as of a tuft on a trail, makes nothing unknown.
    Their edges are ragged, which those of pasted things are not.
    """
    picture, names = image.copy(), labels.copy()
    rows, columns = labels.shape
    for _ in range(int(rng.integers(1, 5))):
        size = rows * math.exp(rng.uniform(math.log(0.06), math.log(0.4))) * np.exp(rng.normal(0.0, 0.4, 2))
        if rng.random() < _ACROSS:
            size[0] = columns * rng.uniform(0.8, 1.5)
        centre = rng.uniform(0, columns), rng.uniform(0.4, 1.0) * rows
        mask = _shape((rows, columns), centre, (float(size[0]), float(size[1])), rng) > 0.5
        left, top, wide, high = cv2.boundingRect(mask.astype(np.uint8))
        if min(wide, high) < 3:
            continue
        here = slice(top, top + high), slice(left, left + wide)
        inside = mask[here] & _ragged((high, wide), rng)
        there = _another_ground(labels, here, inside, rng)
        if there:
            picture[here][inside] = image[there][inside]
            names[here][inside] = labels[there][inside]
    return np.asarray(cv2.GaussianBlur(picture, (3, 3), 0.5), dtype=np.uint8), names


def _another_ground(labels: Labels, here: Window, inside: NDArray[np.bool_], rng: Rng) -> Window | None:
    """Find a window of the size of `here` that shows ground or plants, of other classes if possible."""
    rows, columns = labels.shape
    high, wide = inside.shape
    found = None
    for _ in range(4):
        x, y = int(rng.integers(0, columns - wide + 1)), int(rng.integers(0, rows - high + 1))
        there = slice(y, y + high), slice(x, x + wide)
        if inside.any() and np.isin(labels[there][inside], GROUND).mean() > 0.9:
            found = there
            if (labels[there][inside] != labels[here][inside]).mean() > 0.7:
                break
    return found


def _ragged(shape: tuple[int, int], rng: Rng) -> NDArray[np.bool_]:
    """Draw a mask of lumps and gaps of a few pixels, (rows, columns)."""
    coarse = rng.uniform(size=tuple(max(2, side // int(rng.integers(2, 9))) for side in shape))
    lumps = cv2.resize(coarse.astype(np.float32), shape[::-1], interpolation=cv2.INTER_CUBIC)
    return np.asarray(lumps > rng.uniform(0.2, 0.5), dtype=np.bool_).reshape(shape)


def paste_thing(
    picture: Image,
    names: Labels,
    source: Image,
    rng: Rng,
    cutout: Cutout | None = None,
    at: tuple[float, float] | None = None,
) -> None:
    """Paste one thing into `picture` and `names`; its surface may be copied from `source`.

    at: column and row of its foot in pixels; None: drawn, and some made things cross the whole view.
    """
    rows, columns = names.shape
    near = rng.random() < 0.15  # it fills much of the frame, as a car does just before the rover
    across = cutout is None and at is None and rng.random() < _ACROSS
    high = rows * math.exp(rng.uniform(math.log(0.05), math.log(0.5)) if not near else rng.uniform(-0.7, 0.3))
    if across:
        high = rows * math.exp(rng.uniform(math.log(0.04), math.log(0.35)))
    wide = high * math.exp(rng.normal(0.0, 0.5 if rng.random() < 0.7 else 1.2))
    foot = np.clip(rng.normal(0.62, 0.2), 0.2, 1.1) * rows
    middle = rng.uniform(0, columns)
    if at is not None:
        middle, foot = at
    if cutout is not None:
        wide = min(high * cutout.shape[1] / cutout.shape[0], (1.5 if near else 0.6) * columns)
        placed = _placed(cutout, (rows, columns), (middle, foot - high / 2), (wide, high), rng)
        mask: Floats = np.float32(1 / 255) * np.asarray(placed[..., 3], dtype=np.float32)
    elif across:
        mask = _band((rows, columns), (middle, foot), high, rng)
    else:
        mask = _shape((rows, columns), (middle, foot - high / 2), (wide, high), rng)
    box = cv2.boundingRect((mask > 0.5).astype(np.uint8))
    left, top, width, height = box
    if width < 3 or height < 3:
        return
    window = (slice(top, top + height), slice(left, left + width))
    level = float(source[window].mean()) / 128
    if cutout is not None:
        painted = recoloured(placed[window][..., :3], rng)
    else:
        shape = height, width
        painted = surface(shape, source, rng, across=across) * relief(shape, rng)[..., None]
    if rng.random() < 0.7:  # lit like its surroundings
        painted = painted * np.float32(np.clip(level * math.exp(rng.normal(0, 0.3)), 0.1, 2.0))
    if rng.random() < 0.6:
        _shadow(picture, mask, (wide, high), rng)
    soft = mask[window][..., None]
    under = picture[window].astype(np.float32)
    picture[window] = np.clip(under * (1 - soft) + painted * soft, 0, 255).astype(np.uint8)
    solid = (mask > 0.5).astype(np.uint8)
    around = cv2.dilate(solid, np.ones((2 * EDGE + 1, 2 * EDGE + 1), np.uint8))
    names[(around > 0) & (solid == 0)] = UNLABELLED
    names[solid > 0] = UNKNOWN


def _placed(
    cutout: Cutout,
    shape: tuple[int, int],
    centre: tuple[float, float],
    size: tuple[float, float],
    rng: Rng,
) -> NDArray[np.uint8]:
    """Draw a cut-out of a size (width, height) at a point, turned a little or lying, (rows, columns, 4)."""
    high, wide = cutout.shape[:2]
    shrunk = cv2.resize(
        cutout, (max(1, round(size[0])), max(1, round(size[1]))), interpolation=cv2.INTER_AREA
    )
    high, wide = shrunk.shape[:2]
    turn = math.radians(rng.normal(0, 8) if rng.random() < 0.85 else rng.uniform(0, 360))
    mirror = -1.0 if rng.random() < 0.5 else 1.0
    c, s = math.cos(turn), math.sin(turn)
    linear = np.array([[c, -s], [s, c]]) @ np.diag([mirror, 1.0])
    matrix = np.column_stack([linear, np.array(centre) - linear @ np.array([wide / 2, high / 2])])
    return np.asarray(cv2.warpAffine(shrunk, matrix, shape[::-1], flags=cv2.INTER_LINEAR), dtype=np.uint8)


def _shape(
    shape: tuple[int, int], centre: tuple[float, float], size: tuple[float, float], rng: Rng
) -> Floats:
    """Draw a box, an ellipse, a blob or a few joined parts: opacity (rows, columns) in [0, 1]."""
    mask = np.zeros(shape, dtype=np.uint8)
    kind = rng.random()
    parts = int(rng.integers(2, 5)) if kind > 0.8 else 1
    for part in range(parts):
        at = np.array(centre) + (rng.normal(0, 0.3, 2) * size if part else 0)
        extent = np.array(size) * (rng.uniform(0.3, 0.9, 2) if part else 1)
        turn = float(rng.normal(0, 10)) if rng.random() < 0.7 else float(rng.uniform(0, 180))
        which = rng.random()
        if which < 0.35:
            corners = cv2.boxPoints((tuple(map(float, at)), tuple(map(float, extent)), turn))
        else:
            count = int(rng.integers(5, 14)) if which < 0.75 else 32
            angles = (
                np.sort(rng.uniform(0, 2 * math.pi, count)) if count < 32 else np.linspace(0, 2 * math.pi, 32)
            )
            radius = rng.uniform(0.55, 1.0, count) if count < 32 else np.ones(32)
            corners = at + 0.5 * np.stack([np.cos(angles), np.sin(angles)], axis=1) * radius[:, None] * extent
        cv2.fillPoly(mask, [np.round(corners * 16).astype(np.int32)], 255, cv2.LINE_AA, 4)
    return _softened(mask)


def _band(shape: tuple[int, int], foot: tuple[float, float], high: float, rng: Rng) -> Floats:
    """Draw what lies or stands across the view, as a trunk, a wall or a tarp: opacity (rows, columns).

    foot: column and row of its foot in pixels. Both ends are outside of the view, or the right one is in it.
    """
    columns = shape[1]
    slope, taper = math.tan(math.radians(rng.normal(0, 5))), rng.normal(0, 0.25)
    at = np.linspace(-0.2, 1.2, 24) * columns
    middle = foot[1] - high / 2 + slope * (at - foot[0])
    rough = 1 + max(0.0, rng.uniform(-0.15, 0.15)) * rng.normal(0, 1, (2, len(at)))
    half = high / 2 * np.exp(taper * (at / columns - 0.5)) * rough
    mask = np.zeros(shape, dtype=np.uint8)
    edge = np.concatenate([np.stack([at, middle - half[0]], 1), np.stack([at, middle + half[1]], 1)[::-1]])
    cv2.fillPoly(mask, [np.round(edge * 16).astype(np.int32)], 255, cv2.LINE_AA, 4)
    if rng.random() < 0.3:  # one end is in view
        end = round(foot[0] + rng.uniform(0.1, 0.6) * columns)
        mask[:, end:] = 0
    return _softened(mask)


def _softened(mask: NDArray[np.uint8]) -> Floats:
    soft = np.asarray(mask, dtype=np.float32) / 255
    return np.asarray(cv2.GaussianBlur(soft, (3, 3), 0), dtype=np.float32)


def _shadow(picture: Image, mask: Floats, size: tuple[float, float], rng: Rng) -> None:
    """Darken the ground at the foot of a thing, to one side."""
    shift = np.array([[1, 0, rng.normal(0, 0.35) * size[0]], [0, 0.6, 0]])
    low = np.flatnonzero(mask.max(axis=1) > 0.5)[-1]
    shift[1, 2] = low * 0.4 + rng.uniform(0, 0.15) * size[1]
    cast = cv2.warpAffine(mask, shift, mask.shape[::-1])
    cast = cv2.GaussianBlur(cast, (0, 0), rng.uniform(0.8, 3.0))
    dark = np.float32(rng.uniform(0.2, 0.6))
    picture[:] = (picture * (1 - dark * np.asarray(cast)[..., None])).astype(np.uint8)
