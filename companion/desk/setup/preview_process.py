"""Opens a camera for the page, in a process of its own: a driver that hangs or crashes harms nothing else."""

from __future__ import annotations

import json
import signal
import sys
import time
from dataclasses import asdict
from multiprocessing.connection import Connection

import cv2

from anytraverse.frame import Image
from anytraverse.regions import Box
from companion.cameras import CameraError, CameraOptions, open_camera
from companion.desk.check.watching import SEEN_WITHIN, CameraDelivery, WatchedCamera
from companion.system.child_process import end_with

LARGEST = 4 << 20
"""Bytes of a message: one line of JSON, then a JPEG."""
WIDEST = 960
"""Pixels of the picture that is shown."""
_EVERY = 0.2
"""Seconds between two messages."""
_ENOUGH, _COUNTED = 3, 60
"""Pictures by which rate and age are measured, at least and at most."""
_QUALITY = 92


def main(descriptor: int, parent: int) -> None:
    """Show the camera that the first message names. descriptor: of our end of the connection.

    parent: its process id; this process ends with it, whatever a driver does.
    """
    end_with(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the command says when to end
    signal.signal(signal.SIGTERM, _end)
    out = Connection(descriptor)
    source, options, roi = out.recv()
    show(source, options, roi, out)


def _end(_number: int, _frame: object) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise SystemExit


def show(source: str, options: CameraOptions, roi: Box, out: Connection) -> None:
    """Open a camera, and send what it delivers until nobody reads it. Ends where the camera does."""
    try:
        _show(source, options, roi, out)
    except CameraError as error:
        _send(out, CameraDelivery(str(error)), b"")
    except (BrokenPipeError, ConnectionError):
        pass


def _show(source: str, options: CameraOptions, roi: Box, out: Connection) -> None:
    watched, began, sent_at = WatchedCamera(), time.monotonic(), 0.0
    camera = open_camera(source, options)
    try:
        while not watched.ended:
            watched.read(camera)
            watched.forget_before(_COUNTED)
            now = time.monotonic()
            few = len(watched.arrived) < _ENOUGH and now - began < SEEN_WITHIN
            if few or now - sent_at < _EVERY:
                continue
            sent_at = now
            newest = watched.newest
            _send(out, watched.delivery(roi), b"" if newest is None else _jpeg(newest.image))
    finally:
        camera.close()
    if watched.newest is None:
        _send(out, CameraDelivery(watched.why), b"")


def _jpeg(image: Image) -> bytes:
    height, width = image.shape[:2]
    turned = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    if width > WIDEST:
        turned = cv2.resize(turned, (WIDEST, round(height * WIDEST / width)), interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", turned, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()


def _send(out: Connection, seen: CameraDelivery, jpeg: bytes) -> None:
    out.send_bytes(json.dumps(asdict(seen)).encode() + b"\n" + jpeg)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
