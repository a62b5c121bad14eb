"""Lists the cameras that are there and saves a picture of each (`companion cameras`)."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from companion.cameras import CameraError, CameraOptions, Capture
from companion.cameras.shown import shown
from companion.cameras.v4l2 import DeviceError, devices
from companion.config import ConfigError, load_config
from companion.desk.check.watching import newest_capture

_SETTLES = 1.0
"""Seconds after the first picture in which a camera sets its exposure."""
_LISTED_WITHIN = 10.0
_RPICAM = ("rpicam-vid", "libcamera-vid")
_RPICAM_LINE = "pipe:{} -t 0 -n --codec yuv420 --width 640 --height 480 --framerate 15 -o -"
_MOST_SIZES = 6


_ANY = CameraOptions()


@dataclass(frozen=True)
class Found:
    """A camera that is there.

    lines: what to write below [camera] in companion.toml. why: why it cannot be used, "" if it can.
    """

    name: str
    source: str = ""
    lines: tuple[str, ...] = ()
    options: CameraOptions = _ANY
    why: str = ""


def list_cameras(file: str, folder: str) -> int:
    """Print each camera and save its picture into `folder`. Returns 0 if there is a picture, else 1."""
    found = [*_configured(file), *plugged_in()]
    saved = 0
    for number, camera in enumerate(found, 1):
        print(f"{number}  {camera.name}")
        for line in camera.lines:
            print(f"   {line}")
        if camera.why:
            print(f"   {camera.why}")
            continue
        try:
            capture = newest_capture(camera.source, camera.options, _SETTLES)
            path = _save(capture, Path(folder) / f"camera-{number}.jpg")
        except (CameraError, OSError) as error:
            print(f"   {error}")
            continue
        saved += 1
        height, width, _ = capture.image.shape
        print(f"   {path}: {width} x {height}, time from {capture.timed_by}")
    if not found:
        print("no camera is plugged in, as far as the kernel knows")
    print('Network cameras are not searched for: write source = "rtsp://USER:PASSWORD@HOST/PATH" yourself.')
    return 0 if saved else 1


def plugged_in() -> Iterator[Found]:
    """Yield the cameras of this computer. Takes up to 10 s."""
    yield from _of_the_kernel()
    yield from _of_rpicam()
    yield from _of_depthai()


def _configured(file: str) -> Iterator[Found]:
    """Yield the camera of a configuration, if there is one."""
    if not os.path.isfile(file):
        return
    try:
        config = load_config(file)
    except ConfigError as error:
        yield Found(f"the one in {file}", why=str(error))
        return
    source = config.camera.source
    name = f"the one in {file}: {shown(source)}"
    yield Found(name, source, options=config.camera_options)


def _of_the_kernel() -> Iterator[Found]:
    for device in devices():
        if isinstance(device, DeviceError):
            yield Found("a camera", why=str(device))
            continue
        formats = [
            f"{name} {', '.join(f'{width}x{height}' for width, height in sizes[:_MOST_SIZES])}"
            for name, sizes in device.formats.items()
        ]
        source = f"v4l2:{device.path}"
        yield Found(f"{device.name}: {'; '.join(formats[:_MOST_SIZES])}", source, (f'source = "{source}"',))


def _of_rpicam() -> Iterator[Found]:
    """Yield the CSI cameras of a Raspberry Pi."""
    program = next((name for name in _RPICAM if shutil.which(name)), None)
    if program is None:
        return
    try:
        ran = subprocess.run(
            [program, "--list-cameras"], capture_output=True, text=True, timeout=_LISTED_WITHIN, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        yield Found("CSI cameras", why=f"{program} --list-cameras failed ({error}): type it yourself")
        return
    options = CameraOptions(width=640, height=480, pixel_format="yuv420p")
    for line in (ran.stdout + ran.stderr).splitlines():
        number, colon, name = line.strip().partition(" : ")
        if not colon or not number.isdecimal():
            continue
        source = f"{_RPICAM_LINE.format(program)} --camera {number}"
        lines = (f'source = "{source}"', "width = 640", "height = 480", 'pixel_format = "yuv420p"')
        yield Found(name, source, lines, options)


def _of_depthai() -> Iterator[Found]:
    """Yield the OAKs, where DepthAI is installed."""
    if find_spec("depthai") is None:
        return
    from companion.cameras.oak import oak_ids

    for number in oak_ids():
        yield Found(f"OAK {number}", f"oak:{number}", (f'source = "oak:{number}"',))


def _save(capture: Capture, path: Path) -> Path:
    import cv2

    path.parent.mkdir(parents=True, exist_ok=True)
    ok, jpeg = cv2.imencode(".jpg", cv2.cvtColor(capture.image, cv2.COLOR_RGB2BGR))
    if not ok:
        raise OSError(f"{path} cannot be encoded: try a smaller picture")
    path.write_bytes(jpeg.tobytes())
    return path
