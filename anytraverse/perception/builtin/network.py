"""Runs the built-in network, and chooses its input size."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import PerceiverError
from anytraverse.frame import Image
from anytraverse.perception.builtin.calibration import Floats
from anytraverse.perception.runtime import Runtime, open_session, run_session

WIDTH = 256
STEP = 32
"""Both sides of the network's input are multiples of this."""
LEAST_HEIGHT, GREATEST_HEIGHT, GREATEST_WIDTH = 128, 256, 512

EXPOSED = 90.0
"""Mean of a frame's levels, 0 to 255, below which it is brightened."""
MOST_GAIN = 16.0
_BRIGHT_SHARE, _WHITE = 0.95, 235.0

INPUT, OUTPUTS = "frame", ("logits", "features", "eighth", "sixteenth")


class Outputs(NamedTuple):
    """Holds what the network makes of an input (1, 3, h, w).

    logits: (C, h/4, w/4). features: the decoder's, (D, h/4, w/4). eighth, sixteenth: the backbone's at
    strides 8, (m, h/8, w/8), and 16, (n, h/16, w/16).
    """

    logits: Floats
    features: Floats
    eighth: Floats
    sixteenth: Floats


Run = Callable[[Floats], Outputs]
"""`frame` (1, 3, h, w) as of `network_input` -> outputs."""


def network_size(width: int, height: int) -> tuple[int, int]:
    """Choose the width and height of the network's input for a frame of this size.

    The input is 256 wide, and as high as the frame's aspect requires, in steps of 32. For a frame flatter
    than 2:1 it is 128 high, and wider instead, up to 512. The rest of the aspect is made up by stretching, at
    most 11 % for common cameras.
    """
    wide, high = WIDTH, _stepped(WIDTH * height / width)
    if high < LEAST_HEIGHT:
        wide, high = _stepped(LEAST_HEIGHT * width / height), LEAST_HEIGHT
    return min(wide, GREATEST_WIDTH), min(high, GREATEST_HEIGHT)


def network_input(image: Image) -> Floats:
    """Resize a frame to the network's input, (1, 3, h, w) float32 RGB 0 to 255; a dark one is brightened."""
    size = network_size(image.shape[1], image.shape[0])
    small: NDArray[Any] = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    if (gain := exposure_gain(small)) > 1.0:
        # from the frame itself: the levels of the small one are rounded
        fine = cv2.resize(image.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        small = np.clip(np.asarray(fine) * np.float32(gain), 0.0, 255.0)
    return np.ascontiguousarray(small.transpose(2, 0, 1)[None], dtype=np.float32)


def exposure_gain(image: NDArray[Any]) -> float:
    """Return the factor, 1 to `MOST_GAIN`, that gives a dark picture the mean brightness `EXPOSED`.

    No more than leaves its bright parts below white: what a lamp lights at night stays as it is.
    """
    bright = float(np.quantile(image, _BRIGHT_SHARE))
    wanted = min(EXPOSED / max(float(image.mean()), 1.0), _WHITE / max(bright, 1.0))
    return min(max(1.0, wanted), MOST_GAIN)


def open_network(model: Path, runtime: Runtime) -> Run:
    """Open a network. Raises PerceiverError for a file that cannot be read or that has other outputs."""
    session = open_session(model, runtime)
    if tuple(each.name for each in session.get_outputs()) != OUTPUTS:
        raise PerceiverError(
            f"{model.name}: its outputs are not {', '.join(OUTPUTS)}: it is of another kind, or an older "
            "version wrote it. Fit it again"
        )

    def run(frame: Floats) -> Outputs:
        return Outputs(*(output[0] for output in run_session(session, {INPUT: frame})))

    return run


def _stepped(pixels: float) -> int:
    return max(STEP, round(pixels / STEP) * STEP)
