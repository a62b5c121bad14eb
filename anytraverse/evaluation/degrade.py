"""Degrades frames as light, weather, lenses and cameras do: by name, and a frame always in the same way.

Light is calculated as linear light (IEC 61966-2-1, sRGB). Each docstring gives the strength: hard, but usual.
Lengths are relative to the picture's width.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable

import cv2
import numpy as np

from anytraverse.evaluation.light import LUMINANCE, blurred, coded, filtered, line, linear
from anytraverse.evaluation.weather import VIEW, fog, glare, rain, shadows
from anytraverse.frame import Image

Rng = np.random.Generator
Change = Callable[[Image, Rng], Image]

_LAMP = 2.104, 0.268
"""Red and blue of a black body at 2850 K against one at 6500 K, green being equal (CIE 1931, sRGB)."""


def tinted(image: Image, gains: tuple[float, float, float]) -> Image:
    """Multiply red, green and blue light by `gains`; the exposure is set so that grey keeps its luminance."""
    factors = np.array(gains, dtype=np.float32)
    return coded(linear(image) * (factors / np.dot(factors, LUMINANCE)))


def green(image: Image) -> Image:
    """As through a filter CC40G (density 0.4): 40 % of the red and blue light is left."""
    return tinted(image, (0.4, 1.0, 0.4))


def magenta(image: Image, strength: float = 1.0) -> Image:
    """As through a filter CC50M (density 0.5): 32 % of the green light is left.

    The plain cast of a NoIR camera; `infrared` also changes what plants look like. strength: 0 for none.
    """
    return tinted(image, (1.0, 10 ** (-0.5 * strength), 1.0))


def infrared(image: Image, strength: float = 1.0) -> Image:
    """As a camera without infrared filter (NoIR) that is balanced for visible light.

    All three colour filters of a sensor pass near infrared, and the balance raises red and blue. So
    (1.2, 0.45, 0.85) times the infrared light is added to (R, G, B); exposure keeps the median luminance.
    The infrared light is a guess from the colour: 1.5 times the visible light, but up to 6 times for green
    leaves (which reflect 5 to 10 % of visible light, and half of the near infrared), and half for the sky.
    strength: share of the near infrared that gets to the sensor, 0 for none.
    """
    light = linear(image)
    visible = light @ LUMINANCE
    smooth = blurred(light, max(0.5, image.shape[1] / 200))
    red, green, blue = np.moveaxis(smooth, 2, 0)
    total = red + green + blue + np.float32(1e-3)
    leaves = np.clip((2 * green - red - blue) / total / np.float32(0.25), 0.0, 1.0)
    blue_sky, white_sky = (blue - red) / total / np.float32(0.2), (smooth.min(axis=2) - np.float32(0.6)) * 2.5
    sky = np.clip(np.maximum(blue_sky, white_sky), 0.0, 1.0)
    unseen = visible * ((1.5 + 4.5 * leaves) * (1 - sky) + 0.5 * sky)
    added = light + np.float32(strength) * unseen[..., None] * np.array([1.2, 0.45, 0.85], dtype=np.float32)
    exposure = (np.median(visible) + 1e-6) / (np.median(added @ LUMINANCE) + 1e-6)
    return coded(added * np.float32(exposure))


def cold(image: Image) -> Image:
    """Very cold: daylight of 6500 K, white balance fixed at 2850 K (lamplight; 197 mired too blue)."""
    return tinted(image, (1 / _LAMP[0], 1.0, 1 / _LAMP[1]))


def warm(image: Image) -> Image:
    """Very warm: lamplight of 2850 K, white balance fixed at daylight, 6500 K (197 mired too red)."""
    return tinted(image, (_LAMP[0], 1.0, _LAMP[1]))


def white_balance(image: Image, rng: Rng) -> Image:
    """A wrong white balance: 40 to 120 mired off, and up to CC15 too green or magenta."""
    shift = float(rng.choice([-1.0, 1.0]) * rng.uniform(40, 120)) / 197
    tint = 10 ** float(rng.uniform(-0.15, 0.15))
    return tinted(image, (_LAMP[0] ** shift, tint, _LAMP[1] ** shift))


def half_light(image: Image) -> Image:
    """Half the light: one stop underexposed."""
    return coded(linear(image) * np.float32(0.5))


def bright(image: Image) -> Image:
    """1.7 times the light: overexposed, and the brightest clipped."""
    return coded(linear(image) * np.float32(1.7))


def dusk(image: Image, rng: Rng) -> Image:
    """Dusk: 18 % of the light at the longest exposure, bluish (10000 K), with the noise of a high gain.

    White is 600 electrons, and reading adds 4: the noise of a pixel is sqrt(600 L + 16) / 600.
    """
    light = linear(image) * np.array([0.83, 1.0, 1.37], dtype=np.float32) * np.float32(0.18)
    noise = rng.standard_normal(light.shape, dtype=np.float32)
    noise *= np.sqrt(np.maximum(light, 0.0) * np.float32(600) + 16) / np.float32(600)
    return coded(light + noise)


def motion_blur(image: Image, rng: Rng) -> Image:
    """Motion blur of a turn at 30 degrees/s or a bump, exposed for 1/30 s: 1 degree in any direction."""
    length = max(2, round(image.shape[1] / VIEW))
    return coded(filtered(linear(image), line(length, float(rng.uniform(0, 180)))))


def defocus(image: Image) -> Image:
    """Out of focus: each point is a disc with a radius of 0.6 % of the picture's width."""
    radius = max(1.0, 0.006 * image.shape[1])
    reach = math.ceil(radius)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    disc = np.clip(radius + 0.5 - np.sqrt(x**2 + y**2), 0, 1).astype(np.float32)
    return coded(filtered(linear(image), disc / disc.sum()))


def jpeg(image: Image) -> Image:
    """Strong JPEG compression: quality 10 of 100, colours at half the resolution."""
    done, data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 10])
    picture = cv2.imdecode(data, cv2.IMREAD_COLOR) if done else None
    if picture is None:
        raise ValueError("OpenCV could not compress the picture")
    return np.ascontiguousarray(picture[..., ::-1], dtype=np.uint8)


def _fixed(change: Callable[[Image], Image]) -> Change:
    return lambda image, _: change(image)


DEGRADATIONS: dict[str, Change] = {
    "green": _fixed(green),
    "magenta": _fixed(magenta),
    "infrared": _fixed(infrared),
    "cold": _fixed(cold),
    "warm": _fixed(warm),
    "white-balance": white_balance,
    "half-light": _fixed(half_light),
    "bright": _fixed(bright),
    "dusk": dusk,
    "glare": glare,
    "shadows": shadows,
    "fog": _fixed(fog),
    "rain": rain,
    "motion-blur": motion_blur,
    "defocus": _fixed(defocus),
    "jpeg": _fixed(jpeg),
}
"""Name -> what changes a picture, RGB (height, width, 3) uint8, into one of the same shape."""


def degraded(image: Image, name: str, number: int) -> Image:
    """Return a frame under the degradation `name`, a key of `DEGRADATIONS`. Deterministic.

    image: RGB, (height, width, 3) uint8, not empty; it is not changed. number: the frame's, at least 0: what
    is left to chance (where shadows lie) is drawn by it and the name.
    """
    return DEGRADATIONS[name](image, np.random.default_rng([number, zlib.crc32(name.encode())]))
