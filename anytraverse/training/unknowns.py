"""Pastes things into frames, which teach the network the class of things without a name.

Made things have random shapes and surfaces. They are meant to resemble nothing in particular: no drum, rock
or log is drawn on purpose. Others are photographs without a background.
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

Rng = np.random.Generator
Floats = NDArray[np.float32]
Window = tuple[slice, slice]

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

    at: column and row of its foot in pixels; None: drawn.
    """
    rows, columns = names.shape
    near = rng.random() < 0.15  # it fills much of the frame, as a car does just before the rover
    high = rows * math.exp(rng.uniform(math.log(0.05), math.log(0.5)) if not near else rng.uniform(-0.7, 0.3))
    wide = high * math.exp(rng.normal(0.0, 0.5 if rng.random() < 0.7 else 1.2))
    foot = np.clip(rng.normal(0.62, 0.2), 0.2, 1.1) * rows
    middle = rng.uniform(0, columns)
    if at is not None:
        middle, foot = at
    if cutout is not None:
        wide = min(high * cutout.shape[1] / cutout.shape[0], (1.5 if near else 0.6) * columns)
        placed = _placed(cutout, (rows, columns), (middle, foot - high / 2), (wide, high), rng)
        mask: Floats = np.float32(1 / 255) * np.asarray(placed[..., 3], dtype=np.float32)
    else:
        mask = _shape((rows, columns), (middle, foot - high / 2), (wide, high), rng)
    box = cv2.boundingRect((mask > 0.5).astype(np.uint8))
    left, top, width, height = box
    if width < 3 or height < 3:
        return
    window = (slice(top, top + height), slice(left, left + width))
    level = float(source[window].mean()) / 128
    if cutout is not None:
        surface = _recoloured(placed[window][..., :3], rng)
    else:
        surface = _surface((height, width), source, rng) * _relief((height, width), rng)[..., None]
    if rng.random() < 0.7:  # lit like its surroundings
        surface = surface * np.float32(np.clip(level * math.exp(rng.normal(0, 0.3)), 0.1, 2.0))
    if rng.random() < 0.6:
        _shadow(picture, mask, (wide, high), rng)
    soft = mask[window][..., None]
    under = picture[window].astype(np.float32)
    picture[window] = np.clip(under * (1 - soft) + surface * soft, 0, 255).astype(np.uint8)
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


def _recoloured(colours: NDArray[np.uint8], rng: Rng) -> Floats:
    """Change the colours of a thing: paler or grey, tinted, lighter or darker; RGB 0 to 255."""
    surface: Floats = colours.astype(np.float32)
    if rng.random() < 0.5:
        grey = surface.mean(axis=2, keepdims=True)
        surface = grey + np.float32(rng.uniform(0.0, 1.3)) * (surface - grey)
    if rng.random() < 0.5:
        surface = surface * np.exp(rng.normal(0, 0.25, 3)).astype(np.float32)
    contrast = np.float32(math.exp(rng.normal(0, 0.2)))
    mean = np.float32(surface.mean())
    return np.asarray(mean + contrast * (surface - mean), dtype=np.float32)


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
    soft = np.asarray(mask, dtype=np.float32) / 255
    return np.asarray(cv2.GaussianBlur(soft, (3, 3), 0), dtype=np.float32)


def _surface(shape: tuple[int, int], source: Image, rng: Rng) -> Floats:
    """Draw a surface, RGB 0 to 255: paint, stripes, patches, or a piece of the frame in other colours."""
    rows, columns = shape
    colour = _colour(rng)
    kind = rng.random()
    if kind < 0.35:
        surface = np.broadcast_to(colour, (rows, columns, 3)).astype(np.float32)
    elif kind < 0.5:
        period, angle = rng.uniform(3, 30), rng.uniform(0, math.pi)
        y, x = np.mgrid[:rows, :columns]
        wave = np.sin((x * math.cos(angle) + y * math.sin(angle)) * 2 * math.pi / period + rng.uniform(0, 6))
        share = np.clip(wave * rng.uniform(1, 8) * 0.5 + 0.5, 0, 1)[..., None]
        surface = (share * colour + (1 - share) * _colour(rng)).astype(np.float32)
    elif kind < 0.7:
        coarse = rng.uniform(size=(int(rng.integers(2, 7)), int(rng.integers(2, 7)))).astype(np.float32)
        how = cv2.INTER_NEAREST if rng.random() < 0.5 else cv2.INTER_CUBIC
        share = np.clip(np.asarray(cv2.resize(coarse, (columns, rows), interpolation=how)), 0, 1)[..., None]
        surface = (share * colour + (1 - share) * _colour(rng)).astype(np.float32)
    else:
        surface = _borrowed(shape, source, rng)
    grain = rng.standard_normal((rows, columns, 1), dtype=np.float32) * np.float32(rng.uniform(0, 0.12))
    if rng.random() < 0.5:
        grain = np.asarray(cv2.GaussianBlur(grain, (0, 0), 1.2), dtype=np.float32)[..., None] * 2
    return np.asarray(surface * (1 + grain), dtype=np.float32)


def _borrowed(shape: tuple[int, int], source: Image, rng: Rng) -> Floats:
    """Copy a piece of the frame at another scale, with changed colours: swapped, negative or tinted."""
    rows, columns = shape
    high, wide = (int(rng.integers(8, side)) for side in source.shape[:2])
    top, left = int(rng.integers(0, source.shape[0] - high)), int(rng.integers(0, source.shape[1] - wide))
    there = source[top : top + high, left : left + wide]
    piece = cv2.resize(there, (columns, rows), interpolation=cv2.INTER_AREA)
    order = rng.permutation([1, 2, 0] if rng.random() < 0.5 else [2, 0, 1])
    surface: Floats = np.asarray(piece, dtype=np.float32)[..., order]
    if rng.random() < 0.4:
        surface = 255 - surface
    painted = surface.mean(axis=2, keepdims=True) * _colour(rng) / 128
    return np.asarray(0.5 * surface + 0.5 * painted, dtype=np.float32)


def _colour(rng: Rng) -> Floats:
    """Draw any colour: vivid, pale, grey, black or white. RGB 0 to 255, (3,)."""
    hue, value = rng.uniform(0, 180), 255 * rng.beta(1.3, 1.1)
    vivid = 255 * (rng.beta(2, 1) if rng.random() < 0.6 else rng.beta(1, 4))
    pixel = np.array([[[hue, vivid, value]]]).astype(np.uint8)
    return np.asarray(cv2.cvtColor(pixel, cv2.COLOR_HSV2RGB)[0, 0], dtype=np.float32)


def _relief(shape: tuple[int, int], rng: Rng) -> Floats:
    """Draw the shading of a body: round from side to side and from above, or flat."""
    rows, columns = shape
    if rng.random() < 0.3:
        return np.ones(shape, dtype=np.float32)
    across = np.linspace(-1, 1, columns) - rng.uniform(-0.6, 0.6)
    down = np.linspace(-1, 1, rows) - rng.uniform(-0.8, 0.2)
    round_x, round_y = rng.uniform(0, 0.6), rng.uniform(0, 0.4)
    relief = 1.1 - round_x * across[None] ** 2 - round_y * down[:, None] ** 2
    return np.asarray(relief.clip(0.15), dtype=np.float32)


def _shadow(picture: Image, mask: Floats, size: tuple[float, float], rng: Rng) -> None:
    """Darken the ground at the foot of a thing, to one side."""
    shift = np.array([[1, 0, rng.normal(0, 0.35) * size[0]], [0, 0.6, 0]])
    low = np.flatnonzero(mask.max(axis=1) > 0.5)[-1]
    shift[1, 2] = low * 0.4 + rng.uniform(0, 0.15) * size[1]
    cast = cv2.warpAffine(mask, shift, mask.shape[::-1])
    cast = cv2.GaussianBlur(cast, (0, 0), rng.uniform(0.8, 3.0))
    dark = np.float32(rng.uniform(0.2, 0.6))
    picture[:] = (picture * (1 - dark * np.asarray(cast)[..., None])).astype(np.uint8)
