"""Starts the video process, gives it pictures, and starts it again: the supervisor's end."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from companion.cameras.shown import shown
from companion.config import Config
from companion.config.video import PATH
from companion.observers.video.rtsp_server import LARGEST, NO_GSTREAMER, PORT_TAKEN, REPORT
from companion.system.datagrams import Datagram
from companion.system.side_process import SideChild, SideService
from companion.system.watchdog import Restarts
from companion.tasks import VIDEO

log = logging.getLogger(__name__)

SERVER = Path(__file__).with_name("rtsp_server.py")
PACKAGES = (
    "python3-gi gir1.2-gst-rtsp-server-1.0 "
    "gstreamer1.0-plugins-base gstreamer1.0-plugins-good gstreamer1.0-plugins-ugly gstreamer1.0-x"
)
"""What the video needs of Debian, Raspberry Pi OS and Ubuntu."""

_WHY = {
    PORT_TAKEN: "another program has its port: set another [video] listen",
    NO_GSTREAMER: f"GStreamer lacks what the video needs: sudo apt install {PACKAGES}",
}


class VideoChild(SideChild):
    """Runs the RTSP server, by the system's Python."""

    def __init__(self, command: Sequence[str]) -> None:
        """Start the process. command: the whole of it, which systemd's unit runs, too. Raises OSError."""
        super().__init__([], command, unit="video", buffer=2 * LARGEST, longest=REPORT.size + 1)
        self._why = ""

    def receive(self) -> list[bytes]:
        """Return what it said, but for why it cannot run."""
        said = super().receive()
        self._why = next((_WHY[one] for one in said if one in _WHY), self._why)
        return [one for one in said if one not in _WHY]

    def ended(self) -> str:
        """Say why the process ended or cannot run, "" while it runs."""
        return self._why or super().ended()


class Video(SideService[VideoChild]):
    """Owns the video process. The main loop calls `poll` in every turn.

    watched: whether somebody sees the video.
    """

    def __init__(
        self,
        config: Config,
        launch: Callable[[Sequence[str]], VideoChild] = VideoChild,
        restarts: Restarts = VIDEO,
    ) -> None:
        """launch: starts this command or raises OSError. restarts: time limits."""
        self._settings = config.video
        self._listen = config.video.address
        super().__init__(
            "video", restarts, "" if self._listen is not None else "switched off by [video] listen"
        )
        self._folder = os.path.abspath(config.journal.path)
        self._launch = launch
        self._shown = 0
        self._shown_since = float("-inf")
        self.watched = False

    @property
    def url(self) -> str:
        """The video's address as ground stations are told it; "" while there is none."""
        if self._listen is None or self.trouble:
            return ""
        return self._settings.url or self._listen.url("rtsp").rstrip("/") + PATH

    def poll(self, now: float) -> None:
        """Keep the process running, and take what it says. now: monotonic seconds."""
        super().poll(now)
        if not self.running:
            self._shown, self.watched = 0, False

    def show(self, number: int, picture: bytes) -> None:
        """Show a picture until the next one. number: of a still picture, 0: a live one. picture: JPEG."""
        if len(picture) <= LARGEST - 5:
            self.send(b"p" + number.to_bytes(4, "little") + picture)

    def shown_for(self, number: int, now: float) -> float:
        """Return for how many seconds the video has shown this still picture and no other; 0: it does not."""
        return now - self._shown_since if number and number == self._shown else 0.0

    def figures(self) -> dict[str, Any]:
        """Return where the video is, whether it is watched, what is wrong, and how often it was restarted."""
        return {
            "url": self.url and (shown(self._settings.url) or self.url),
            "watched": self.watched,
            "trouble": self.trouble,
            "restarts": self.restarted,
        }

    def _take(self, said: bytes, now: float) -> bool:
        if len(said) != REPORT.size:
            return False
        port, shown, watched = REPORT.unpack(said)
        if watched > 1 or not port or self._listen is None:
            return False
        if self._listen.port not in (0, port):
            return False
        if not self.running:
            # A port that was free is the same one after a restart.
            self._listen = self._listen._replace(port=port)
            log.info("the video is on port %d", port)
        if shown != self._shown:
            self._shown, self._shown_since = shown, now
        self.watched = bool(watched)
        return True

    def _start(self) -> VideoChild:
        assert self._listen is not None
        child = self._launch((self._settings.python, "-I", str(SERVER)))
        setup = {
            "host": self._listen.host,
            "port": self._listen.port,
            "path": PATH,
            "rate": round(self._settings.rate),
            "encoder": self._settings.encoder,
            "cache": self._folder,
        }
        child.send(Datagram(b"c", setup).encoded())
        return child
