"""Writes the status file: once a second, and a last time at the end."""

from __future__ import annotations

import json
import os
from collections import deque
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from companion.daemon.turn import Observer, Turn
from companion.storage.writer import Writer
from companion.system.atomic_write import write_atomically

_RECENT = 1200
"""Newest frames whose times are written to the last status file."""


class StatusFile(Observer):
    """Observes which frames are judged, and queues the file for the writer."""

    def __init__(self, writer: Writer, path: Path) -> None:
        self._writer = writer
        self._path = path
        self._frames = 0
        self._recent: deque[tuple[int, float, float]] = deque(maxlen=_RECENT)

    def see(self, turn: Turn) -> None:
        """Count the judged frames."""
        for judged in turn.judged:
            frame = judged.assessment.frame
            self._frames += 1
            self._recent.append((frame.id, frame.captured_at, judged.at))

    def write(self, figures: Mapping[str, Any]) -> dict[str, Any]:
        """Queue the file: figures, number of judged frames, process id and the state of the disk.

        Return its content.
        """
        status = {**figures, "frames": self._frames, "pid": os.getpid(), "disk": self._writer.figures()}
        content = json.dumps(status).encode()
        # It is written again every second: a torn one lasts no longer.
        self._writer.queue_job("status", partial(write_atomically, self._path, content, sync=False))
        return status

    def leave(self, figures: Mapping[str, Any]) -> None:
        """Write everything that waits, within `SLOW` seconds, and last the status file.

        Only this last status file has the times of the newest frames, since that list is long and writing
        wears memory cards out.
        """
        self.write({**figures, "recent": list(self._recent)})
        self._writer.drain()
