"""Keeps where a rover has been, and reads a picture to draw it on. Pure, but for reading that picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

from anytraverse.regular_file import read_regular
from gcs_plugin.client.vehicle import Position

MOST_POINTS = 400
FIRST_STEP = 1.0
"""Metres between two points, at first. With each thinning out it doubles."""
LARGEST_BACKGROUND = 20_000_000
_METRES_PER_DEGREE = 111_320.0
_KINDS = {b"\x89PNG\r\n\x1a\n": "image/png", b"\xff\xd8\xff": "image/jpeg"}


class Track:
    """The way of a rover, at most `MOST_POINTS` of it. revision: rises with each point."""

    def __init__(self) -> None:
        self.points: list[tuple[float, float]] = []
        """Latitude and longitude in degrees, the oldest first."""
        self.revision = 0
        self._step = FIRST_STEP

    def follow(self, position: Position) -> bool:
        """Take in where it is. Returns whether that made a point."""
        if self.points and _metres(self.points[-1], position) < self._step:
            return False
        self.points.append((round(position.latitude, 7), round(position.longitude, 7)))
        self.revision += 1
        if len(self.points) > MOST_POINTS:
            self.points = self.points[::2]
            self._step *= 2
        return True


def _metres(point: tuple[float, float], position: Position) -> float:
    """Return the distance to a point nearby, as if the earth were flat there."""
    north = position.latitude - point[0]
    east = math.remainder(position.longitude - point[1], 360.0)  # also across longitude 180
    return _METRES_PER_DEGREE * math.hypot(north, east * math.cos(math.radians(point[0])))


@dataclass(frozen=True)
class Background:
    """A picture to draw tracks on. corners: north, west, south and east, degrees."""

    content: bytes
    kind: str
    corners: tuple[float, float, float, float]


def read_background(text: str) -> Background:
    """Read the picture of "FILE@NORTH,WEST,SOUTH,EAST". Raises ValueError, whose text says what to do."""
    file, at, sides = text.rpartition("@")
    try:
        north, west, south, east = map(float, sides.split(","))
    except ValueError as error:
        raise ValueError(
            "--background is FILE@NORTH,WEST,SOUTH,EAST: a picture, its upper left and lower right corner"
        ) from error
    if not (at and -90 <= south < north <= 90 and -180 <= west < east <= 180):
        raise ValueError(f"--background: {sides} is no upper left and lower right corner in degrees")
    try:
        content = read_regular(file, LARGEST_BACKGROUND + 1)
    except OSError as error:
        raise ValueError(f"--background: {file}: {error.strerror}") from error
    kind = next((kind for magic, kind in _KINDS.items() if content.startswith(magic)), None)
    if kind is None or len(content) > LARGEST_BACKGROUND:
        raise ValueError(f"--background: {file} is no PNG or JPEG of at most {LARGEST_BACKGROUND} bytes")
    return Background(content, kind, (north, west, south, east))
