"""Calculates the lines by which a person sees in a picture where a camera's mount puts the ground. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from anytraverse.ground import RELIABLE, GroundCamera

LineKind = Literal["horizon", "metre", "side", "assumed", "stop"]
ASSUMED_WIDTH = 1.0
"""Metres between the side lines of a vehicle whose width is not set."""
_ACROSS = 3.0
"""Metres to either side of the vehicle's middle to which a line across the ground goes."""
_SIDEWAYS = math.radians(85.0)
"""To either side of the lens axis. A camera that follows the pinhole model sees no more of the horizon."""
_NEAREST = 1e-3
"""Metres of depth: nothing nearer to the lens is drawn."""
_INSIDE = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 1.0]])
"""What homogeneous places in the picture are at least 0 in: its four sides, and their depth."""

Homogeneous = tuple[float, float, float]


@dataclass(frozen=True)
class GroundLine:
    """A straight line of the ground in a picture, in fractions of its width and height, cut at its edge.

    kind: the horizon; one across the ground some metres ahead; a side of the way that the vehicle takes, of
    its own width or an assumed one; or where it stands after it was stopped. start: its left or near end.
    """

    kind: LineKind
    label: str
    start: tuple[float, float]
    end: tuple[float, float]

    @property
    def labelled(self) -> tuple[float, float]:
        """The end at which the label stands. Where it stops is labelled apart from the metres."""
        return self.start if self.kind == "stop" else self.end


def ground_lines(
    camera: GroundCamera, width: float | None = None, stops: float | None = None
) -> tuple[GroundLine, ...]:
    """Return what is seen of the lines, up to `RELIABLE` metres ahead of the vehicle's front.

    width: of the vehicle in m, None where it is not set. stops: metres in which it stops, None where that is
    not known.
    """
    front, heading = camera.front, math.radians(-camera.heading)
    left, right = heading + _SIDEWAYS, heading - _SIDEWAYS
    side = (ASSUMED_WIDTH if width is None else width) / 2
    kind: LineKind = "assumed" if width is None else "side"
    found = [
        _line(
            camera,
            "horizon",
            "horizon",
            (math.cos(left), math.sin(left), 0.0),
            (math.cos(right), math.sin(right), 0.0),
        ),
        *(_across(camera, "metre", f"{metres} m", metres) for metres in range(1, int(RELIABLE) + 1)),
        *(
            _line(camera, kind, label, (front, y, 1.0), (front + RELIABLE, y, 1.0))
            for label, y in (("", side), (f"{2 * side:g} m wide", -side))
        ),
    ]
    if stops is not None and stops <= RELIABLE:
        found.append(_across(camera, "stop", f"stops in {stops:.1f} m", stops))
    return tuple(line for line in found if line is not None)


def horizon_row(camera: GroundCamera) -> float:
    """Return the row of the horizon in the picture's middle column; it may be outside [0, 1]."""
    across, down, constant = np.linalg.inv(camera.homography)[2]
    return float(-(0.5 * across + constant) / down)


def _across(camera: GroundCamera, kind: LineKind, label: str, metres: float) -> GroundLine | None:
    x = camera.front + metres
    return _line(camera, kind, label, (x, _ACROSS, 1.0), (x, -_ACROSS, 1.0))


def _line(
    camera: GroundCamera, kind: LineKind, label: str, start: Homogeneous, end: Homogeneous
) -> GroundLine | None:
    """Return what is seen of a line between two ground points, by Liang and Barsky; None where nothing is.

    It is cut before the division by the depth, since a part of it may be behind the lens.
    """
    ends = np.array([start, end]) @ camera.homography.T
    first, last = ends @ _INSIDE.T - [0.0, 0.0, 0.0, 0.0, _NEAREST]
    enters, leaves = 0.0, 1.0
    for before, after in zip(first, last, strict=True):
        if before < 0 and after < 0:
            return None
        if before < 0:
            enters = max(enters, before / (before - after))
        elif after < 0:
            leaves = min(leaves, before / (before - after))
    if enters >= leaves:
        return None
    cut = [ends[0] + part * (ends[1] - ends[0]) for part in (enters, leaves)]
    (u0, v0), (u1, v1) = ((float(x / depth), float(y / depth)) for x, y, depth in cut)
    return GroundLine(kind, label, (u0, v0), (u1, v1))
