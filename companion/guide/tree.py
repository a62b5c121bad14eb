"""Lists the ways that a plan chooses from: pairs of arcs that begin at the lens."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from anytraverse.ground import RELIABLE

Floats = NDArray[np.float64]
Layer = NDArray[np.float32]

STEP = 0.15
"""m from one checked point of a way to the next."""
TIGHTEST = 0.1
"""m: the radius of a turn, at least."""
_FIRST, _SECOND, _SWITCHES = 23, 9, (1.2, 2.4)
"""Curvatures of the first and of the second arc, and m after which it begins."""


class ArcTree(NamedTuple):
    """All the ways from the lens.

    points: (n, steps, 2), m ahead and to the left. headings: (n, steps), rad to the left.
    noses: (n, steps, 2), where these point to, 1 m long. arcs: (n, 3): curvature of the first and of the
    second arc in 1/m, and m after which the second begins.
    """

    points: Layer
    headings: Layer
    noses: Layer
    arcs: Floats


@lru_cache(8)
def tree_of(radius: float) -> ArcTree:
    """Return all ways of a vehicle whose tightest turn has this radius in m."""
    one, other = (np.linspace(-1.0, 1.0, count) for count in (_FIRST, _SECOND))
    pairs = np.meshgrid(one * np.abs(one) / radius, other * np.abs(other) / radius, _SWITCHES)
    arcs = np.stack([each.ravel() for each in pairs], axis=1)
    points, headings = points_of(arcs, np.arange(0.0, RELIABLE + STEP / 2, STEP))
    noses = np.stack([np.cos(headings), np.sin(headings)], axis=-1)
    return ArcTree(points.astype(np.float32), headings.astype(np.float32), noses.astype(np.float32), arcs)


def points_of(arcs: Floats, ways: Floats) -> tuple[Floats, Floats]:
    """Return points (n, steps, 2) and headings (n, steps) after so many m of arcs, see `ArcTree`."""
    first, second, switch = arcs.T[..., np.newaxis]
    early, late = np.minimum(ways, switch), np.maximum(ways - switch, 0.0)
    x, y = _arc(first, early)
    turn = first * early
    ahead, left = _arc(second, late)
    c, s = np.cos(turn), np.sin(turn)
    return np.stack([x + c * ahead - s * left, y + s * ahead + c * left], axis=-1), turn + second * late


def _arc(curvature: Floats, way: Floats) -> tuple[Floats, Floats]:
    """Return how many m ahead and to the left an arc leads."""
    half = curvature * way / 2.0
    chord = way * np.sinc(half / math.pi)
    return chord * np.cos(half), chord * np.sin(half)
