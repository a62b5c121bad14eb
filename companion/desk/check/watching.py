"""Watches the camera for some seconds, and measures what it delivers."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median

from anytraverse.frame import is_image
from anytraverse.regions import Box
from companion.cameras import (
    BadFrame,
    Camera,
    CameraError,
    CameraOptions,
    Capture,
    EndOfFrames,
    NoFrameYet,
    open_camera,
)
from companion.config import Config
from companion.vision.exposure import exposure_name
from companion.vision.freeze_detector import luma
from companion.vision.infrared import magenta_share

SEEN_WITHIN = 5.0
"""Seconds to wait for the first picture."""
WATCHED, LONGEST = 2.0, 8.0
"""Seconds for which pictures are counted: at least, and at most; in between, as long as four should take."""
_WHITE = 250
"""Brightness, of 255, from which on a pixel counts as white."""


@dataclass(frozen=True)
class CameraDelivery:
    """Holds what the camera delivered.

    trouble: why no picture came; then nothing else counts. width, height: pixels. rate: pictures a second,
    None where too few came. age: seconds from capture to arrival, the median. bad: damaged pictures.
    brightness, contrast: mean and standard deviation of the newest picture, of 255. white: share of its
    pixels that are white. exposure: its name as in `ADVICE` of vision/exposure. magenta: the median of the
    pictures' `magenta_share`, None where all are too dark or too bright.
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
    exposure: str = ""
    magenta: float | None = None


@dataclass
class WatchedCamera:
    """Collects what the camera delivers. why: why no picture came so far. ended: no more will come."""

    why: str = f"no picture in {SEEN_WITHIN:.0f} s: check cable, light and address"
    arrived: list[float] = field(default_factory=list)
    ages: list[float] = field(default_factory=list)
    magenta: list[float] = field(default_factory=list)
    bad: int = 0
    ended: bool = False
    newest: Capture | None = None

    def read(self, camera: Camera) -> None:
        """Wait for the next picture, 0.5 s at most. Raises CameraError when the camera is lost."""
        try:
            capture = camera.read(0.5)
            if not is_image(capture.image):
                raise BadFrame("not an RGB picture of 8 bits a channel: check the camera's pixel format")
        except NoFrameYet:
            return
        except BadFrame as error:
            self.why, self.bad = str(error), self.bad + 1
            return
        except EndOfFrames as error:
            self.why, self.ended = self.why if self.bad else str(error), True
            return
        now = time.monotonic()
        self.arrived.append(now)
        self.ages.append(now - capture.captured_at)
        self.newest = capture
        share = magenta_share(capture.image)
        if share is not None:
            self.magenta.append(share)

    def forget_before(self, newest: int) -> None:
        """Keep what is known of so many pictures, and of the newest one."""
        for known in (self.arrived, self.ages, self.magenta):
            del known[:-newest]

    def delivery(self, roi: Box) -> CameraDelivery:
        """Return what came so far. roi: by which the exposure is judged."""
        if self.newest is None:
            return CameraDelivery(self.why)
        silence = 0.0 if self.ended else time.monotonic() - self.arrived[-1]
        image = self.newest.image
        grey = image.mean(axis=2)
        return CameraDelivery(
            width=int(image.shape[1]),
            height=int(image.shape[0]),
            rate=_rate(self.arrived, silence),
            age=median(self.ages),
            bad=self.bad,
            brightness=float(grey.mean()),
            contrast=float(grey.std()),
            white=float((grey >= _WHITE).mean()),
            exposure=exposure_name(luma(image), roi),
            magenta=median(self.magenta) if self.magenta else None,
        )


def _read_for(source: str, options: CameraOptions, seconds: float) -> WatchedCamera:
    """Open a camera, wait up to 5 s for a first picture, and read for `seconds` more. Raises CameraError."""
    watched = WatchedCamera()
    camera = open_camera(source, options)
    try:
        until = time.monotonic() + SEEN_WITHIN
        while time.monotonic() < until and not watched.ended:
            first = not watched.arrived
            watched.read(camera)
            if first and watched.arrived:
                until = watched.arrived[0] + seconds
    finally:
        camera.close()
    return watched


def newest_capture(source: str, options: CameraOptions, settles: float) -> Capture:
    """Open a camera, and return the newest picture `settles` s after its first one. Raises CameraError."""
    watched = _read_for(source, options, settles)
    if watched.newest is None:
        raise CameraError(watched.why)
    return watched.newest


def watch(config: Config) -> CameraDelivery:
    """Open the camera, wait up to 5 s for a first picture, and watch it for 2 to 8 s."""
    seconds = min(LONGEST, max(WATCHED, 4.0 / config.camera.rate))
    try:
        watched = _read_for(config.camera.source, config.camera_options, seconds)
    except CameraError as error:
        return CameraDelivery(str(error))
    roi = config.roi
    return watched.delivery(Box(roi.left, roi.top, roi.right, roi.bottom))


def _rate(arrived: list[float], silence: float) -> float | None:
    """Calculate pictures a second; None where only one came and no more will. arrived: seconds of each.

    silence: seconds without a picture after the last one. They count if that is over twice the longest gap.
    """
    gaps = [after - before for before, after in pairwise(arrived)]
    if not gaps:
        return 0.0 if silence > 0.0 else None
    seconds = sum(gaps) + (silence if silence > 2.0 * max(gaps) else 0.0)
    return len(gaps) / seconds if seconds > 0.0 else None
