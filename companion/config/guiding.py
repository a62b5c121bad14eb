"""Reads from the configuration what planning needs, and what policy guide lacks. Pure."""

from __future__ import annotations

from companion.config.schema import Config
from companion.config.stopping import Stopping, judge_stopping
from companion.guide.plan import Outline


def outline(config: Config) -> Outline | None:
    """Return the vehicle's outline; None where its width or its turning radius is not configured."""
    width, radius = config.mount.width, config.guide.radius
    return None if width is None or radius is None else Outline(width, config.mount.front, radius)


def guide_lacks(config: Config) -> str:
    """Return the setting that policy guide needs and that is missing, "" for none."""
    for missing, what in (
        (config.mount.height is None, "[mount] height"),
        (config.mount.width is None, "[mount] width"),
        (config.stopping.speed is None, "[stopping] speed"),
        (config.stopping.hold_by != "brake", '[stopping] hold_by = "brake"'),
        (config.guide.radius is None, "[guide] radius"),
    ):
        if missing:
            return what
    return ""


def stops_in(config: Config) -> float:
    """Return the way from a plan that shows no way to standstill, over the speed, in s."""
    judged = judge_stopping(config)
    if not isinstance(judged, Stopping):
        return 0.0
    way = judged.brakes.way(judged.driven) if judged.braked is None else judged.braked
    return config.camera.latency + 1.0 / config.camera.rate + way / judged.driven
