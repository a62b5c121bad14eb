"""Plays an MJPEG camera over HTTP that sends good pictures, or what no camera should."""

from __future__ import annotations

import contextlib
import random
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import chain, count, cycle, repeat

import cv2

from bench.faults.standing import StandingPicture

GOOD = "good"
_PERIOD = 0.1
_SIZES = ((96, 128), (1080, 1920), (16, 16), (480, 640), (2000, 3000), (8, 1600))
"""Rows and columns."""


def jpeg_of(rows: int = 96, columns: int = 128, picture: StandingPicture | None = None) -> bytes:
    """Return a picture of grass."""
    small = (picture or StandingPicture(0)).draw(thing=False)[..., ::-1]
    large = cv2.resize(small, (columns, rows), interpolation=cv2.INTER_NEAREST)
    return bytes(cv2.imencode(".jpg", large)[1])


@cache
def _huge() -> bytes:
    """Return some megabytes that are 324 MB in colour."""
    return jpeg_of(9_000, 12_000)


def _named_huge() -> bytes:
    named = bytearray(jpeg_of())
    at = named.index(b"\xff\xc0") + 5
    named[at : at + 4] = 2 * (60_000).to_bytes(2, "big")
    return bytes(named)


def _parts(pictures: Iterable[bytes]) -> Iterator[bytes]:
    for jpeg in pictures:
        yield b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n%b\r\n" % (len(jpeg), jpeg)
        time.sleep(_PERIOD)


def _good() -> Iterator[bytes]:
    picture = StandingPicture(1)
    return _parts(jpeg_of(picture=picture) for _ in count())


def _trickle() -> Iterator[bytes]:
    for byte in chain.from_iterable(_good()):
        yield bytes([byte])
        time.sleep(_PERIOD)


_LONG = b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: 2147483647\r\n\r\n\xff\xd8"
WAYS: Mapping[str, Callable[[], Iterator[bytes]]] = {
    "pictures of 108 million pixels": lambda: _parts(repeat(_huge())),
    "the same after good ones": lambda: _parts(chain([jpeg_of()] * 5, repeat(_huge()))),
    "pictures that name 3600 million pixels": lambda: _parts(repeat(_named_huge())),
    "truncated pictures": lambda: _parts(jpeg_of()[: 20 + number * 97 % 1500] for number in count()),
    "another size in each frame": lambda: _parts(cycle([jpeg_of(*size) for size in _SIZES])),
    "headers without end": lambda: chain([b"--frame\r\n"], repeat(b"X-Endless: %b\r\n" % (b"y" * 4000))),
    "a header without end": lambda: chain([b"--frame\r\nContent-Length: "], repeat(b"9" * 65_536)),
    "a picture of 2 GB": lambda: chain([_LONG], repeat(bytes(65_536))),
    "a byte at a time": _trickle,
    "garbage": lambda: (random.Random(number).randbytes(65_536) for number in count()),
}


class HostileCamera(ThreadingHTTPServer):
    """The camera, at `source`. way: `GOOD` or one of `WAYS`, which may change at any time."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.source, self.way = f"http://127.0.0.1:{self.server_port}/trail", GOOD
        threading.Thread(target=self.serve_forever, daemon=True).start()

    def close(self) -> None:
        """End it, and all its streams."""
        self.way = ""
        self.shutdown()
        self.server_close()


class _Handler(BaseHTTPRequestHandler):
    server: HostileCamera

    def do_GET(self) -> None:
        way = self.server.way
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        for content in WAYS.get(way, _good)():
            if self.server.way != way:  # a new connection gets what is due now
                return
            self.wfile.write(content)

    def log_message(self, *_: object) -> None:
        """Say nothing."""

    def handle(self) -> None:
        with contextlib.suppress(OSError):  # the reader is gone
            super().handle()
