"""Turns a picture in full light into a camera's frame: the light of the moment, its colour, and noise."""

from __future__ import annotations

import math

import numpy as np

from companion.sim.field.tiles import Bytes

NOISE = 2.6  # standard deviation, of 255
_SLACK = 64  # pixels by which the stored noise is larger than a frame: each frame gets another part of it


class Sensor:
    """Exposes pictures of one size; the same seed, light and time give the same frame."""

    def __init__(self, width: int, height: int, seed: int) -> None:
        rng = np.random.default_rng([seed, 40])
        noise = rng.normal(0, NOISE, (height + _SLACK, width + _SLACK, 3))
        self._noise = np.clip(np.round(noise), -127, 127).astype(np.int8)
        self._phase = rng.uniform(0, 2 * math.pi, 3)
        self._seed = seed

    def daylight(self, t: float) -> float:
        """Returns the brightness of the daylight at a time in s, which changes slowly: 0.86 to 1.14."""
        sun, cloud, _ = self._phase
        return 1 + 0.09 * math.sin(t * 2 * math.pi / 75 + sun) + 0.05 * math.sin(t * 2 * math.pi / 21 + cloud)

    def expose(self, picture: Bytes, light: float, t: float) -> Bytes:
        """Makes the frame (H, W, 3) at a time in s. `light`: 1 is full. It compresses highlights."""
        import cv2

        warmth = 0.02 * math.sin(t * 2 * math.pi / 60 + self._phase[2])
        gain = (light * self.daylight(t)) ** 0.75 * np.array([1 + warmth, 1.0, 1 - warmth])
        level = np.arange(256)[:, None] / 255 * gain
        curve = np.where(level < 0.8, level, 0.8 + 0.2 * np.tanh((level - 0.8) / 0.2)) * 255
        lit = cv2.LUT(picture, curve.astype(np.uint8)[:, None, :])
        rows, columns = picture.shape[:2]
        y, x = np.random.default_rng([self._seed, round(abs(t) * 1000), int(t < 0)]).integers(0, _SLACK, 2)
        noise = self._noise[y : y + rows, x : x + columns]
        return np.asarray(cv2.add(lit, noise, dtype=cv2.CV_8U), np.uint8)
