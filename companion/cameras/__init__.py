"""Opens the camera that a source names: the `Camera` protocol, and one file for each kind of camera.

A source is named like a URL, `kind:place`: `video:drive.mp4`, `rtsp://camera/stream`, `pipe:COMMAND`.
A kind's module, and the vendor's software that it needs, is imported only when the kind is chosen.

Errors:

CameraError                 the camera must be opened again; the text says what to do
├── SourceError             this source can never be opened: correct the config
├── NoFrameYet              no frame came within the time-out; read again
├── BadFrame                one frame is damaged, late or has a wrong shape; read again
└── EndOfFrames             the file has ended; no more frames will come
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

from anytraverse.release import to_install
from companion.cameras.places import CameraError, SourceError, check_place, meant
from companion.cameras.shown import plain_words, shown

if TYPE_CHECKING:
    from anytraverse.frame import Depth, Image, Intrinsics
    from companion.cameras.calibration import LensCalibration

__all__ = [
    "KINDS",
    "BadFrame",
    "Camera",
    "CameraError",
    "CameraOptions",
    "Capture",
    "EndOfFrames",
    "NoFrameYet",
    "SourceError",
    "open_camera",
    "split_source",
]


class NoFrameYet(CameraError):  # noqa: N818
    """No frame came within the time-out; the camera stays open."""


class BadFrame(CameraError):  # noqa: N818
    """One frame was damaged, unreadable, late or had a wrong shape; the camera stays open."""


class EndOfFrames(CameraError):  # noqa: N818
    """The last frame of a file was read; no more will come."""


KINDS: dict[str, tuple[str, str]] = {
    "video": ("companion.cameras.video", "VideoFile"),
    "folder": ("companion.cameras.folder", "PictureFolder"),
    "field": ("companion.cameras.field", "FieldCamera"),
    "pipe": ("companion.cameras.pipe", "Pipe"),
    "rtsp": ("companion.cameras.network", "RtspStream"),
    "http": ("companion.cameras.network", "HttpStream"),
    "https": ("companion.cameras.network", "HttpsStream"),
    "v4l2": ("companion.cameras.v4l2", "V4l2Device"),
    "oak": ("companion.cameras.oak", "OakCamera"),
}
"""Kind -> (module, class). To add a kind, write one file and add one line here."""


class Capture(NamedTuple):
    """One picture that a camera delivered.

    captured_at: seconds of time.monotonic() when the picture was taken, as exactly as the camera knows it.
    image: RGB, (height, width, 3) uint8; the camera never writes to it again.
    timed_by: what captured_at is from: "sensor"; "arrival", less the configured latency; "stream", the same
    less the delay that the stream's own time stamps show; "player" for files.
    depth, intrinsics: of this picture, None where the camera does not tell.
    """

    captured_at: float
    image: Image
    timed_by: str = "player"
    depth: Depth | None = None
    intrinsics: Intrinsics | None = None


@dataclass(frozen=True)
class CameraOptions:
    """Says how a camera is opened. None: as the camera or the file itself says.

    playback: frames/s of a video or folder. loop: whether it starts again at its end. width, height: pixels.
    pixel_format: a name in `PIXEL_FORMATS`. fps: frames/s that the camera is asked for. exposure: s, instead
    of the camera's automatic exposure. latency: s from exposure to arrival, where the camera does not report
    it. freshness: the limit T in s; a frame that was delayed for longer is dropped. depth: whether an OAK
    measures depth, too. calibration: by which pictures are rectified.
    """

    playback: float | None = None
    loop: bool = False
    width: int | None = None
    height: int | None = None
    pixel_format: str | None = None
    fps: float | None = None
    exposure: float | None = None
    latency: float = 0.0
    freshness: float = 2.0
    depth: bool = False
    calibration: LensCalibration | None = None


class Camera(Protocol):
    """Delivers pictures. One thread creates, reads and closes it.

    The constructor opens the device. It may block for some seconds, and raises CameraError when the device
    is absent.
    """

    def read(self, timeout: float) -> Capture:
        """Return the next picture; block up to `timeout` seconds for it.

        A live camera returns its newest picture, at most one frame period old when `read` is called often
        enough. A file returns every picture in turn, at a fixed rate as if it were live.
        Raises NoFrameYet and BadFrame, after which the caller may read again; EndOfFrames when no more will
        come; any other CameraError when the camera must be opened again.
        """

    def close(self) -> None:
        """Release the device at once. May be called more than once."""


CameraMaker = Callable[[str, CameraOptions], Camera]


def split_source(source: str) -> tuple[str, str]:
    """Split a source into (kind, place). Raises SourceError for what can be no camera; nothing is opened."""
    kind, _, place = source.partition(":")
    if kind not in KINDS:
        near = meant(source, KINDS)
        hint = f'did you mean "{near}"? It begins with' if near else "begin with"
        known = ", ".join(f"{name}:..." for name in KINDS)
        raise SourceError(f'"{shown(source)}" names no camera: {hint} one of {known}')
    check_place(kind, place)
    return kind, place


def open_camera(source: str, options: CameraOptions | None = None) -> Camera:
    """Open the camera that `source` names; may block for some seconds.

    Raises SourceError when the source can never work, another CameraError when the camera is absent now.
    """
    kind, place = split_source(source)
    module, name = KINDS[kind]
    try:
        maker: CameraMaker = getattr(importlib.import_module(module), name)
    except ImportError as error:
        extra = "oak" if error.name == "depthai" else "rover"
        raise SourceError(f'camera "{kind}" needs {error.name}: {to_install(extra)}') from error
    options = options or CameraOptions()
    try:
        camera = maker(place, options)
    except CameraError:
        raise
    except Exception as error:  # a driver may raise anything, with the source in it
        told = plain_words(str(error), source) or type(error).__name__
        raise CameraError(f"{shown(source)} cannot be opened: {told}") from None
    if options.calibration is None:
        return camera
    rectified: Camera = importlib.import_module("companion.cameras.rectified").RectifiedCamera(
        camera, options.calibration
    )
    return rectified
