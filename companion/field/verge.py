"""Tufts of grass and fern that stand along the path: no things that one could touch, but seen by a camera."""

from __future__ import annotations

import math

import numpy as np

from companion.field.things import Thing, World
from companion.field.trail import ZONES, Pose, half_width

_REACH = 8.0  # m, beyond which a tuft is only texture
_PER_METRE = {"meadow": 7.0, "forest": 6.0, "gravel": 3.5}
_SPREAD = {"meadow": 4.0, "forest": 4.5, "gravel": 4.0}  # m outward from the path's edge
_MOST = 60  # tufts in one frame


class Verge:
    """The tufts of a world; a tuft's look is 0 or 1 in the meadow, 2 or 3 in the forest, 4 or 5 on gravel."""

    def __init__(self, world: World) -> None:
        rng = np.random.default_rng([world.seed, 50])
        trail = world.trail
        self._tufts: list[Thing] = []
        for zone, (begin, end) in trail.borders.items():
            for s in rng.uniform(begin, end, int((end - begin) * _PER_METRE[zone])):
                out = float(half_width(np.asarray(s))) + 0.12 + _SPREAD[zone] * rng.uniform() ** 2.2
                side = math.copysign(out, rng.uniform(-1, 1))
                at = trail.pose(float(s))
                x, y = at.x - side * math.sin(at.heading), at.y + side * math.cos(at.heading)
                height, look = float(rng.uniform(0.14, 0.42)), 2 * ZONES.index(zone) + int(rng.integers(0, 2))
                self._tufts.append(Thing("", "tuft", x, y, height * 0.6, height, surprise=False, look=look))
        self._places = np.array([(tuft.x, tuft.y) for tuft in self._tufts])

    def near(self, pose: Pose) -> list[Thing]:
        """The tufts ahead of a pose that are near enough to stand out, at most 60 of them."""
        dx, dy = (self._places - (pose.x, pose.y)).T
        c, s = math.cos(pose.heading), math.sin(pose.heading)
        ahead, left = dx * c + dy * s, dy * c - dx * s
        seen = np.flatnonzero((ahead > 0.9) & (np.abs(left) < ahead) & (np.hypot(ahead, left) < _REACH))
        return [self._tufts[i] for i in seen[np.argsort(ahead[seen])[:_MOST]]]
