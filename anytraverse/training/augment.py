"""Changes frames as other cameras, weather and mountings would, and their labels with them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.evaluation.weather import fog, glare, rain, shadows
from anytraverse.frame import Image
from anytraverse.training.beds import paste_puddle, paste_stones, strew
from anytraverse.training.classes import UNLABELLED
from anytraverse.training.cutouts import Cutout
from anytraverse.training.folders import Labels
from anytraverse.training.unknowns import move_patches, paste_unknowns

Rng = np.random.Generator
Floats = NDArray[np.float32]

LARGEST_TURN = 7.0  # degrees
SMALLEST_CROP = 0.45  # of the frame's width
_DARKEST = 0.07  # mean light of a view: a camera exposes longer before it gets darker
_GREY = np.array([0.299, 0.587, 0.114], dtype=np.float32)


def changed(
    image: Image, labels: Labels, size: tuple[int, int], rng: Rng, cutouts: Sequence[Cutout] = ()
) -> tuple[Image, Labels]:
    """Make a random view of a frame and its labels, both of `size` = (width, height)."""
    picture, names = moved(image, labels, size, rng)
    if rng.random() < 0.4:
        picture, names = move_patches(picture, names, rng)
    if rng.random() < 0.2:
        strew(picture, names, rng)
    if rng.random() < 0.08:
        paste_puddle(picture, names, rng)
    if rng.random() < 0.05:
        paste_stones(picture, names, rng)
    if rng.random() < 0.6:
        picture, names = paste_unknowns(picture, names, rng, cutouts)
    return relit(picture, rng), names


def moved(image: Image, labels: Labels, size: tuple[int, int], rng: Rng) -> tuple[Image, Labels]:
    """Crop a frame, turn it a little, and mirror it or not; outside of the frame labels are `UNLABELLED`."""
    rows, columns = image.shape[:2]
    wide, high = size
    share = rng.uniform(SMALLEST_CROP, 1.08) if rng.random() < 0.7 else 1.0
    stretch = math.exp(rng.normal(0, 0.08))
    across = share * min(columns, rows * wide / high * 1.15)
    scale_x = wide / across
    scale_y = scale_x * stretch
    if high > rows * scale_y:  # the frame is flatter than the view: stretch rather than leave a bar
        scale_y = high / rows
    free_x, free_y = columns - across, rows - high / scale_y
    left = rng.uniform(min(0.0, free_x), max(0.0, free_x))
    top = rng.uniform(min(0.0, free_y), max(0.0, free_y))
    turn = math.radians(rng.uniform(-LARGEST_TURN, LARGEST_TURN)) if rng.random() < 0.6 else 0.0
    c, s = math.cos(turn), math.sin(turn)
    mirror = -1.0 if rng.random() < 0.5 else 1.0
    linear = np.diag([scale_x * mirror, scale_y]) @ np.array([[c, -s], [s, c]])
    middle = np.array([left + across / 2, top + high / scale_y / 2])
    matrix = np.column_stack([linear, np.array([wide / 2, high / 2]) - linear @ middle])
    picture = cv2.warpAffine(image, matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    names = cv2.warpAffine(
        labels, matrix, size, flags=cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=UNLABELLED
    )
    return np.asarray(picture, dtype=np.uint8), np.asarray(names, dtype=np.uint8)


def relit(image: Image, rng: Rng) -> Image:
    """Change light, weather and camera: colours, gamma, exposure, shade, glare, fog, blur, noise, JPEG."""
    image = _weathered(image, rng)
    if rng.random() < 0.3:
        image = _softened(image, rng)
    light: Floats = np.float32(1 / 255) * np.asarray(image, dtype=np.float32)
    if rng.random() < 0.12:
        light = _infrared(light, rng)
    light = light @ _colours(rng).T
    light = np.clip(light, 0.0, 1.0, out=light)
    if rng.random() < 0.6:
        light **= np.float32(math.exp(rng.normal(0, 0.25)))
    if rng.random() < 0.3:
        light *= _clouds(image.shape[:2], rng)[..., None]
    light *= np.float32(math.exp(np.clip(rng.normal(0, 0.35), -1.0, 0.75)))
    if rng.random() < 0.3:
        light += np.float32(rng.uniform(-0.04, 0.08))  # haze, or a black level
    if rng.random() < 0.08:
        light = light * np.float32(math.exp(rng.uniform(-1.8, -0.7))) + _noise(image.shape, rng)  # dusk
    if rng.random() < 0.3:
        light = light * _gains(rng)  # a wrong white balance, after the light
    light *= np.float32(max(1.0, _DARKEST / max(float(light.mean()), 1e-3)))
    if rng.random() < 0.5:
        light += _noise(image.shape, rng)
    made = np.asarray(np.clip(light * 255, 0, 255), dtype=np.uint8)
    if rng.random() < 0.3:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(20, 80))]
        made = np.asarray(
            cv2.imdecode(cv2.imencode(".jpg", made, quality)[1], cv2.IMREAD_COLOR), dtype=np.uint8
        )
    return made


def cast(image: Image, rng: Rng) -> Image:
    """Change exposure and white balance alone."""
    gains = _gains(rng) * np.float32(rng.uniform(0.6, 1.4))
    return np.asarray(np.clip(image * gains, 0, 255), dtype=np.uint8)


def _gains(rng: Rng) -> Floats:
    """Draw gains of red, green and blue, (3,), as far apart as those of a camera without a white balance."""
    gains = np.exp(rng.uniform(-0.7, 0.7, 3))
    return np.asarray(gains / gains.mean(), dtype=np.float32)


def _weathered(image: Image, rng: Rng) -> Image:
    """Show six views in ten in a low sun, hard shadows, fog or rain, of any strength."""
    kind, horizon = rng.random(), float(rng.uniform(0.1, 0.55))
    if kind < 0.14:
        return glare(image, rng, veil=float(rng.uniform(0.2, 1.2)))
    if kind < 0.36:
        return shadows(image, rng, left=float(rng.uniform(0.12, 0.75)), horizon=horizon)
    if kind < 0.46:
        return fog(image, visibility=float(np.exp(rng.uniform(3.2, 5.3))), horizon=horizon)
    return rain(image, rng) if kind < 0.59 else image


def _infrared(light: Floats, rng: Rng) -> Floats:
    """Add near infrared, as a camera without its filter sees it: plants shine, mostly in red and blue."""
    red, green, blue = np.moveaxis(light, -1, 0)
    plants = np.clip(2 * green - red - blue, 0.0, 1.0)
    near = light.mean(axis=-1) * np.float32(rng.uniform(0.5, 1.0)) + plants * np.float32(
        rng.uniform(0.5, 2.5)
    )
    share = np.array([1.0, rng.uniform(0.3, 0.7), rng.uniform(0.6, 1.0)], dtype=np.float32)
    seen = light + np.float32(rng.uniform(0.3, 1.2)) * near[..., None] * share
    return np.asarray(seen * (light.mean() / max(float(seen.mean()), 1e-3)), dtype=np.float32)


def _colours(rng: Rng) -> Floats:
    """Draw a colour matrix (3, 3): saturation, hue, white balance; in 6 % of all cases grey."""
    if rng.random() < 0.06:
        return np.tile(_GREY, (3, 1))
    grey = np.tile(_GREY, (3, 1))
    matrix = np.eye(3, dtype=np.float32)
    if rng.random() < 0.7:
        matrix = grey + np.float32(rng.uniform(0.4, 1.5)) * (matrix - grey)
    if rng.random() < 0.5:
        matrix = _hue(math.radians(rng.normal(0, 8))) @ matrix
    warmth, green = rng.normal(0, 0.13), rng.normal(0, 0.05)
    gains = np.exp(np.array([warmth, green, -warmth]))
    return np.asarray(np.diag(gains) @ matrix, dtype=np.float32)


def _hue(angle: float) -> Floats:
    """Make the matrix (3, 3) that turns colours about the grey axis."""
    c, s = math.cos(angle), math.sin(angle) / math.sqrt(3)
    return np.asarray(
        c * np.eye(3) + (1 - c) / 3 + s * np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]]), dtype=np.float32
    )


def _clouds(shape: tuple[int, int], rng: Rng) -> Floats:
    """Draw light that varies softly over the frame, (rows, columns)."""
    soft = np.exp(rng.normal(0, 0.3, (3, 4))).astype(np.float32)
    return np.asarray(cv2.resize(soft, shape[::-1], interpolation=cv2.INTER_CUBIC), dtype=np.float32)


def _softened(image: Image, rng: Rng) -> Image:
    if rng.random() < 0.3:
        length = int(rng.integers(3, 8))
        kernel = np.full((1, length), 1 / length, dtype=np.float32)
        return np.asarray(cv2.filter2D(image, -1, kernel), dtype=np.uint8)
    return np.asarray(cv2.GaussianBlur(image, (0, 0), rng.uniform(0.4, 1.6)), dtype=np.uint8)


def _noise(shape: tuple[int, ...], rng: Rng) -> Floats:
    strength = np.float32(rng.uniform(0.005, 0.04))
    return rng.standard_normal(shape, dtype=np.float32) * strength
