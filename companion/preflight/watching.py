"""Watches the camera for some seconds, and measures what it delivers."""

from __future__ import annotations

import time
from dataclasses import dataclass
from statistics import median

from anytraverse.frame import Image, is_image
from companion.cameras import BadFrame, CameraError, EndOfFrames, NoFrameYet, Playback, open_camera
from companion.config import Config

SEEN_WITHIN = 5.0
"""Seconds to wait for the first picture."""
WATCHED, LONGEST = 2.0, 8.0
"""Seconds for which pictures are counted: at least, and at most; in between, as long as four should take."""
_WHITE = 250
"""Brightness, of 255, from which on a pixel counts as white."""


@dataclass(frozen=True)
class Seen:
    """Holds what the camera delivered.

    trouble: why no picture came; then nothing else counts. width, height: pixels. rate: pictures a second,
    None where too few came. age: seconds from capture to arrival, the median. bad: damaged pictures.
    brightness, contrast: mean and standard deviation of the newest picture, of 255. white: share of its
    pixels that are white.
    """

    trouble: str = ""
    width: int = 0
    height: int = 0
    rate: float | None = None
    age: float = 0.0
    bad: int = 0
    brightness: float = 0.0
    contrast: float = 0.0
    white: float = 0.0


def watch(config: Config) -> Seen:
    """Open the camera, wait up to 5 s for a first picture, and watch it for 2 to 8 s."""
    try:
        camera = open_camera(config.camera.source, Playback(config.camera.playback, config.camera.loop))
    except CameraError as error:
        return Seen(str(error))
    why = f"no picture in {SEEN_WITHIN:.0f} s: check cable, light and address"
    arrived, ages, bad, newest = list[float](), list[float](), 0, None
    until = time.monotonic() + SEEN_WITHIN
    try:
        while time.monotonic() < until:
            try:
                captured_at, image = camera.read(0.5)
                if not is_image(image):
                    raise BadFrame("not an RGB picture of 8 bits a channel: check the camera's pixel format")
            except NoFrameYet:
                continue
            except BadFrame as error:
                why, bad = str(error), bad + 1
                continue
            except EndOfFrames as error:
                why = why if bad else str(error)
                break
            now = time.monotonic()
            if newest is None:
                until = now + min(LONGEST, max(WATCHED, 4.0 / config.camera.rate))
            arrived.append(now)
            ages.append(now - captured_at)
            newest = image
    except CameraError as error:
        if newest is None:
            return Seen(str(error))
    finally:
        camera.close()
    if newest is None:
        return Seen(why)
    seconds = arrived[-1] - arrived[0]
    rate = (len(arrived) - 1) / seconds if seconds > 0.0 else None
    return _exposed(newest, rate, median(ages), bad)


def _exposed(image: Image, rate: float | None, age: float, bad: int) -> Seen:
    grey = image.mean(axis=2)
    return Seen(
        width=int(image.shape[1]),
        height=int(image.shape[0]),
        rate=rate,
        age=age,
        bad=bad,
        brightness=float(grey.mean()),
        contrast=float(grey.std()),
        white=float((grey >= _WHITE).mean()),
    )
