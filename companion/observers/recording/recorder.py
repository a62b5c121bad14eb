"""Starts the recording process, sends it what is recorded, and starts it again: the supervisor's end.

Nothing here waits, and no failure of the recorder reaches the rest of the daemon.
"""

from __future__ import annotations

import logging
import os
import socket
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from companion.config import Config
from companion.observers.recording.feed import BUFFER, FedService
from companion.observers.recording.messages import LONGEST_REPORT, RecordingReport
from companion.observers.recording.ring import FOLDER
from companion.system.side_process import SideChild, missing_packages
from companion.system.watchdog import Restarts
from companion.tasks import RECORDER

log = logging.getLogger(__name__)

COMMAND = (sys.executable, "-m", "companion.observers.recording")
SWITCHED_OFF = "switched off by [recording] size"
_ENDS_WITHIN = 2.0


def missing() -> str:
    """Say which packages the recorder needs and that are not installed, "" where all are."""
    return missing_packages({"mcap": "mcap", "lz4": "lz4"}, "record")


class RecorderChild(SideChild):
    """Runs `python -m companion.observers.recording`."""

    def __init__(self, folder: Path, most: int, command: Sequence[str] = COMMAND) -> None:
        """Start the process. folder: of the recordings. most: bytes of all of them. Raises OSError."""
        where = str(folder), str(most)
        super().__init__(command, where, unit="recorder", buffer=BUFFER, longest=LONGEST_REPORT + 1)

    def finish(self) -> None:
        """Have it finish its recording and end, for two seconds at most."""
        try:
            self.channel.shutdown(socket.SHUT_WR)
        except OSError:  # it has ended
            return
        self.ends_within(_ENDS_WITHIN)


class Recorder(FedService[RecorderChild]):
    """Owns the recording process. The main loop calls `poll` in every turn."""

    def __init__(
        self,
        config: Config,
        launch: Callable[[Path, int], RecorderChild] = RecorderChild,
        restarts: Restarts = RECORDER,
    ) -> None:
        """launch: starts the process for this folder and size or raises OSError. restarts: time limits."""
        self._folder = Path(os.path.abspath(config.journal.path), FOLDER)
        self._most = config.recording.most
        off = missing() if self._most else SWITCHED_OFF
        super().__init__("recorder", restarts, off)
        self._launch = launch
        self._told, self._before = RecordingReport(), RecordingReport()
        """What the process reported last, and what those before it had done."""
        if off and self._most:
            log.warning("nothing is recorded: %s", off)

    def figures(self) -> dict[str, Any]:
        """Return what is recorded, what is wrong, and how much was lost since the start."""
        told, trouble = self._told, self.trouble or self._told.trouble
        return {
            "on": not trouble,
            "trouble": trouble,
            "restarts": self.restarted,
            "files": told.files,
            "bytes": told.size,
            "written": self._before.written + told.written,
            "lost": self._before.lost + told.lost + self.lost,
        }

    def close(self) -> None:
        """End the process: in order if it can, else killed."""
        if self.child is not None and self.running:
            self.flush()
            self.child.finish()
        super().close()

    def _take(self, said: bytes, _now: float) -> bool:
        try:
            told = RecordingReport.decoded(said)
        except ValueError:
            return False
        if not self.running:
            what = "recording into %s, %d MB at most: pictures, positions, log; [recording] size = 0 ends it"
            log.info(what, self._folder, self._most // 1_000_000)
        if told.trouble and told.trouble != self._told.trouble:
            log.warning("the recorder: %s", told.trouble)
        self._told = told
        return True

    def _start_fed(self) -> RecorderChild:
        """Start the process. Raises OSError."""
        told, before = self._told, self._before
        self._before = RecordingReport(0, 0, before.written + told.written, before.lost + told.lost)
        self._told = RecordingReport(told.files, told.size)
        return self._launch(self._folder, self._most)
