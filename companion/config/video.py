"""Reads the section [video] of the file: the companion as a MAVLink camera, and where its video is."""

from __future__ import annotations

import ipaddress
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from companion.config.checks import Conflict, Section, checked, harmless, number, path, setting, whole
from companion.pages.listen import Listen, read_listen

PATH = "/anytraverse"
WIDTH = 640
"""Pixels of the video."""
LONGEST_URL = 159
"""Characters that VIDEO_STREAM_INFORMATION carries, with a zero at their end."""


def check_url(text: str) -> None:
    """Accept an RTSP address, or "" for the one that follows from `listen`. Raises ValueError."""
    host = text.removeprefix("rtsp://")
    if text and (host == text or not host or not text.isascii() or " " in text):
        raise ValueError('give "rtsp://HOST:PORT/anytraverse", HOST as ground stations reach this computer')
    if len(text) > LONGEST_URL:
        raise ValueError(f"{len(text)} characters, at most {LONGEST_URL} are sent")


def check_encoder(text: str) -> None:
    """Accept the text of a GStreamer element that makes H.264. Raises ValueError."""
    if not text or not text.isascii() or "!" in text or "{" in text or ")" in text:
        raise ValueError('give one GStreamer element with its properties, like "x264enc bitrate=600"')


class CameraSettings(NamedTuple):
    """What the camera says of itself. component: 100 to 105. rate: pictures per second of the video.

    view: horizontal field of view, degrees, 0: unknown.
    """

    component: int
    rate: float
    view: int


def video_size(height: int, width: int) -> tuple[int, int]:
    """Return height and width of the video of a camera's pictures: even, as the encoder wants."""
    return max(2, min(3 * WIDTH, round(height * WIDTH / width)) // 2 * 2), WIDTH


@dataclass(frozen=True)
class VideoSection(Section):
    """The companion as a MAVLink camera, with a video in which an operator points at things."""

    listen: str = setting("", checked(read_listen, harmless), 'address:port of the RTSP video; "": no camera')
    url: str = setting(
        "", checked(check_url, harmless), 'its address, as told to ground stations; "": that of listen'
    )
    component: int = setting(100, whole(100, 105), "MAVLink component of the camera")
    rate: float = setting(5.0, number(1.0, 15.0), "pictures per second")
    encoder: str = setting(
        "x264enc tune=zerolatency speed-preset=ultrafast bitrate=600 key-int-max=10",
        checked(check_encoder),
        "the GStreamer element that encodes H.264, with its properties",
    )
    python: str = setting("/usr/bin/python3", path, "the Python that has GStreamer's bindings (gi)")

    def conflicts(self) -> Iterator[Conflict]:
        listen = self.address
        if listen is not None and not self.url and ipaddress.ip_address(listen.host).is_unspecified:
            reason = (
                'no ground station can reach this address: set url ("rtsp://rover.local:8554/anytraverse")'
            )
            yield ("listen", "url"), reason

    @property
    def address(self) -> Listen | None:
        """Where the video process listens; None: there is no camera."""
        return read_listen(self.listen)

    def camera(self, view: float) -> CameraSettings | None:
        """Return what the camera says of itself, None where the companion is none. view: degrees."""
        return CameraSettings(self.component, self.rate, round(view)) if self.listen else None
