"""Straightens the pictures of a calibrated camera, so that all who see them see those of an exact pinhole."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from anytraverse.frame import Depth, Image, Intrinsics, is_depth, is_image
from companion.cameras import BadFrame, Camera, Capture
from companion.cameras.calibration import LensCalibration


class RectifiedCamera:
    """Delivers what another camera does, rectified, in the size in which it comes."""

    def __init__(self, camera: Camera, calibration: LensCalibration) -> None:
        self._camera, self._calibration = camera, calibration
        self._maps: _Maps | None = None

    def read(self, timeout: float) -> Capture:
        capture = self._camera.read(timeout)
        if not is_image(capture.image):  # refused where every picture is checked
            return capture
        height, width, _ = capture.image.shape
        if self._maps is None or self._maps.size != (width, height):
            self._maps = _Maps.of(self._calibration, width, height)
        depth = capture.depth
        if depth is not None and is_depth(depth, capture.image):
            depth = self._maps.depth(depth)
        return capture._replace(
            image=self._maps.image(capture.image), depth=depth, intrinsics=self._maps.intrinsics
        )

    def close(self) -> None:
        self._camera.close()


@dataclass(frozen=True)
class _Maps:
    """Says where in a picture of this size each pixel of the rectified one is.

    pixels, fractions: as `cv2.remap` mixes neighbours fastest. x, y: the same in floats, for the nearest
    pixel, which it takes wrongly from the others.
    """

    size: tuple[int, int]
    intrinsics: Intrinsics
    pixels: np.ndarray
    fractions: np.ndarray
    x: np.ndarray
    y: np.ndarray

    @classmethod
    def of(cls, calibration: LensCalibration, width: int, height: int) -> _Maps:
        """Raises BadFrame for a picture of another shape than the calibration's."""
        if misfit := calibration.misfit(width, height):
            raise BadFrame(misfit)
        across, down = width / calibration.width, height / calibration.height
        fx, fy, cx, cy = calibration.lens
        seen = _matrix(fx * across, fy * down, (cx + 0.5) * across - 0.5, (cy + 0.5) * down - 0.5)
        fx, fy, cx, cy = calibration.rectified
        shown = fx * width, fy * height, cx * width - 0.5, cy * height - 0.5
        distortion = np.array(calibration.distortion)
        x, y = cv2.initUndistortRectifyMap(
            seen, distortion, np.eye(3), _matrix(*shown), (width, height), cv2.CV_32FC1
        )
        return cls((width, height), shown, *cv2.convertMaps(x, y, cv2.CV_16SC2), x, y)

    def image(self, image: Image) -> Image:
        rectified = cv2.remap(
            image, self.pixels, self.fractions, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(rectified, np.uint8)

    def depth(self, depth: Depth) -> Depth:
        rectified = cv2.remap(depth, self.x, self.y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(rectified, np.uint16)


def _matrix(fx: float, fy: float, cx: float, cy: float) -> np.ndarray:
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
