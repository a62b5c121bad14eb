"""Finds a thing that stands where nothing stood, and where the mount puts its foot: a check of the mount."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.assessment import Map
from anytraverse.ground import GroundCamera

_LEAST = 2
"""Cells of a map that a thing fills, at least."""
_EDGE = 0.5
"""Share of the greatest rise at which a thing ends: a perceiver blurs its edge."""
_FACTOR, _DEGREES, _ASIDE = 1.5, 10.0, 0.3
"""A thing stands on a mark within this factor of its distance and these degrees or, near by, metres."""


class NewThing(NamedTuple):
    """Where a new thing stands.

    metres: from the middle of the vehicle's front. degrees: clockwise from its nose. cell: m that a cell of
    the map covers there. None: not known. cut: the picture may end above its foot: it may stand nearer.
    """

    metres: float | None = None
    degrees: float | None = None
    cell: float | None = None
    cut: bool = False

    def stands_at(self, distance: float, bearing: float) -> bool:
        """Whether it may be what stands on a mark. True where its place is not known."""
        if self.metres is None or self.degrees is None or self.cell is None:
            return True
        if abs(self.metres - distance) > self.cell:
            beyond = self.metres > _FACTOR * distance and not self.cut
            if beyond or _FACTOR * self.metres < distance:
                return False
        aside = abs(math.remainder(self.degrees - bearing, 360.0))
        return aside <= max(_DEGREES, math.degrees(_ASIDE / max(distance, _ASIDE)))


def find_new_thing(
    now: Map | None, before: Map | None, least: float, ground: GroundCamera | None
) -> NewThing | None:
    """Return the largest thing by which `now` differs from `before`, None where there is none.

    now, before: strangeness, (h, w). least: rise of it that counts. ground: the camera, None: not known.
    """
    if now is None or before is None or now.shape != before.shape:
        return None
    rise = now - before
    count, parts, figures, _ = cv2.connectedComponentsWithStats(
        (rise > least).astype(np.uint8), connectivity=4
    )
    largest = 1 + int(np.argmax(figures[1:, cv2.CC_STAT_AREA])) if count > 1 else 0
    if not largest or figures[largest, cv2.CC_STAT_AREA] < _LEAST:
        return None
    thing = np.where(parts == largest, rise, 0.0)
    return _placed(thing >= _EDGE * float(thing.max()), ground)


def _placed(thing: NDArray[np.bool_], ground: GroundCamera | None) -> NewThing:
    """Return where the lowest row of a mask (h, w) meets the ground."""
    if ground is None:
        return NewThing()
    height, width = thing.shape
    row = int(np.flatnonzero(thing.any(axis=1))[-1])
    column = (float(np.flatnonzero(thing[row]).mean()) + 0.5) / width
    places = np.array([(column, (row + part) / height) for part in (0.0, 0.5, 1.0)])
    points = ground.to_ground(places) - (ground.front, 0.0)
    if not np.isfinite(points).all():
        return NewThing()
    far, middle, near = (math.hypot(*point) for point in points)
    degrees = math.degrees(math.atan2(-points[1, 1], points[1, 0]))
    return NewThing(middle, degrees, far - near, cut=row == height - 1)
