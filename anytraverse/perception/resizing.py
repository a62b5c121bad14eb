"""Resizes frames to a network's size exactly as Pillow's `Image.resize`, with which networks are trained.

Antialiased, in Pillow's fixed-point arithmetic (its Resample.c): weights of 22 bits, first along the rows,
then along the columns, rounded to uint8 after each. Pillow 13 reverses that order where the height shrinks
by more than twice the pixels of the width; this module keeps the order with which today's networks were
trained.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import PerceiverError
from anytraverse.frame import Image, check_image

FILTERS = ("bilinear", "bicubic")
LARGEST = 4096
"""The most pixels of a network's input along one side."""

_BITS = 22
_REACH = {"bilinear": 1.0, "bicubic": 2.0}  # half the filter's width, in input lines at scale 1
_LINES = 32  # output lines computed together, so that they fit a core's cache


@dataclass(frozen=True)
class Fit:
    """Describes how a frame of any size becomes a network's input.

    width, height: pixels of the input, 1 to `LARGEST`. filter: one of `FILTERS`, antialiased.
    crop: False: both sides are stretched to fit; True: the shorter side is resized to fit and the middle
    of the longer side is cut out, as in CLIP's own preprocessing; width and height are then the same.
    Raises PerceiverError for anything else.
    """

    width: int
    height: int
    filter: str = "bilinear"
    crop: bool = False

    def __post_init__(self) -> None:
        for side, pixels in (("width", self.width), ("height", self.height)):
            if type(pixels) is not int or not 1 <= pixels <= LARGEST:
                raise PerceiverError(f"the {side} of a network's input is {pixels!r}: give 1 to {LARGEST}")
        if self.filter not in FILTERS:
            raise PerceiverError(f'no resize filter is called "{self.filter}": choose {" or ".join(FILTERS)}')
        if self.crop and self.width != self.height:
            raise PerceiverError(
                f"a cropped input is square, not {self.width}x{self.height}: give one size, or do not crop"
            )

    def window(self, width: int, height: int) -> tuple[int, int, int, int]:
        """Return the size to which a frame is resized, and where the input lies in it: (w, h, left, top)."""
        if not self.crop:
            return self.width, self.height, 0, 0
        longer = int(self.width * max(width, height) / min(width, height))
        wide, high = (self.width, longer) if width <= height else (longer, self.height)
        return wide, high, (wide - self.width) // 2, (high - self.height) // 2


class Resizer:
    """Resizes frames to one size. It caches the weights for the last frame's size."""

    def __init__(self, fit: Fit) -> None:
        self._fit = fit
        self._taps: tuple[_Taps, _Taps] | None = None
        self._shape: tuple[int, ...] = ()

    def __call__(self, image: Image) -> Image:
        """Resize a frame, (height, width, 3) uint8 RGB, to the size of `fit`. Raises PerceiverError."""
        check_image(image)
        if self._taps is None or self._shape != image.shape:
            self._taps, self._shape = _taps_for(self._fit, *image.shape[1::-1]), image.shape
        columns, rows = self._taps
        return _along_first_axis(
            _turned(_along_first_axis(_turned(np.ascontiguousarray(image)), columns)), rows
        )


class _Taps(NamedTuple):
    """Holds, for each of n output lines, the first of the k input lines it is made of, and their weights.

    first: (n,). weights: (n, k) int32, in units of 2^-22.
    """

    first: NDArray[np.intp]
    weights: NDArray[np.int32]

    @property
    def overshoots(self) -> bool:
        """Whether sums may be outside 0 to 255."""
        return bool((self.weights < 0).any())


def _taps_for(fit: Fit, width: int, height: int) -> tuple[_Taps, _Taps]:
    """Calculate the taps along the rows and along the columns of a frame of this size."""
    wide, high, left, top = fit.window(width, height)
    columns = np.arange(left, left + fit.width)
    rows = np.arange(top, top + fit.height)
    return _taps(columns, width / wide, width, fit.filter), _taps(rows, height / high, height, fit.filter)


def _taps(lines: NDArray[np.intp], scale: float, size: int, name: str) -> _Taps:
    """Calculate the taps of these output lines; each spans `scale` of the `size` input lines."""
    stretch = max(scale, 1.0)
    centres = (lines + 0.5) * scale
    reach = _REACH[name] * stretch
    begin = np.maximum((centres - reach + 0.5).astype(np.intp), 0)
    end = np.minimum((centres + reach + 0.5).astype(np.intp), size)
    count = int((end - begin).max())
    first = np.minimum(begin, size - count)
    places = first[:, None] + np.arange(count)
    weights = _kernel(np.abs((places - centres[:, None] + 0.5) * (1.0 / stretch)), name)
    weights[(places < begin[:, None]) | (places >= end[:, None])] = 0.0
    weights /= np.cumsum(weights, axis=1)[:, -1:]  # cumsum and not sum: it adds one by one, as Pillow does
    half = np.where(weights < 0, -0.5, 0.5)
    return _Taps(first, np.trunc(weights * (1 << _BITS) + half).astype(np.int32))


def _kernel(x: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """Return the filter's weight at a distance x >= 0 from its centre."""
    if name == "bilinear":
        return np.maximum(1.0 - x, 0.0)
    near = (1.5 * x - 2.5) * x * x + 1.0
    far = (((x - 5.0) * x + 8.0) * x - 4.0) * -0.5
    return np.where(x < 1.0, near, np.where(x < 2.0, far, 0.0))


def _turned(image: Image) -> Image:
    """Transpose rows and columns."""
    import cv2  # here, since a bundle's manifest is also read where no OpenCV may be loaded

    return np.asarray(cv2.transpose(image), dtype=np.uint8)


def _along_first_axis(image: Image, taps: _Taps) -> Image:
    """Calculate the weighted sums of lines, (n, ...) uint8."""
    lines = image.reshape(len(image), -1).astype(np.int32)
    made = np.empty((len(taps.first), lines.shape[1]), dtype=np.uint8)
    sums, tap = np.empty((2, min(_LINES, len(made)), lines.shape[1]), dtype=np.int32)
    for start in range(0, len(made), _LINES):
        first, weights = taps.first[start : start + _LINES], taps.weights[start : start + _LINES]
        total, tap = sums[: len(first)], tap[: len(first)]
        total[...] = 1 << (_BITS - 1)  # one half, so that the shift below rounds
        for index in range(weights.shape[1]):
            np.take(lines, first + index, axis=0, out=tap, mode="clip")
            tap *= weights[:, index : index + 1]
            total += tap
        total >>= _BITS
        if taps.overshoots:
            np.maximum(total, 0, out=total)
            np.minimum(total, 255, out=total)
        made[start : start + _LINES] = total
    return made.reshape(len(made), *image.shape[1:])
