"""Turns a line that somebody drags in the picture into the camera's height and tilt. Pure."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from anytraverse.errors import SettingsError
from anytraverse.ground import GroundCamera
from companion.config import Config
from companion.config.stopping import Stopping, judge_stopping, lines_of, region_of
from companion.pages.requests import RequestError

HEIGHTS = 0.05, 20.0
TILTS = -45.0, 85.0
ASSUMED = 1.0, 10.0
"""Height and tilt from which somebody starts to drag where none is configured: m, degrees."""


def mounted(config: Config, *, height: float | None = None, tilt: float | None = None) -> Config:
    """Return the configuration with a mount: the given one, else its own, else `ASSUMED`."""
    mount = config.mount
    high = height if height is not None else mount.height if mount.height is not None else ASSUMED[0]
    down = tilt if tilt is not None else mount.tilt if mount.tilt is not None else ASSUMED[1]
    return replace(config, mount=replace(mount, height=high, tilt=down))


def dragged(config: Config, line: str, row: float) -> tuple[float, float]:
    """Return height (m) and tilt (degrees) with which a line lies on a row in the picture's middle column.

    line: "horizon", which sets the tilt, or metres ahead of the vehicle's front, which set the height.
    row: fraction of the picture's height. Raises RequestError where no camera sees it there.
    """
    camera = mounted(config).ground_camera
    if camera is None:
        raise RequestError("the lens's view is no pinhole's: type height and tilt")
    if line == "horizon":
        return camera.height, _tilt(camera, row)
    try:
        metres = float(line)
    except ValueError:
        raise RequestError("a line is the horizon, or metres ahead") from None
    return _height(camera, metres, row), camera.tilt


def _tilt(camera: GroundCamera, row: float) -> float:
    down = (row - camera.lens.centre_y) / camera.lens.focal_y
    tilt = -math.degrees(math.atan(down * math.cos(math.radians(camera.roll))))
    return min(TILTS[1], max(TILTS[0], tilt))


def _height(camera: GroundCamera, metres: float, row: float) -> float:
    """What a ray meets is as many times as far as the lens is high."""
    ahead = float(replace(camera, height=1.0).to_ground(np.array([[0.5, row]]))[0, 0])
    if not (math.isfinite(ahead) and ahead > 0.0 and metres + camera.front > 0.0):
        raise RequestError("that is above the horizon: drag the horizon first")
    return min(HEIGHTS[1], max(HEIGHTS[0], (metres + camera.front) / ahead))


def lines(config: Config) -> list[dict[str, Any]]:
    """Return the lines of the ground for a picture: JSON values."""
    return [
        {
            "kind": line.kind,
            "label": line.label,
            "start": line.start,
            "end": line.end,
            "labelled": line.labelled,
        }
        for line in lines_of(config)
    ]


def ground(config: Config, speed: float | None = None, overrun: float = 0.0) -> dict[str, Any]:
    """Return what is drawn over the picture, and what follows from it: JSON values, places in fractions.

    speed, overrun: as in `judge_stopping`, where the autopilot has told them.
    """
    judged = judge_stopping(config, speed=speed, overrun=overrun)
    found: dict[str, Any] = {
        "lines": lines(mounted(config)),
        "known": config.ground_camera is not None,
        "stops": judged if isinstance(judged, str) else judged.describe(),
        "enough": isinstance(judged, Stopping) and judged.enough,
    }
    try:
        region = region_of(config)
        found["region"] = [list(corner) for corner in region.corners]
    except SettingsError as error:
        found |= {"region": [], "region_problem": str(error)}
    return found
