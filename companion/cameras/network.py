"""Reads network cameras by OpenCV's FFmpeg: `rtsp://...` and `http://...`, such as MJPEG."""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import os
import socket
import ssl
import sys
import termios
import time
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import ClassVar

_USERS_OPTIONS = os.environ.get("OPENCV_FFMPEG_CAPTURE_OPTIONS")
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # quiet: what FFmpeg prints may hold a password
import cv2  # noqa: E402
import numpy as np  # noqa: E402

from anytraverse.decoding import MAX_BYTES, PictureTooLargeError, check_size  # noqa: E402
from companion.cameras import BadFrame, CameraError, CameraOptions, Capture  # noqa: E402
from companion.cameras.late_frames import CAME_LATE, LateFrames, StreamClock  # noqa: E402
from companion.cameras.places import network_url  # noqa: E402
from companion.cameras.shown import address  # noqa: E402

OPENS_WITHIN = 3.0
LEAST_READ_TIMEOUT = 2.0
_PROBE_TIMEOUT = 1.0
_NEXT_HEADER = 1024
"""Bytes that may wait behind a picture although it is the newest: the header of the next one."""
_IDLE_SHARE = 0.25
"""Share of its time for which a reader waits that keeps up with its stream."""


class _Stream:
    """Reads one connection. `read` blocks for up to T, at least 2 s, whatever `timeout` says."""

    SCHEME: ClassVar[str]
    PORT: ClassVar[int]
    OPTIONS: ClassVar[str] = "fflags;nobuffer|flags;low_delay"
    TIMED: ClassVar[bool] = False
    """Whether the stream has time stamps of the camera."""

    def __init__(self, place: str, options: CameraOptions) -> None:
        self._url = network_url(f"{self.SCHEME}:{place}")
        self._name = address(self._url.geturl())
        self._latency, self._freshness = options.latency, options.freshness
        self._late, self._clock = LateFrames(options.freshness), StreamClock()
        os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = _USERS_OPTIONS or self.OPTIONS
        # OpenCV's warnings hold the URL with its password.
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        _bound_ffmpeg()
        settings = {
            cv2.CAP_PROP_OPEN_TIMEOUT_MSEC: round(1e3 * OPENS_WITHIN),
            cv2.CAP_PROP_READ_TIMEOUT_MSEC: round(1e3 * max(LEAST_READ_TIMEOUT, options.freshness)),
            cv2.CAP_PROP_N_THREADS: 1,  # each further decoder thread holds a frame back
        }
        flat = [value for pair in settings.items() for value in pair]
        began = self._caught_up_at = self._read_at = time.monotonic()
        others = _open_sockets()
        self._video = cv2.VideoCapture(self._url.geturl(), cv2.CAP_FFMPEG, flat)
        opened = {name: one for name, one in _open_sockets().items() if name not in others}
        self._sockets = list(_copies(opened.values()))
        if _USERS_OPTIONS is None:  # OpenCV reads them for files, too
            del os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"]
        try:
            if not self._video.isOpened():
                raise CameraError(self._why_not(time.monotonic() - began))
            width, height = cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT
            check_size(int(self._video.get(width)), int(self._video.get(height)))
        except PictureTooLargeError as error:
            self.close()
            raise CameraError(f"{self._name}: {error}") from error
        except CameraError:
            self.close()
            raise

    def read(self, timeout: float) -> Capture:  # noqa: ARG002
        began, busy = time.monotonic(), _busy()
        grabbed = self._video.grab()
        now = time.monotonic()
        if not grabbed:
            raise CameraError(
                f"{self._name} sends no more pictures{' (time-out)' if now - began > 1.0 else ''}: "
                "check camera, power and network"
            )
        if self.TIMED:
            delay = self._clock.delay(now, self._video.get(cv2.CAP_PROP_POS_MSEC) / 1e3)
        else:
            delay = self._behind(now, now - began - (_busy() - busy))
        if self._late.is_late(now) or delay > self._freshness:
            raise BadFrame(CAME_LATE)
        ok, picture = self._video.retrieve()
        if not ok:
            raise BadFrame(f"a picture of {self._name} cannot be decoded: check the network for losses")
        image = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8)
        return Capture(now - self._latency - delay, image, "stream" if self.TIMED else "arrival")

    def close(self) -> None:
        self._video.release()
        while self._sockets:
            self._sockets.pop().close()

    def _behind(self, now: float, idle: float) -> float:
        """Return the s by which the picture read `now` may be old since others wait behind it.

        Where this computer reads more slowly than the camera sends, pictures wait in the sockets. When none
        waited, or the reader was `idle` (s), a picture was the newest: all later ones were sent after it.
        """
        waits = any(_unread(one) > _NEXT_HEADER for one in self._sockets)
        if not waits or idle > _IDLE_SHARE * (now - self._read_at):
            self._caught_up_at = now
        self._read_at = now
        return now - self._caught_up_at

    def _why_not(self, took: float) -> str:
        """Say why the stream was not opened in `took` s. OpenCV does not, so the server is asked again."""
        host = self._url.hostname or ""
        try:
            with socket.create_connection((host, self._url.port or self.PORT), _PROBE_TIMEOUT) as plain:
                code = self._status_code(plain)
        except socket.gaierror:
            return f"the name of {self._name} is not known: check [camera] source and the network"
        except TimeoutError:
            return f"{self._name} does not answer: check camera, power and network"
        except ConnectionRefusedError:
            return f"nothing listens at {self._name}: check the port, and whether the camera's server runs"
        except OSError as error:
            return f"{self._name} cannot be reached ({error}): check camera, power and network"
        if took > 0.9 * OPENS_WITHIN:
            return f"{self._name} gave no picture in {OPENS_WITHIN:.0f} s: let it start, or check the network"
        match code:
            case 401 | 403:
                return f"{self._name} wants another user or password ({code}): check those in [camera] source"
            case 404:
                return f"{self._name} has no such stream (404): check the path in [camera] source"
            case 0:
                return f"{self._name} answers nothing that is known: check port and path in [camera] source"
            case _:
                return f"{self._name} answers ({code}), but sends no video that can be decoded: try it in VLC"

    def _status_code(self, plain: socket.socket) -> int:
        """Ask for the stream without user and password, and return the answer's code; 0 for none."""
        plain.settimeout(_PROBE_TIMEOUT)
        bare = self._url._replace(netloc=self._url.netloc.rpartition("@")[2])
        if self.SCHEME == "rtsp":
            request = f"DESCRIBE {bare.geturl()} RTSP/1.0\r\nCSeq: 1\r\nAccept: application/sdp\r\n\r\n"
        else:
            place = bare._replace(scheme="", netloc="").geturl() or "/"
            request = f"GET {place} HTTP/1.0\r\nHost: {bare.netloc}\r\n\r\n"
        if self.SCHEME == "https":
            plain = ssl._create_unverified_context().wrap_socket(plain, server_hostname=self._url.hostname)
        plain.sendall(request.encode())
        words = plain.recv(64).split(None, 2)
        return int(words[1]) if len(words) > 1 and words[1].isdigit() else 0


class RtspStream(_Stream):
    """Reads RTSP over TCP. Its time stamps show by how much a frame was delayed."""

    SCHEME, PORT, TIMED = "rtsp", 554, True
    OPTIONS = f"rtsp_transport;tcp|allowed_media_types;video|analyzeduration;500000|{_Stream.OPTIONS}"


class HttpStream(_Stream):
    """Reads a stream over HTTP, which has no time stamps of the camera's."""

    SCHEME, PORT = "http", 80


class HttpsStream(_Stream):
    """Reads a stream over HTTPS. The camera's certificate is not verified."""

    SCHEME, PORT = "https", 443


@cache
def _bound_ffmpeg() -> None:
    """Let no buffer of FFmpeg grow beyond MAX_BYTES: it collects whatever a camera calls one picture."""
    mapped = Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace").splitlines()
    for library in {line.split(maxsplit=5)[5] for line in mapped if "/libavutil" in line}:
        ctypes.CDLL(library).av_max_alloc(ctypes.c_size_t(MAX_BYTES))


def _open_sockets() -> dict[str, int]:
    """Return this process's sockets: their names, which are not used again, and descriptors."""
    found = {}
    for name in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):  # the listing's own is closed by now
            link = os.readlink(f"/proc/self/fd/{name}")
            if link.startswith("socket:"):
                found[link] = int(name)
    return found


def _copies(descriptors: Iterable[int]) -> Iterator[socket.socket]:
    """Yield a copy of each that is of TCP."""
    for descriptor in descriptors:
        copy = socket.socket(fileno=os.dup(descriptor))
        if copy.type == socket.SOCK_STREAM and copy.family in (socket.AF_INET, socket.AF_INET6):
            yield copy
        else:
            copy.close()


def _unread(stream: socket.socket) -> int:
    """Return the bytes that have come and were not read."""
    return int.from_bytes(fcntl.ioctl(stream, termios.FIONREAD, bytes(4)), sys.byteorder)


def _busy() -> float:
    """Return the s for which this thread has run, or was ready to run and had no CPU."""
    waited = 0
    with contextlib.suppress(OSError, ValueError, IndexError):
        waited = int(Path("/proc/thread-self/schedstat").read_text(encoding="ascii").split()[1])
    return time.thread_time() + waited / 1e9
