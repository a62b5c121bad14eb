"""Reads from the configuration what planning needs, and what policy guide lacks. Pure."""

from __future__ import annotations

import math

from anytraverse.ground import RELIABLE
from companion.config.schema import Config
from companion.config.stopping import Stopping, judge_stopping
from companion.guide.motion import SPARE, STOPS_IN
from companion.guide.plan import Outline


def outline(config: Config) -> Outline | None:
    """Return the vehicle's outline; None where its width or its turning radius is not configured."""
    width, radius = config.mount.width, config.guide.radius
    return None if width is None or radius is None else Outline(width, config.mount.front, radius)


def guide_lacks(config: Config) -> str:
    """Return the setting that policy guide needs, "" where it has all.

    What it drives round must be seen before the way to a standstill: ground is told `RELIABLE` m ahead.
    """
    for missing, what in (
        (config.mount.height is None, "[mount] height"),
        (config.mount.width is None, "[mount] width"),
        (config.stopping.speed is None, "[stopping] speed"),
        (config.stopping.hold_by != "brake", '[stopping] hold_by = "brake"'),
        (config.guide.radius is None, "[guide] radius"),
    ):
        if missing:
            return what
    sees = RELIABLE - config.mount.front
    fits = math.floor(10.0 * (sees - SPARE) / max(STOPS_IN, stops_in(config))) / 10.0
    if (config.stopping.speed or 0.0) > fits:
        return f"[stopping] speed = {fits:g} or less"
    return ""


def stops_in(config: Config) -> float:
    """Return the way from a plan that shows no way to standstill, over the speed, in s."""
    judged = judge_stopping(config)
    if not isinstance(judged, Stopping):
        return 0.0
    way = judged.brakes.way(judged.driven) if judged.braked is None else judged.braked
    return config.camera.latency + 1.0 / config.camera.rate + way / judged.driven
