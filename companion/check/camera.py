"""Whether the camera gives a picture, and one of the shape that the stopping distance is reckoned with."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from companion.cameras import BadFrame, CameraError, EndOfFrames, NoFrameYet, Playback, open_camera
from companion.check.finding import Finding, failed, passed, warned
from companion.config import Config

CHECK = "camera"
SEEN_WITHIN = 5.0
_ASPECT_OFF = 0.02


def check_camera(config: Config, running: Mapping[str, Any] | None) -> Finding:
    """Up to 5 s for a first picture. running: what the companion that runs, if one does, says of itself."""
    if running is not None:
        return _of_the_running(running.get("camera") or {})
    try:
        width, height = _look(config)
    except CameraError as error:
        return failed(CHECK, str(error))
    what = f"{config.camera.source}, {width} x {height}"
    aspect = config.mount.aspect
    if config.mount.height is not None and abs(width / height / aspect - 1.0) > _ASPECT_OFF:
        return warned(
            CHECK,
            f"{what}, and [mount] aspect is {aspect:g}: "
            f"set it to {width / height:.3f}, or the row stopping is wrong",
        )
    return passed(CHECK, what)


def _look(config: Config) -> tuple[int, int]:
    """Width and height of the first picture. Raises CameraError."""
    deadline = time.monotonic() + SEEN_WITHIN
    why: CameraError = CameraError(f"no picture in {SEEN_WITHIN:.0f} s: check cable, light and address")
    camera = open_camera(config.camera.source, Playback(config.camera.playback, config.camera.loop))
    try:
        while time.monotonic() < deadline:
            try:
                image = camera.read(0.5).image
            except NoFrameYet:
                continue
            except BadFrame as bad:
                why = bad
                continue
            except EndOfFrames as end:
                raise (why if isinstance(why, BadFrame) else end) from end
            return int(image.shape[1]), int(image.shape[0])
        raise why
    finally:
        camera.close()


def _of_the_running(camera: Mapping[str, Any]) -> Finding:
    state, reason = str(camera.get("state", "unknown")), str(camera.get("reason") or "")
    what = f"{state}, with the companion that runs"
    if state == "delivering":
        return passed(CHECK, what)
    if state in ("failed", "ended"):
        return failed(CHECK, f"{what}: {reason}" if reason else what)
    return warned(CHECK, f"{what}: wait, then type this again")
