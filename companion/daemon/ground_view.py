"""Keeps the newest map of the ground, and draws it from above for whoever asks."""

from __future__ import annotations

import time

from anytraverse.grid_map import GridMap, draw_from_above
from companion.config.stopping import Stopping
from companion.daemon.policy.service import PolicyService
from companion.daemon.turn import Event, Observer, Turn
from companion.guide.motion import poses_along
from companion.guide.plan import Plan
from companion.storage.served_files import png
from companion.vision.client import VisionResult
from companion.vision.messages import GroundMap, Planned

FRESH = 2.5
"""Seconds for which a map is shown: it comes once a second."""


class GroundView(Observer):
    """Is shown on the page, and served as /maps/from_above.png."""

    def __init__(self, policy: PolicyService) -> None:
        """policy: tells by which region frames are judged, and what stopping needs."""
        self._policy = policy
        self._newest: GridMap | None = None
        self._planned: Plan | None = None
        self._drawn: tuple[tuple[GridMap, Plan | None], bytes] | None = None

    def happened(self, event: Event, turn: Turn) -> None:  # noqa: ARG002
        """Take a map and a plan that vision reports."""
        if not isinstance(event, VisionResult):
            return
        match event.report:
            case GroundMap(content=found):
                self._newest = found
            case Planned(content=plan):
                self._planned = plan

    def png(self) -> bytes:
        """Return the newest map as PNG, b"" where none is known: an old one must not look new."""
        newest, planned, now = self._newest, self._planned, time.monotonic()
        if newest is None or now - newest.at > FRESH:
            return b""
        if planned is None or now - planned.at > FRESH or not planned.arcs:
            planned = None
        if self._drawn is None or self._drawn[0] != (newest, planned):
            ground, stopping = self._policy.judging.metres, self._policy.stopping
            ground = None if ground is None else ground.reaching(self._policy.reach)
            stops = stopping.needs if isinstance(stopping, Stopping) else None
            way = poses_along(planned) if planned is not None else ()
            self._drawn = (newest, planned), png(draw_from_above(newest, ground, stops, way))
        return self._drawn[1]
