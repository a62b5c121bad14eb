"""Tells where the vehicle was at each frame of a recorded drive."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from anytraverse.frame import Pose
from companion.desk.ground.driven_pairs import DrivenMotion
from companion.wire.json_values import number_of

_LONGEST = 1000.0
"""m between two frames that nobody drives: a gap in what the autopilot reported."""


def driven_poses(seen: Iterable[Mapping[str, Any]], motion: DrivenMotion) -> Iterator[Pose | None]:
    """Yield a pose of each frame by the reported speed and heading, from the first frame that has one.

    seen: contents of /assessment in their order. None across a gap, after which poses begin anew. It counts
    each way as one ahead: the autopilot reports no sign of its speed.
    """
    captured = (number_of(one.get("captured_at"), 0.0, 1e12) for one in seen)
    at = np.array([math.nan if one is None else one for one in captured])
    ways, headings = motion.way(at), np.radians(-motion.attitude(at)[:, 2])
    x = y = 0.0
    before: tuple[float, float] | None = None
    for way, heading in zip(ways.tolist(), headings.tolist(), strict=True):
        gone = math.nan if before is None else way - before[0]
        known = math.isfinite(way) and math.isfinite(heading)
        if before is not None and known and 0.0 <= gone < _LONGEST:
            middle = (before[1] + heading) / 2
            x, y = x + gone * math.cos(middle), y + gone * math.sin(middle)
            yield Pose(x, y, math.degrees(heading))
        elif before is None and known:
            yield Pose(x, y, math.degrees(heading))
        else:
            yield None
        before = (way, heading) if known else None
