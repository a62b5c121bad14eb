"""Whether the vehicle stops before what its camera shows it. Pure: figures in, figures and a sentence out.

A pinhole over level ground. A thing calls once it fills enough of the uppermost tile of the region of
interest, so that is how far the companion sees, not the upper row itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from companion.config import Config

FARTHEST = 20.0
"""Metres. Rows near the horizon promise more than level ground, lens and network keep."""
WIDEST = 120.0
"""Degrees: a wider view is no pinhole's."""
_SLOWEST = 0.05
_UNEXPLAINED = 0.8
"""Uncertainty of a thing without a word, on the mean of its pixels."""


@dataclass(frozen=True)
class Outlook:
    """A camera on its vehicle.

    height: m above the ground. tilt: degrees below the horizon. view: horizontal, degrees.
    aspect: width by height. front: m from the lens to the vehicle's front.
    """

    height: float
    tilt: float
    view: float
    aspect: float
    front: float = 0.0

    def distance(self, row: float) -> float:
        """Metres from the vehicle's front to where an image row (0 top, 1 bottom) meets the ground.

        Infinite at the horizon and above it; never negative.
        """
        tilt, down = math.radians(self.tilt), (row - 0.5) / self._focal
        drop = math.sin(tilt) + down * math.cos(tilt)
        if drop <= 0:
            return math.inf
        ahead = math.cos(tilt) - down * math.sin(tilt)
        return max(0.0, self.height * ahead / drop - self.front)

    def row(self, distance: float) -> float:
        """The image row, above 1 or below 0 where it is not in the image, that meets the ground there."""
        tilt, ahead = math.radians(self.tilt), distance + self.front
        across = self.height * math.cos(tilt) - ahead * math.sin(tilt)
        along = self.height * math.sin(tilt) + ahead * math.cos(tilt)
        return 0.5 + self._focal * across / along if along > 0 else math.inf

    @property
    def _focal(self) -> float:
        """Focal length in image heights."""
        return self.aspect / 2.0 / math.tan(math.radians(self.view / 2.0))


@dataclass(frozen=True)
class Stopping:
    """Speeds in m/s, braking in m/s2, times in s, distances in m from the vehicle's front.

    react: from the moment that a thing may be seen until the brakes act. sees: where a thing is seen.
    top: the ROI's upper side that would be enough at this speed; None where none would.
    overrun: driven on in the autopilot's hold mode, taken to come on top of braking.
    """

    speed: float
    braking: float
    react: float
    sees: float
    top: float | None = None
    overrun: float = 0.0

    @property
    def needs(self) -> float:
        """The way to standstill from the moment that a thing may be seen."""
        return self.speed * self.react + self.speed**2 / (2.0 * self.braking) + self.overrun

    @property
    def fits(self) -> float:
        """The speed whose way to standstill is just what is seen."""
        lost = self.braking * self.react
        return math.sqrt(lost**2 + 2.0 * self.braking * max(0.0, self.sees - self.overrun)) - lost

    @property
    def enough(self) -> bool:
        """Whether the vehicle stops before what it sees."""
        return self.needs <= self.sees

    def told(self) -> str:
        """The judgement and, where it is bad, what to do."""
        circling = f", then {self.overrun:g} m on in LOITER" if self.overrun else ""
        way = (
            f"at {self.speed:g} m/s it takes {self.needs:.1f} m to stop ({self.react:.1f} s to react, then "
            f"braking at {self.braking:g} m/s2{circling}), and a thing is seen {self.sees:.1f} m ahead"
        )
        if self.enough:
            return f"{way}: fits up to {_down(self.fits):.2f} m/s"
        return f"{way}: {', or '.join(self._remedies())}"

    def _remedies(self) -> list[str]:
        slower, remedies = _down(self.fits), []
        if slower >= _SLOWEST:
            remedies.append(f"drive at most {slower:.2f} m/s")
        if self.top is not None:
            remedies.append(f"set [roi] top = {_down(self.top):.2f} (further up the picture)")
        if self.overrun:
            remedies.append('set [call] px4_hold = "offboard"')
        remedies.append("mount the camera higher or tilted less")
        remedies.append("judge more often (a quicker perceiver, [camera] rate, a smaller [call] freshness)")
        return remedies if slower >= _SLOWEST else [f"no speed is slow enough: {remedies[0]}", *remedies[1:]]


def judge(
    config: Config,
    step: float = 0.0,
    tile: float | None = None,
    speed: float | None = None,
    overrun: float = 0.0,
) -> Stopping | str:
    """The judgement on what is configured, or why there is none and what to do.

    step: seconds that the perceiver takes for a frame. tile: the worst tile's threshold in force, None where
    tiles are not judged. speed: m/s that the autopilot is known to drive, which counts where it is greater
    than the configured one. overrun: as in `Stopping`, where the autopilot is known.

    Time to react: a frame is judged and the votes come in, or the eyes fail just then and T passes, whichever
    takes longer; then the order reaches the brakes. That both happen at once is not reckoned with.
    """
    mount, stopping, roi, call = config.mount, config.stopping, config.roi, config.call
    fastest = max((one for one in (stopping.speed, speed) if one is not None), default=None)
    if mount.height is None or mount.tilt is None:
        return "set [mount] height and tilt, and [stopping] speed"
    if fastest is None:
        return "set [stopping] speed"
    if config.camera.view > WIDEST:
        return f"[camera] view is over {WIDEST:g} degrees, which is no pinhole's: measure on the ground"
    outlook = Outlook(mount.height, mount.tilt, config.camera.view, mount.aspect, mount.front)
    filled = min(1.0, tile / _UNEXPLAINED) if tile is not None else 1.0
    rows = filled * roi.tile_share * (roi.right - roi.left) * mount.aspect
    sees = outlook.distance(min(roi.top + rows, roi.bottom))
    interval = max(step, 1.0 / config.camera.rate)
    react = max(step + call.window * interval, config.freshness) + stopping.delay
    judged = Stopping(fastest, stopping.braking, react, min(sees, FARTHEST), overrun=overrun)
    top = outlook.row(judged.needs) - rows
    return replace(judged, top=top) if judged.needs <= FARTHEST and 0.0 <= top < roi.top else judged


def _down(figure: float) -> float:
    return math.floor(100 * figure) / 100
