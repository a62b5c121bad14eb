"""Calculates whether the vehicle stops before what its camera shows, and how large a tile is. Pure."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from anytraverse.errors import SettingsError
from anytraverse.findings import is_open
from anytraverse.ground import WIDEST, GroundCamera, GroundRegion
from anytraverse.ground_lines import GroundLine, ground_lines
from anytraverse.judging import LARGEST_TILE, Settings
from anytraverse.regions import Box, Region
from companion.config.schema import Config
from companion.guide.rules import TAKEN_WITHIN
from companion.vehicle.ardupilot import LONGEST_BRAKE
from companion.vehicle.brakes import Brakes

OVERSHOOT = 1.12
"""Actual speed by commanded speed. An ArduPilot with WP_SPEED 2 reached 2.25 m/s in simulation."""
FARTHEST = 20.0
"""Metres. No thing counts as seen further ahead: near the horizon an image row gives too long a distance."""
_SLOWEST = 0.05
_PICTURE = 640
"""Pixels. Width of the picture in which a tile is told where the camera's is not configured."""
SMALLEST_ROI = 0.05
"""Least width and height of the ROI, fractions of the image's. A smaller ROI holds too few cells of a map."""
_MAP = (48, 64)
"""Rows and columns of a perceiver's map: the built-in's."""
_FURTHER, _AHEAD, _BESIDE = 1.2, 0.5, 0.6
"""A region in metres ends at this factor of what stopping needs, and m; it is wider than the vehicle by m."""
_UNKNOWN_MEAN = 0.8
"""Mean uncertainty of a thing that no word explains."""
_BRAKED = 0.1
"""m/s below which the script on the autopilot ends its braking in HOLD."""
_BRAKE_SPARE = 1.3
ROCK = 0.45
"""Metres. The smallest thing that is to be seen in time where mount and speed are known."""
_FILLED = math.sqrt(0.5)
"""Side of the largest square inside a round thing, over its width: so large a tile the thing fills."""


@dataclass(frozen=True)
class Stopping:
    """Whether the vehicle stops in time. Times are in s, distances in m from the vehicle's front.

    speed: commanded speed, m/s; it is assumed to drive `OVERSHOOT` times as fast. brakes: the way from HOLD
    to standstill. react: time from when a thing can be seen until the brakes act. sees: distance at which it
    can be seen. top: the ROI's upper side that would be enough at this speed, None where none would.
    overrun: distance that the autopilot's hold mode drives on; it is added to the braking distance.
    braked: distance in place of that in HOLD where the script brakes first, None: it does not, or it is not
    known. Nothing is judged by it.
    """

    speed: float
    brakes: Brakes
    react: float
    sees: float
    top: float | None = None
    overrun: float = 0.0
    braked: float | None = field(default=None, compare=False)

    @property
    def needs(self) -> float:
        """Metres to standstill from the moment that a thing can be seen."""
        return self.driven * self.react + self.brakes.way(self.driven) + self.overrun

    @property
    def driven(self) -> float:
        """The highest speed that it really drives, m/s."""
        return OVERSHOOT * self.speed

    @property
    def fits(self) -> float:
        """The highest commanded speed, m/s, at which the vehicle stops in time."""
        return self.brakes.fastest(self.sees - self.overrun, self.react) / OVERSHOOT

    @property
    def enough(self) -> bool:
        """Whether the vehicle stops before the thing."""
        return self.needs <= self.sees

    def describe(self) -> str:
        """Return the judgement as text and, where the vehicle does not stop in time, the remedies."""
        circling = f", then {self.overrun:g} m on in LOITER" if self.overrun else ""
        held = self.brakes.way(self.driven)
        braking = "" if self.braked is None else f", {self.braked:.1f} m where the script brakes first"
        way = (
            f"at {self.speed:g} m/s it takes {self.needs:.1f} m to stop "
            f"({100 * (OVERSHOOT - 1):.0f} % of overshoot, {self.react:.1f} s to react, then {held:.1f} m "
            f"in HOLD{circling}{braking}), and a thing is seen {self.sees:.1f} m ahead"
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


def tile_width(config: Config) -> float | None:
    """Return the side of a tile that a rock `ROCK` wide fills where the vehicle still stops before it.

    It is over the image's width, in (0, 1]. None where mount or speed are not set, or the view is no
    pinhole's. It follows from the configuration alone, so that everybody who asks gets the same: it reckons
    with the configured speed, and with a perceiver that is quick enough to keep T.
    """
    judged = judge_stopping(config)
    if isinstance(judged, str) or config.ground_camera is None:
        return None
    return min(1.0, config.ground_camera.width(_FILLED * ROCK, judged.needs))


def describe_tile(config: Config, judging: Settings) -> tuple[str, bool]:
    """Return how large a tile is, as text, and whether a rock `ROCK` wide fills it in time.

    judging: the settings in force. Where mount or speed are not known, nothing is said against it.
    """
    if (ground := judging.metres) is not None:
        text = f"the region is {ground.near:.1f} to {ground.far:.1f} m ahead, {ground.width:.1f} m wide"
        return f"{text}, a tile {ground.tile:g} m", True
    bounds, picture = judging.region.bounds, config.camera.width or _PICTURE
    width = judging.tile_side * (bounds.right - bounds.left)
    text, in_time = f"a tile is {width * picture:.0f} px wide in a picture of {picture}", True
    judged, camera = judge_stopping(config), config.ground_camera
    if isinstance(judged, Stopping) and camera is not None:
        away = camera.farthest(_FILLED * ROCK, width)
        in_time = away >= judged.needs - 0.05
        text += (
            f" = a {100 * ROCK:.0f} cm rock at {away:.1f} m, and {judged.speed:g} m/s takes "
            f"{judged.needs:.1f} m to stop"
        )
    if not in_time:
        text += ": such a rock is called later than that, drive slower or set a smaller [roi] tile_share"
    if config.roi.tile_share is not None:
        return f"{text} (set by [roi] tile_share)", in_time
    own = "" if isinstance(judged, Stopping) else f", the perceiver's own; to calculate it: {judged}"
    return text + own, in_time


def lines_of(config: Config) -> tuple[GroundLine, ...]:
    """Return the lines that show in a picture where the mount puts the ground; none without a mount."""
    if config.ground_camera is None:
        return ()
    judged = judge_stopping(config)
    stops = judged.needs if isinstance(judged, Stopping) else None
    return ground_lines(config.ground_camera, config.mount.width, stops)


def with_settings(config: Config, judging: Settings, reach: float | None = None) -> Config:
    """Return the configuration with the region of interest and the tile of the settings in force.

    reach: as in `Frame`.
    """
    ground, roi = judging.metres, replace(config.roi, **asdict(judging.region.bounds))
    if ground is None:
        mount = replace(config.mount, width=None)
        return replace(config, roi=replace(roi, tile_share=judging.tile_side), mount=mount)
    far = ground.reaching(reach).far
    return replace(config, roi=replace(roi, near=ground.near, far=far, width=ground.width))


def longest_brake(config: Config) -> float:
    """Return the seconds for which the script on the autopilot may brake before HOLD, 0: not at all."""
    stopping = config.stopping
    braking, time_constant = stopping.brake_braking, stopping.brake_time_constant
    if stopping.hold_by != "brake":
        return 0.0
    if braking is None or time_constant is None or stopping.speed is None:
        return LONGEST_BRAKE
    fastest = max(OVERSHOOT * stopping.speed, _BRAKED)
    return min(LONGEST_BRAKE, _BRAKE_SPARE * Brakes.of(braking, time_constant).seconds(fastest, _BRAKED))


def _braked(config: Config, judged: Stopping) -> float | None:
    """Return the metres to standstill where the script brakes first; None where it does not, or not known.

    HOLD follows from the speed that is left when the script ends its braking.
    """
    stopping = config.stopping
    seconds, braking, linear = longest_brake(config), stopping.brake_braking, stopping.brake_time_constant
    if not seconds or braking is None or linear is None or judged.overrun:
        return None
    brake = Brakes.of(braking, linear)
    left = brake.left(judged.driven, seconds, _BRAKED)
    return brake.way(judged.driven) - brake.way(left) + judged.brakes.way(left)


def judge_stopping(
    config: Config,
    step: float = 0.0,
    tile: float | None = None,
    speed: float | None = None,
    overrun: float = 0.0,
) -> Stopping | str:
    """Judge whether the configured vehicle stops in time; a text that says what to set where it cannot.

    The tile is the configured one, else `LARGEST_TILE`: give it as it is in force, see `with_settings`.

    step: seconds that the perceiver takes for a frame. tile: the worst tile's threshold in force, None where
    tiles are not judged. speed: m/s that the autopilot is known to drive; it counts where it is greater than
    the configured speed, and a region in metres then ends as far ahead as it needs. overrun: as in
    `Stopping`, where the autopilot is known.

    The time to react is the sum of three: the camera's latency; the time until the thing is noticed; and the
    time until the command reaches the brakes. The second is the longer of two cases: a frame is judged and
    the reason debounced, or the vision process fails at that moment and T passes. Both at once are not
    assumed. T counts from the capture time that the camera reports, which does not include its latency.
    """
    mount, stopping, call = config.mount, config.stopping, config.call
    fastest = max((one for one in (stopping.speed, speed) if one is not None), default=None)
    if mount.height is None or mount.tilt is None or fastest is None:
        missing = ["[mount] height and tilt"] if mount.height is None or mount.tilt is None else []
        return f"set {', and '.join([*missing, *(['[stopping] speed'] if fastest is None else [])])}"
    camera = config.ground_camera
    if camera is None:
        return f"[camera] view is over {WIDEST:g} degrees, which is no pinhole's: measure on the ground"
    interval = max(step, 1.0 / config.camera.rate)
    # Where the vehicle is to be driven round the thing, that may fail before it is held.
    takes = TAKEN_WITHIN if call.policy == "guide" else 0.0
    noticed = max(step + call.window * interval + takes, config.freshness)
    react = config.camera.latency + noticed + stopping.delay
    # Those of HOLD, also where the script brakes first: for several reasons it may set HOLD at once.
    brakes = Brakes.of(stopping.braking, stopping.time_constant)
    judged = Stopping(fastest, brakes, react, 0.0, overrun=overrun)
    judged = replace(judged, braked=_braked(config, judged))
    needs = judged.needs if stopping.speed is not None else None
    if (ground := _region(config, camera, needs)) is not None:
        # A thing is noticed when its foot is in the first row of the map below the region's far side.
        row = camera.lens.aspect / _MAP[1]
        return replace(judged, sees=camera.distance(camera.row(ground.far) + row))
    return _seeing_in_fractions(config, camera, judged, tile)


def _seeing_in_fractions(
    config: Config, camera: GroundCamera, judged: Stopping, tile: float | None
) -> Stopping:
    """Return the judgement with how far a thing is seen in a region that is known in fractions."""
    roi = config.roi
    # A thing is noticed when it fills so much of a tile that the tile's mean passes its threshold.
    filled = min(1.0, tile / _UNKNOWN_MEAN) if tile is not None else 1.0
    share = LARGEST_TILE if roi.tile_share is None else roi.tile_share
    rows = filled * share * (roi.right - roi.left) * config.mount.aspect
    sees = camera.distance(min(roi.top + rows, roi.bottom))
    judged = replace(judged, sees=min(sees, FARTHEST))
    top = camera.row(judged.needs) - rows
    return replace(judged, top=top) if judged.needs <= FARTHEST and 0.0 <= top < roi.top else judged


def ground_region(config: Config, speed: float | None = None) -> GroundRegion | None:
    """Return the region of interest in metres; None where mount, width or speed are not configured.

    speed: m/s, as in `judge_stopping`.
    """
    judged, camera = judge_stopping(config, speed=speed), config.ground_camera
    needs = judged.needs if isinstance(judged, Stopping) and config.stopping.speed is not None else None
    ground = None if camera is None else _region(config, camera, needs)
    if ground is not None and not _is_open(ground):
        raise SettingsError("the camera looks aside, is rolled, or sees too little of the ground for metres")
    return ground


def _is_open(ground: GroundRegion) -> bool:
    """Return whether the vehicle fits through where all is drivable, on maps as small as they get."""
    bounds = ground.in_picture(None).region.bounds
    if min(bounds.right - bounds.left, bounds.bottom - bounds.top) < SMALLEST_ROI:
        return False
    settings = Settings(ground=ground, region=bounds).at(None)
    return is_open(np.ones(_MAP, dtype=np.bool_), ground.camera.lens.aspect, settings)


def region_of(config: Config) -> Region:
    """Return where the region of interest is in the picture of a vehicle that does not lean."""
    ground, roi = ground_region(config), config.roi
    if ground is not None:
        return ground.in_picture(None).region
    return Box(roi.left, roi.top, roi.right, roi.bottom)


def _region(config: Config, camera: GroundCamera, needs: float | None) -> GroundRegion | None:
    """Return the region in metres of a vehicle that needs so many metres to stop, None: not known.

    It ends at what the ground is known to, however much is needed: then the vehicle does not stop in time.
    Raises SettingsError where no ground of its width is in the picture before it ends.
    """
    roi, vehicle = config.roi, config.mount.width
    if vehicle is None or (roi.far is None and needs is None):
        return None
    width = vehicle + _BESIDE if roi.width is None else roi.width
    far = _FURTHER * (needs or 0.0) + _AHEAD if roi.far is None else roi.far
    return GroundRegion.in_view(camera, roi.near, far, width, vehicle)


def _down(figure: float) -> float:
    return math.floor(100 * figure) / 100
