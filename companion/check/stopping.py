"""Whether the vehicle stops before what its camera shows it. Pure: figures in, figures and a sentence out.

A pinhole over level ground. A thing calls once it fills enough of the uppermost tile of the region of
interest, so that is how far the companion sees, not the upper row itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from companion.check.braking import OVERSHOOT, Brakes
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
    """Times in s, distances in m from the vehicle's front.

    speed: m/s that it is told to drive; it is reckoned to drive `OVERSHOOT` times as fast. brakes: from HOLD
    to standstill. react: from the moment that a thing may be seen until they act. sees: where that is.
    top: the ROI's upper side that would be enough at this speed; None where none would.
    overrun: driven on in the autopilot's hold mode, taken to come on top of braking.
    """

    speed: float
    brakes: Brakes
    react: float
    sees: float
    top: float | None = None
    overrun: float = 0.0

    @property
    def needs(self) -> float:
        """The way to standstill from the moment that a thing may be seen."""
        return self.driven * self.react + self.brakes.way(self.driven) + self.overrun

    @property
    def driven(self) -> float:
        """m/s that it may really drive."""
        return OVERSHOOT * self.speed

    @property
    def fits(self) -> float:
        """The speed to be told whose way to standstill is just what is seen."""
        return self.brakes.fastest(self.sees - self.overrun, self.react) / OVERSHOOT

    @property
    def enough(self) -> bool:
        """Whether the vehicle stops before what it sees."""
        return self.needs <= self.sees

    def told(self) -> str:
        """The judgement and, where it is bad, what to do."""
        circling = f", then {self.overrun:g} m on in LOITER" if self.overrun else ""
        braked = self.brakes.way(self.driven)
        way = (
            f"at {self.speed:g} m/s it takes {self.needs:.1f} m to stop "
            f"({100 * (OVERSHOOT - 1):.0f} % of overshoot, {self.react:.1f} s to react, then {braked:.1f} m "
            f"in HOLD{circling}), and a thing is seen {self.sees:.1f} m ahead"
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

    Time to react: the camera's latency; then a frame is judged and the votes come in, or the eyes fail just
    then and T passes, whichever takes longer; then the order reaches the brakes. That both happen at once is
    not reckoned with. T counts from when a frame was captured, as far as the camera tells: its latency, which
    it does not tell, comes on top.
    """
    mount, stopping, roi, call = config.mount, config.stopping, config.roi, config.call
    fastest = max((one for one in (stopping.speed, speed) if one is not None), default=None)
    if mount.height is None or mount.tilt is None or fastest is None:
        missing = ["[mount] height and tilt"] if mount.height is None or mount.tilt is None else []
        return f"set {', and '.join([*missing, *(['[stopping] speed'] if fastest is None else [])])}"
    if config.camera.view > WIDEST:
        return f"[camera] view is over {WIDEST:g} degrees, which is no pinhole's: measure on the ground"
    outlook = Outlook(mount.height, mount.tilt, config.camera.view, mount.aspect, mount.front)
    filled = min(1.0, tile / _UNEXPLAINED) if tile is not None else 1.0
    rows = filled * roi.tile_share * (roi.right - roi.left) * mount.aspect
    sees = outlook.distance(min(roi.top + rows, roi.bottom))
    interval = max(step, 1.0 / config.camera.rate)
    noticed = max(step + call.window * interval, config.freshness)
    react = config.camera.latency + noticed + stopping.delay
    brakes = Brakes.of(stopping.braking, stopping.time_constant)
    judged = Stopping(fastest, brakes, react, min(sees, FARTHEST), overrun=overrun)
    top = outlook.row(judged.needs) - rows
    return replace(judged, top=top) if judged.needs <= FARTHEST and 0.0 <= top < roi.top else judged


def _down(figure: float) -> float:
    return math.floor(100 * figure) / 100
