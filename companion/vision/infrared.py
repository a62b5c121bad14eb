"""Recognises a camera without an infrared filter (NoIR): its pictures are magenta, most of all plants.

A sensor's green pixels pass less of the near infrared than red and blue ones, after the balance for visible
light. So what is looked for is less green than red and blue light, in a mixture of red and blue that a change
of the light's colour temperature leaves as it is: neither a sunset nor a wrong lamp looks so.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from anytraverse.frame import Image

TEXT = "camera shows infrared (NoIR)"
"""What the state is called, as a part of texts."""
REMEDY = (
    "the camera shows infrared (NoIR: plants are pink), for which the perceiver is not trained: take a camera"
    ' with an infrared filter, a perceiver that is trained for it, or accept it: [camera] infrared = "handle"'
)
"""What is wrong, and what to do."""

MAGENTA = 0.2
"""Logarithm of red and blue over green light from which on a cell is magenta: a fifth less green."""
_RED = 0.639
"""Red's share of the mixture, blue has the rest: black bodies of 2850 K and 6500 K are then alike."""
_LEAST_BLUE = -0.6
"""Logarithm of blue over green light below which a cell is red or orange, as laterite is, not magenta."""
SHARE = 0.8
"""Share of the cells that are magenta in a picture of such a camera; of others it was 0.68 at most."""
_ENOUGH = 0.1
"""Share of the cells that must be neither dark nor white for a picture to be judged."""
_CELLS, _SKY = (80, 60), 20
_DARK, _WHITE, _GAMMA = 20, 250, 2.2

_SOON, _EVERY = 0.5, 5.0
"""Seconds between two looks: until there were `_NEWEST` of them, and from then on."""
_NEWEST, _AGREEING, _LONGEST = 10, 8, 30


def magenta_share(picture: Image) -> float | None:
    """Return the share of the lower two thirds that is magenta, [0, 1]; None if too dark or too bright.

    picture: RGB, (height, width, 3) uint8, not empty. Only the mean colours of 60 x 80 cells are looked at,
    without the upper third, since a sky shows little infrared.
    """
    import cv2

    cells = cv2.resize(picture, _CELLS, interpolation=cv2.INTER_AREA)[_SKY:].reshape(-1, 3)
    brightest = cells.max(axis=1)
    judged = cells[(brightest >= _DARK) & (brightest < _WHITE)]
    if len(judged) < _ENOUGH * len(cells):
        return None
    red, green, blue = (_GAMMA * np.log(np.maximum(judged, 4).astype(np.float32))).T
    tint = _RED * (red - green) + (1.0 - _RED) * (blue - green)
    return float(np.mean((tint > MAGENTA) & (blue - green > _LEAST_BLUE)))


class InfraredDetector:
    """Looks at a picture now and then, and decides only by many looks: a camera does not change often."""

    def __init__(self) -> None:
        self._looks: deque[bool] = deque(maxlen=_LONGEST)
        self._due = -math.inf
        self._found: bool | None = None

    def check(self, picture: Image, now: float) -> bool | None:
        """Return whether the camera shows infrared, None as long as that is not known.

        8 of the newest 10 looks that could be judged say yes; no look of the newest 30 at all says no; in
        between the answer stays. now: monotonic seconds.
        """
        if now < self._due:
            return self._found
        self._due = now + (_SOON if len(self._looks) < _NEWEST else _EVERY)
        share = magenta_share(picture)
        if share is None:
            return self._found
        self._looks.append(share >= SHARE)
        if sum(list(self._looks)[-_NEWEST:]) >= _AGREEING:
            self._found = True
        elif len(self._looks) == _LONGEST and not any(self._looks):
            self._found = False
        return self._found
