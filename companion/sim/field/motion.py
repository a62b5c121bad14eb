"""Tilts the simulated rover: it swings while it drives, jolts over bumps and follows the ground's slopes.

Angles are in rad with MAVLink's signs: pitch is positive nose up, roll right side down. Lengths are in m,
times in s, speeds in m/s. The same seed gives the same motion.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from companion.sim.field.trail import Trail

PITCHES, ROLLS = 0.7, 0.53  # Hz of the swing
ROLL_SHARE = 0.6  # of the swing's pitch that its roll has
SWINGS_FROM = 0.5  # m/s from which the swing is full; at standstill there is none
BUMP_GAP, BUMP_LENGTH = 6.0, 0.5  # m from bump to bump on average; m
SHORTEST_WAVE, LONGEST_WAVE = 25.0, 90.0  # m of the trail's climbs and falls
SEEN = 2.0, 6.0  # m ahead, between which the ground has the slope that the picture shows
_INSTANT = 1e-3  # s


class Tilt(NamedTuple):
    """How the rover leans against the plane of the ground that its camera sees; rad."""

    pitch: float = 0.0
    roll: float = 0.0


LEVEL = Tilt()


class Attitude(NamedTuple):
    """How the rover leans against the horizontal (rad), and how fast that changes (rad/s).

    slope_ahead: rad by which the ground climbs between `SEEN` m ahead of it.
    """

    pitch: float = 0.0
    roll: float = 0.0
    pitch_rate: float = 0.0
    roll_rate: float = 0.0
    slope_ahead: float = 0.0

    @property
    def tilt(self) -> Tilt:
        return Tilt(self.pitch - self.slope_ahead, self.roll)


class RoverMotion:
    """The attitude of a rover on a trail as a function of time, place and speed.

    The ground's height depends on the place along the trail alone. The rover leans as the ground under it
    does; its camera shows one plane, which climbs as the ground `SEEN` m ahead does on average, and that
    plane's horizon. To its sides the ground is level. Neither its speed nor its altitude follows the slopes.
    """

    def __init__(
        self, trail: Trail, seed: int = 0, *, swing: float = 0.0, bumps: float = 0.0, slopes: float = 0.0
    ) -> None:
        """swing, bumps: rad of pitch at most. slopes: rad of the steepest climb of the trail."""
        rng = np.random.default_rng([seed, 60])
        self._still = swing == bumps == slopes == 0
        self._swing, self._length = swing, trail.length
        self._phases = rng.uniform(0, math.tau, 2)
        count = max(1, round(trail.length / BUMP_GAP))
        self._bumps_at = (np.arange(count) + rng.uniform(0.2, 0.8, count)) * trail.length / count
        signs, share = rng.choice([-1, 1], (2, count)), rng.uniform(0.3, 1.0, count)
        self._bumps = bumps * signs * np.stack([np.ones(count), share])  # pitch and roll at each one's top
        most = max(1, int(trail.length / SHORTEST_WAVE))
        waves = np.arange(min(most, math.ceil(trail.length / LONGEST_WAVE)), most + 1)
        self._waves = np.stack([waves * math.tau / trail.length, rng.uniform(0, math.tau, len(waves))])
        places = np.arange(0.0, trail.length, 0.1)[:, None]
        steepest = np.abs(np.cos(self._waves[0] * places + self._waves[1]).sum(axis=1)).max()
        self._climb = math.tan(slopes) / float(steepest)  # of each wave

    def at(self, t: float, s: float, speed: float, bearing: float = 0.0) -> Attitude:
        """Returns the attitude at a time, a place along the trail and a speed (negative: backwards).

        bearing: rad from the trail's direction to the rover's, counterclockwise. The rates are those at this
        speed and bearing if they stay.
        """
        if self._still:
            return Attitude()
        along = math.cos(bearing)
        later = self._angles(t + _INSTANT, s + speed * along * _INSTANT, speed, bearing)
        sooner = self._angles(t - _INSTANT, s - speed * along * _INSTANT, speed, bearing)
        pitch, roll = self._angles(t, s, speed, bearing)
        pitch_rate, roll_rate = ((b - a) / (2 * _INSTANT) for a, b in zip(sooner, later, strict=True))
        near, far = (s + metres * along for metres in SEEN)
        ahead = math.atan((self._height(far) - self._height(near)) / (SEEN[1] - SEEN[0]))
        return Attitude(pitch, roll, pitch_rate, roll_rate, ahead)

    def _angles(self, t: float, s: float, speed: float, bearing: float) -> tuple[float, float]:
        share = min(1.0, abs(speed) / SWINGS_FROM)
        swing = self._swing * share * share * (3 - 2 * share)
        away = (s - self._bumps_at + self._length / 2) % self._length - self._length / 2
        on = np.where(np.abs(away) < BUMP_LENGTH / 2, 0.5 + 0.5 * np.cos(away * math.tau / BUMP_LENGTH), 0.0)
        pitch, roll = self._bumps @ on
        waves, phases = self._waves
        climb = self._climb * float(np.cos(waves * s + phases).sum())
        pitch += math.atan(climb * math.cos(bearing))
        pitch += swing * math.sin(math.tau * PITCHES * t + self._phases[0])
        roll += ROLL_SHARE * swing * math.sin(math.tau * ROLLS * t + self._phases[1])
        return float(pitch), float(roll)

    def _height(self, s: float) -> float:
        """Returns the height of the ground at a place in m."""
        waves, phases = self._waves
        return self._climb * float((np.sin(waves * s + phases) / waves).sum())
