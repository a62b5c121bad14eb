"""Where frames come from: the `Camera` protocol and its kinds, one file a kind.

A source is named like a URL, `kind:place`: `video:drive.mp4`, `folder:pictures`, `field:127.0.0.1:5600`.
A kind's module, and the vendor's software that it needs, is imported only when the kind is chosen.

Errors:

CameraError                 the camera must be opened anew; its text tells what to do
├── SourceError             no camera can ever be made of this source: mend the config
├── NoFrameYet              none in time; reading again is fine
├── BadFrame                this one is torn or misshapen; reading again is fine
└── EndOfFrames             the file has ended; no more will come
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from anytraverse.frame import Image

__all__ = [
    "KINDS",
    "BadFrame",
    "Camera",
    "CameraError",
    "Capture",
    "EndOfFrames",
    "NoFrameYet",
    "Playback",
    "SourceError",
    "open_camera",
    "split_source",
]


class CameraError(Exception):
    """The camera is absent or lost: open it anew. The text tells what to look at."""


class SourceError(CameraError, ValueError):
    """A source that names no camera, or one whose software is not installed."""


class NoFrameYet(CameraError):  # noqa: N818
    """No frame came in the time given; the camera stays open."""


class BadFrame(CameraError):  # noqa: N818
    """One frame was torn, misshapen or unreadable; the camera stays open."""


class EndOfFrames(CameraError):  # noqa: N818
    """The last frame of a file was read; no more will come."""


KINDS: dict[str, tuple[str, str]] = {
    "video": ("companion.cameras.video", "VideoFile"),
    "folder": ("companion.cameras.folder", "PictureFolder"),
    "field": ("companion.cameras.field", "FieldCamera"),
}
"""Kind -> (module, class). A new kind is one file and one line here."""


class Capture(NamedTuple):
    """What a camera delivers.

    captured_at: seconds of time.monotonic() when the picture was taken, as close as the camera can tell.
    image: RGB, (height, width, 3) uint8, the caller's own.
    """

    captured_at: float
    image: Image


@dataclass(frozen=True)
class Playback:
    """How files are played. rate: frames/s, None for the video's own. loop: start again at the end."""

    rate: float | None = None
    loop: bool = False


class Camera(Protocol):
    """An open camera. One thread makes, reads and closes it.

    Making one opens it, which may block for some seconds, and raises CameraError when it is absent.
    """

    def read(self, timeout: float) -> Capture:
        """The next picture; blocks up to `timeout` seconds for it.

        A live camera gives its newest picture, at most one frame period old when `read` is called often
        enough; a file gives every picture in turn, paced as if it were live.
        Raises NoFrameYet and BadFrame, after which reading goes on; EndOfFrames when no more will come;
        any other CameraError when the camera must be opened anew.
        """

    def close(self) -> None:
        """Give the device back, at once; more than once is fine."""


CameraMaker = Callable[[str, Playback], Camera]


def split_source(source: str) -> tuple[str, str]:
    """(kind, place) of a source. Raises SourceError when there is no such kind, or no place."""
    kind, _, place = source.partition(":")
    if kind not in KINDS:
        known = ", ".join(f"{name}:..." for name in KINDS)
        raise SourceError(f'"{source}" names no camera: begin with one of {known}')
    if not place:
        raise SourceError(f'"{source}" says what kind of camera but not where: write {kind}:PLACE')
    return kind, place


def open_camera(source: str, playback: Playback | None = None) -> Camera:
    """The opened camera called `source`; may block for some seconds.

    Raises SourceError when it can never work, another CameraError when it is not there now.
    """
    kind, place = split_source(source)
    module, name = KINDS[kind]
    try:
        maker: CameraMaker = getattr(importlib.import_module(module), name)
    except ImportError as error:
        raise SourceError(
            f'camera "{kind}" needs {error.name}: pip install "anytraverse-companion[rover]"'
        ) from error
    return maker(place, playback or Playback())
