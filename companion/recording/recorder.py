"""Starts the recording process, sends it what is recorded, and starts it again: the supervisor's end.

Nothing here waits, and no failure of the recorder reaches the rest of the daemon.
"""

from __future__ import annotations

import logging
import os
import socket
import sys
from collections.abc import Callable, Iterable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from companion.config import Config
from companion.recording.feed import BUFFER, Feed
from companion.recording.messages import LONGEST_REPORT, Message, Report
from companion.recording.ring import FOLDER
from companion.system.side_process import SideChild, SideProcess
from companion.system.watchdog import Restarts
from companion.tasks import RECORDER

log = logging.getLogger(__name__)

COMMAND = (sys.executable, "-m", "companion.recording")
EXTRA = 'pip install "anytraverse-companion[record]"'
_NEEDS = ("mcap", "lz4")
_ENDS_WITHIN = 2.0


def missing() -> list[str]:
    """Name the packages that the recorder needs and that are not installed. Imports none of them."""
    return [name for name in _NEEDS if find_spec(name) is None]


class RecorderChild(SideChild):
    """Runs `python -m companion.recording`."""

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


class Recorder:
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
        self._launch = launch
        self._feed: Feed[RecorderChild] = Feed("recorder", self._start, restarts)
        self._told, self._before = Report(), Report()
        """What the process reported last, and what those before it had done."""
        self._off = not self._most
        if self._off:
            self._process.trouble = "switched off by [recording] size"
        elif packages := missing():
            self._off, self._process.trouble = True, f"{', '.join(packages)} not installed: {EXTRA}"
            log.warning("nothing is recorded: %s", self.trouble)

    @property
    def trouble(self) -> str:
        """Why nothing is recorded, in a sentence; "" while all is well."""
        return self._process.trouble or self._told.trouble

    @property
    def listener(self) -> int:
        """The number of the process for which messages should be made, 0: there is none."""
        return self._feed.listener

    def poll(self, now: float, messages: Iterable[Message] = ()) -> None:
        """Keep the process running, take what it says, and send it messages. now: monotonic seconds."""
        if not self._off:
            self._feed.poll(now, messages, self._take)

    def figures(self) -> dict[str, Any]:
        """Return what is recorded, what is wrong, and how much was lost since the start."""
        told = self._told
        return {
            "on": not self.trouble,
            "trouble": self.trouble,
            "restarts": self._process.restarted,
            "files": told.files,
            "bytes": told.size,
            "written": self._before.written + told.written,
            "lost": self._before.lost + told.lost + self._feed.lost,
        }

    def close(self) -> None:
        """End the process: in order if it can, else killed."""
        child = self._process.child
        if child is not None and self._process.running:
            self._feed.flush()
            child.finish()
        self._process.close()

    @property
    def _process(self) -> SideProcess[RecorderChild]:
        return self._feed.process

    def _take(self, said: bytes, _now: float) -> bool:
        try:
            told = Report.decoded(said)
        except ValueError:
            return False
        if not self._process.running:
            what = "recording into %s, %d MB at most: pictures, positions, log; [recording] size = 0 ends it"
            log.info(what, self._folder, self._most // 1_000_000)
        if told.trouble and told.trouble != self._told.trouble:
            log.warning("the recorder: %s", told.trouble)
        self._told = told
        return True

    def _start(self) -> RecorderChild:
        """Start the process. Raises OSError."""
        told, before = self._told, self._before
        self._before = Report(0, 0, before.written + told.written, before.lost + told.lost)
        self._told = Report(told.files, told.size)
        return self._launch(self._folder, self._most)
