"""Defines a camera's frame, with the id and capture time that go with it to the last message."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import PerceiverError

Image = NDArray[np.uint8]
"""RGB, (height, width, 3), uint8."""
Depth = NDArray[np.uint16]
"""Millimetres along the lens axis at each pixel of a picture, (height, width), uint16; 0: not known."""
Intrinsics = tuple[float, float, float, float]
"""Of the picture as it is: focal lengths in x and y, and the x and y of the lens axis, all in pixels."""


class Pose(NamedTuple):
    """A place and heading of the vehicle by odometry: in m and degrees, from a start that is anywhere.

    x, y: on the ground, y to the left of x. heading: of the nose from x, counter-clockwise.
    """

    x: float
    y: float
    heading: float


@dataclass(frozen=True, eq=False)
class Frame:
    """Holds one picture.

    id: rises by at least one from frame to frame of one camera.
    captured_at: seconds on the caller's monotonic clock.
    image: RGB, (height, width, 3), uint8.
    depth, intrinsics: None where the camera does not tell.
    lean: degrees of pitch (nose up) and bank (right side down) by which the vehicle leant against the ground
    on which it stood; None where that is not known.
    pose: where the vehicle was and how it was turned, by odometry; None where that is not known.
    reach: m ahead of its front up to which the ground must be judged for its speed; None: as the settings
    say.
    """

    id: int
    captured_at: float
    image: Image
    depth: Depth | None = None
    intrinsics: Intrinsics | None = None
    lean: tuple[float, float] | None = None
    pose: Pose | None = None
    reach: float | None = None


def is_image(image: Any) -> bool:
    """Return whether `image` is a non-empty RGB uint8 array."""
    return (
        isinstance(image, np.ndarray)
        and image.dtype == np.uint8
        and image.ndim == 3
        and image.shape[2] == 3
        and image.size > 0
    )


def is_depth(depth: Any, image: Image) -> bool:
    """Return whether `depth` is a `Depth` of this picture."""
    return isinstance(depth, np.ndarray) and depth.dtype == np.uint16 and depth.shape == image.shape[:2]


def is_intrinsics(intrinsics: Any) -> bool:
    """Return whether `intrinsics` are four finite floats, the first two of them positive."""
    right = isinstance(intrinsics, tuple) and len(intrinsics) == 4
    right = right and all(isinstance(one, float) and math.isfinite(one) for one in intrinsics)
    return right and min(intrinsics[:2]) > 0.0


def check_image(image: Any) -> None:
    """Raise PerceiverError unless `image` is a non-empty RGB uint8 array."""
    if not is_image(image):
        raise PerceiverError("a frame must be an RGB picture, (height, width, 3) of uint8, not empty")


def is_black(image: Image, level: float = 4.0) -> bool:
    """Return whether the mean of the picture is below `level` of 255 (lens cap, camera starting)."""
    return float(image.mean()) < level
