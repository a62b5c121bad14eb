"""Keeps the newest map of the ground, and draws it from above for whoever asks."""

from __future__ import annotations

import time

from anytraverse.grid_map import GridMap, draw_from_above
from companion.calls.machine import OperatorCalls
from companion.config import Config
from companion.config.stopping import Stopping, judge_stopping
from companion.daemon.turn import Event, Observer, Turn
from companion.storage.served_files import png
from companion.vision.client import VisionResult
from companion.vision.messages import GroundMap

FRESH = 5.0
"""Seconds for which a map is shown: it comes once a second."""


class GroundView(Observer):
    """Is shown on the page, and served as /maps/from_above.png."""

    def __init__(self, config: Config, calls: OperatorCalls) -> None:
        judged = judge_stopping(config)
        self._stops = judged.needs if isinstance(judged, Stopping) else None
        self._calls = calls
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
            picture = draw_from_above(newest, self._calls.numbers.judging.metres, self._stops)
            self._drawn = newest, png(picture)
        return self._drawn[1]
