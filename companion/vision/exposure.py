"""Finds pictures in which the ground cannot be seen: black, underexposed or overexposed ones."""

from __future__ import annotations

import numpy as np

from anytraverse.regions import Region
from companion.vision.freeze_detector import Luma

BLACK, DARK, WHITE = 5.0, 12.0, 250.0
"""Brightness, of 255: a black picture and an underexposed region are darker, an overexposed region is at
least so bright."""
_SHARE = 0.95
_WHITE_SHARE = 0.9

ADVICE = {
    "": "",
    "picture black": "take the cap off the lens, switch on a light, and look at the camera's exposure",
    "picture underexposed": "switch on a light, or let the camera expose longer",
    "picture overexposed": "turn the camera out of the sun, or let it expose shorter",
}
"""What a picture is called -> what to do. "": it is well exposed."""


def exposure_name(levels: Luma, region: Region) -> str:
    """Name a picture as in `ADVICE`. levels: `luma` of it. region: where the ground must be seen."""
    inside = levels[region.mask(*levels.shape)]
    inside = inside if inside.size else levels.ravel()
    if float(np.quantile(levels, _SHARE)) < BLACK:
        return "picture black"
    if float(np.quantile(inside, _SHARE)) < DARK:
        return "picture underexposed"
    return "picture overexposed" if float(np.mean(inside >= WHITE)) >= _WHITE_SHARE else ""


class ExposureDetector:
    """Measures for how long the ground has not been seen for want or excess of light."""

    def __init__(self) -> None:
        self._since: float | None = None

    def check(self, levels: Luma, region: Region, now: float) -> tuple[str, float]:
        """Return the newest picture's name as in `ADVICE`, and the seconds since the last one that was well.

        levels: `luma` of it. now: monotonic seconds.
        """
        name = exposure_name(levels, region)
        if not name:
            self._since = None
        elif self._since is None:
            self._since = now
        return name, 0.0 if self._since is None else now - self._since
