"""Keeps the newest map of the ground, and draws it from above for whoever asks."""

from __future__ import annotations

import time

from anytraverse.grid_map import GridMap, draw_from_above
from companion.config.stopping import Stopping
from companion.daemon.policy.service import PolicyService
from companion.daemon.turn import Event, Observer, Turn
from companion.storage.served_files import png
from companion.vision.client import VisionResult
from companion.vision.messages import GroundMap

FRESH = 2.5
"""Seconds for which a map is shown: it comes once a second."""


class GroundView(Observer):
    """Is shown on the page, and served as /maps/from_above.png."""

    def __init__(self, policy: PolicyService) -> None:
        """policy: tells by which region frames are judged, and what stopping needs."""
        self._policy = policy
        self._newest: GridMap | None = None
        self._drawn: tuple[GridMap, bytes] | None = None

    def happened(self, event: Event, turn: Turn) -> None:  # noqa: ARG002
        """Take a map that vision reports."""
        if isinstance(event, VisionResult) and isinstance(event.report, GroundMap):
            self._newest = event.report.content

    def png(self) -> bytes:
        """Return the newest map as PNG, b"" where none is known: an old one must not look new."""
        newest = self._newest
        if newest is None or time.monotonic() - newest.at > FRESH:
            return b""
        if self._drawn is None or self._drawn[0] is not newest:
            ground, stopping = self._policy.judging.metres, self._policy.stopping
            ground = None if ground is None else ground.reaching(self._policy.reach)
            stops = stopping.needs if isinstance(stopping, Stopping) else None
            self._drawn = newest, png(draw_from_above(newest, ground, stops))
        return self._drawn[1]
