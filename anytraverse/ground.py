"""Calculates where a camera's pixels meet level ground, and where ground appears in its picture.

Ground coordinates are in metres: x ahead along the vehicle's nose, y to its left, from the point below the
lens. Places in a picture are fractions of its width and height. The ground is the plane on which the vehicle
stands: what stands on it marks the ground only with its foot, and what it hides is unknown.
Source: Hartley and Zisserman, "Multiple View Geometry in Computer Vision", 2nd edition, sections 6.1 and 8.1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import SettingsError
from anytraverse.regions import Quad, TileScale

Points = NDArray[np.float64]
Matrix = NDArray[np.float64]

RELIABLE = 6.0
"""Metres. Beyond, a tilt that is wrong by 1 degree moves the ground by a metre: nothing is told there."""
STEEPEST = 12.0
"""Degrees. Where a vehicle leans by more against the ground, half of the region may be out of the picture."""
_ROUNDING = 1e-6
_NEAR_HORIZON = 0.3
"""So near to the horizon, of the way from it to the far side, a region that is lengthened ends at most."""
WIDEST = 120.0
"""Degrees. A wider view does not follow the pinhole model."""


@dataclass(frozen=True)
class Lens:
    """A pinhole: focal lengths and the lens axis, as fractions of the picture's width (x) and height (y)."""

    focal_x: float
    focal_y: float
    centre_x: float = 0.5
    centre_y: float = 0.5

    @classmethod
    def of_view(cls, view: float, aspect: float) -> Lens:
        """Take a horizontal view in degrees, below 180. aspect: width by height of the picture."""
        focal = 0.5 / math.tan(math.radians(view / 2.0))
        return cls(focal, focal * aspect)

    @property
    def aspect(self) -> float:
        """Width by height of the picture, whose pixels are square."""
        return self.focal_y / self.focal_x

    @property
    def matrix(self) -> Matrix:
        """From directions (right, down, ahead) to places in the picture, (3, 3)."""
        return np.array(
            [[self.focal_x, 0.0, self.centre_x], [0.0, self.focal_y, self.centre_y], [0.0, 0.0, 1.0]]
        )


@dataclass(frozen=True)
class GroundCamera:
    """A camera on its vehicle above level ground.

    height: m above the ground. tilt: degrees of the lens axis below the horizon. front: m from the lens to
    the vehicle's front. roll: degrees, positive where the camera's right side is down. heading: degrees
    clockwise from the vehicle's nose. pitch, bank: by which the vehicle leans against the ground on which
    it stands, as ATTITUDE counts: nose up and right side down are positive.
    The lens stays where it is while the vehicle leans: it moves by few centimetres.
    """

    lens: Lens
    height: float
    tilt: float
    front: float = 0.0
    roll: float = 0.0
    heading: float = 0.0
    pitch: float = 0.0
    bank: float = 0.0

    @classmethod
    def pinhole(
        cls, height: float, tilt: float, view: float, aspect: float, front: float = 0.0
    ) -> GroundCamera:
        """Make one of a horizontal view in degrees. aspect: width by height of the picture."""
        return cls(Lens.of_view(view, aspect), height, tilt, front)

    def leaning(self, pitch: float, bank: float) -> GroundCamera:
        """Return this camera at a moment at which the vehicle leans so, in degrees."""
        return replace(self, pitch=pitch, bank=bank)

    @property
    def homography(self) -> Matrix:
        """From the ground (x, y, 1) to the picture, homogeneous, (3, 3); its third row is the depth in m."""
        plane = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -self.height]])
        return np.asarray(self.lens.matrix @ self._rotation.T @ plane)

    def to_picture(self, ground: Points) -> Points:
        """Return where ground points (n, 2) in m appear, (n, 2); NaN for what is not in front of the lens."""
        seen = np.column_stack([ground, np.ones(len(ground))]) @ self.homography.T
        depth = np.where(seen[:, 2:] > 0.0, seen[:, 2:], np.nan)
        return np.asarray(seen[:, :2] / depth)

    def to_ground(self, places: Points) -> Points:
        """Return where places (n, 2) of the picture meet the ground, (n, 2) in m; NaN from the horizon up."""
        directions = np.column_stack([places, np.ones(len(places))]) @ np.linalg.inv(self.lens.matrix).T
        rays = directions @ self._rotation.T
        falls = np.where(rays[:, 2:] < 0.0, rays[:, 2:], np.nan)
        return np.asarray(-self.height * rays[:, :2] / falls)

    def nearest(self, width: float) -> float:
        """Return the metres from the vehicle's front to the nearest ground that is `width` m wide in view.

        For a vehicle that does not lean. Infinite where there is none within `RELIABLE` m of the lens.
        """
        ahead = np.arange(max(0.05, self.front), RELIABLE, 0.05)
        inside = np.ones(len(ahead), dtype=np.bool_)
        for side in (-width / 2, width / 2):
            seen = self.to_picture(np.column_stack([ahead, np.full(len(ahead), side)]))
            inside &= ((seen >= 0.0) & (seen <= 1.0)).all(axis=1)
        return float(ahead[np.argmax(inside)]) - self.front if inside.any() else math.inf

    def distance(self, row: float) -> float:
        """Return the metres from the vehicle's front to where a row (0 top, 1 bottom) meets the ground.

        In the picture's middle column, for a vehicle that does not lean. Infinite at the horizon and above
        it; never negative.
        """
        tilt, down = math.radians(self.tilt), (row - self.lens.centre_y) / self.lens.focal_y
        drop = math.sin(tilt) + down * math.cos(tilt)
        if drop <= 0:
            return math.inf
        ahead = math.cos(tilt) - down * math.sin(tilt)
        return max(0.0, self.height * ahead / drop - self.front)

    def row(self, distance: float) -> float:
        """Return the row that meets the ground at `distance` metres; outside [0, 1]: not in the image."""
        tilt, ahead = math.radians(self.tilt), distance + self.front
        across = self.height * math.cos(tilt) - ahead * math.sin(tilt)
        along = self.height * math.sin(tilt) + ahead * math.cos(tilt)
        return self.lens.centre_y + self.lens.focal_y * across / along if along > 0 else math.inf

    def width(self, metres: float, distance: float) -> float:
        """Return how wide a thing of `metres` appears at `distance` metres, over the image's width.

        Infinite for a thing that is not in front of the lens.
        """
        tilt = math.radians(self.tilt)
        along = self.height * math.sin(tilt) + (distance + self.front) * math.cos(tilt)
        return metres * self.lens.focal_x / along if along > 0 else math.inf

    def farthest(self, metres: float, width: float) -> float:
        """Return up to which distance in m a thing of `metres` appears at least `width` wide; at least 0."""
        tilt = math.radians(self.tilt)
        along = metres * self.lens.focal_x / width
        return max(0.0, (along - self.height * math.sin(tilt)) / math.cos(tilt) - self.front)

    @property
    def _rotation(self) -> Matrix:
        """From the camera's axes (right, down, ahead) to the ground's (ahead, left, up), (3, 3)."""
        axes = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
        mount = _turned(-self.heading, 2) @ _turned(self.tilt, 1) @ _turned(self.roll, 0)
        return np.asarray(_turned(-self.pitch, 1) @ _turned(self.bank, 0) @ mount @ axes)


@dataclass(frozen=True)
class GroundRegion:
    """A region of interest on the ground, in front of the vehicle and as wide on its left as on its right.

    near, far: m from the vehicle's front. width: m. vehicle: the vehicle's width, m. tile: side in m of the
    upright square that a thing fills when it is noticed. Raises SettingsError where it holds no ground, is
    narrower than the vehicle, or reaches beyond `RELIABLE` metres from the lens.
    """

    camera: GroundCamera
    near: float
    far: float
    width: float
    vehicle: float
    tile: float = 0.4

    def __post_init__(self) -> None:
        if not 0.0 <= self.near < self.far:
            raise SettingsError(f"the region from {self.near:g} to {self.far:g} m holds no ground")
        if not 0.0 < self.vehicle <= self.width:
            raise SettingsError(f"region {self.width:g} m wide, vehicle {self.vehicle:g}: widen it")
        if self.camera.front + self.far > RELIABLE + _ROUNDING:
            most = RELIABLE - self.camera.front
            raise SettingsError(f"region ends {self.far:.1f} m ahead, the ground is known to {most:.1f}")
        if self.tile <= 0.0:
            raise SettingsError(f"a tile of {self.tile:g} m holds nothing")

    @classmethod
    def in_view(
        cls, camera: GroundCamera, near: float, far: float, width: float, vehicle: float
    ) -> GroundRegion:
        """Make one that begins no nearer than its ground is in view, and ends where the ground is known."""
        near, far = max(near, camera.nearest(width)), min(far, RELIABLE - camera.front)
        return cls(camera, near, far, width, vehicle)

    def reaching(self, reach: float | None) -> GroundRegion:
        """Return one that ends at `reach` m, or where ground is known; itself where that is no farther."""
        if reach is None or reach <= self.far:
            return self
        return replace(self, far=min(reach, RELIABLE - self.camera.front))

    def in_picture(self, lean: tuple[float, float] | None) -> RegionInPicture:
        """Return how it appears when the vehicle leans so: pitch and bank in degrees, None: not at all."""
        return _in_picture(self, lean or (0.0, 0.0))


@dataclass(frozen=True)
class RegionInPicture:
    """How a region of the ground appears in a picture.

    region: where it lies. near, far: (row, width of the vehicle there) in fractions of the picture's height
    and width; the row may lie outside of it. rows: between them the vehicle's whole width is in the region.
    tiles: how large a tile is. When the nose goes up, `region` ends no nearer than for a vehicle that does
    not lean: the first metres of a climb look like a swing, and must not hide what is on them.
    """

    region: Quad
    near: tuple[float, float]
    far: tuple[float, float]
    rows: tuple[float, float]
    tiles: TileScale


NOWHERE = Quad(((-1.0, -1.0),) * 4)
"""Of a region that is not in the picture: it holds no pixel."""


@lru_cache(64)
def _in_picture(ground: GroundRegion, lean: tuple[float, float]) -> RegionInPicture:
    camera = ground.camera.leaning(*lean)
    near, far = camera.front + ground.near, camera.front + ground.far
    halves = (ground.width / 2, ground.vehicle / 2, ground.tile / 2)
    points = [(x, half * side) for half in halves for x in (near, far) for side in (1, -1)]
    seen = camera.to_picture(np.array(points)).reshape(3, 2, 2, 2)  # half, near or far, left or right, x or y
    rows, widths = seen[..., 1].mean(axis=2), seen[:, :, 1, 0] - seen[:, :, 0, 0]
    if not (np.isfinite(seen).all() and widths.min() > 0.0 and rows[2, 0] > rows[2, 1]):
        return RegionInPicture(NOWHERE, (0.0, 1.0), (0.0, 1.0), (0.0, 0.0), TileScale(0.0, 1.0))
    slope = float((widths[2, 0] - widths[2, 1]) / (rows[2, 0] - rows[2, 1]))
    horizon = float(rows[2, 0] - widths[2, 0] / slope)
    ends = seen[0, 1]
    if lean[0] > 0.0:
        lower = max(0.0, float(ends[:, 1].mean()) - ground.in_picture(None).far[0])
        highest = horizon + _NEAR_HORIZON * (ends[:, 1] - horizon)
        tops = np.minimum(ends[:, 1], np.maximum(ends[:, 1] - lower, highest))
        ends = (
            ends
            + (ends - seen[0, 0]) * ((tops - ends[:, 1]) / (ends[:, 1] - seen[0, 0][:, 1]))[:, np.newaxis]
        )
    corners = [(float(x), float(y)) for x, y in (*ends, seen[0, 0][1], seen[0, 0][0])]
    return RegionInPicture(
        Quad((corners[0], corners[1], corners[2], corners[3])),
        (float(rows[1, 0]), float(widths[1, 0])),
        (float(rows[1, 1]), float(widths[1, 1])),
        (float(seen[1, 1, :, 1].max()), float(seen[1, 0, :, 1].min())),
        TileScale(horizon, slope),
    )


def _turned(degrees: float, axis: int) -> Matrix:
    """Return the rotation about an axis (0 ahead, 1 left, 2 up) by the right-hand rule, (3, 3)."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    one, other = [(1, 2), (2, 0), (0, 1)][axis]
    turned = np.eye(3)
    turned[one, one] = turned[other, other] = c
    turned[one, other], turned[other, one] = -s, s
    return turned
