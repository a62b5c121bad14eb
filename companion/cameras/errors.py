"""Every error that a camera raises on purpose.

CameraError                 the camera must be opened anew; its text tells what to do
├── SourceError             no camera can ever be made of this source: mend the config
├── NoFrameYet              none in time; reading again is fine
├── BadFrame                this one is torn or misshapen; reading again is fine
└── EndOfFrames             the file has ended; no more will come
"""

from __future__ import annotations


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
