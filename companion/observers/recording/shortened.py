"""Chooses what an incident file for a radio has of a recording: few and small frames, no maps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from anytraverse.decoding import decode
from companion.observers.recording.contents import image
from companion.observers.recording.foxglove import NS, jpeg_of
from companion.observers.recording.topics import TOPICS, Topic

if TYPE_CHECKING:
    from companion.observers.recording.reading import Read

Window = tuple[int, int]
"""Begin and end in ns since 1970."""
FRAMES = 6
"""Frames, at most."""
FRAME_WIDTH, FRAME_QUALITY = 320, 60
"""Pixels of a frame, at most, and its JPEG quality."""
_CAMERA = TOPICS[Topic.CAMERA].name
_SELDOM = frozenset(TOPICS[one].name for one in (Topic.ASSESSMENT, Topic.VEHICLE, Topic.LOCATION))
"""Topics of which one message a second is taken."""
_LEFT_OUT = frozenset(
    TOPICS[one].name for one in (Topic.TRAVERSABILITY, Topic.UNCERTAINTY, Topic.ANNOTATIONS, Topic.STATUS)
)
"""Topics of which nothing is taken. Annotations would not fit the smaller frames."""


class Shortened:
    """Takes what a short file has of the messages of some windows."""

    def __init__(self, recordings: Sequence[Path], windows: Sequence[Window]) -> None:
        """Read when frames were captured. recordings: the oldest first. Raises OSError."""
        self._frames = _spread(recordings, windows)
        self._newest: dict[str, int] = {}

    def take(self, one: Read) -> Read | None:
        """Return a message as a short file has it, None for one that it lacks."""
        topic, at = one.channel.topic, one.message.log_time
        if topic in _LEFT_OUT or (topic == _CAMERA and at not in self._frames):
            return None
        if topic in _SELDOM:
            if at - self._newest.get(topic, -NS) < NS:
                return None
            self._newest[topic] = at
        return _smaller(one) if topic == _CAMERA else one


def _spread(recordings: Sequence[Path], windows: Sequence[Window]) -> frozenset[int]:
    """Choose frames of the windows, evenly spread. Returns when they were captured, ns since 1970."""
    from companion.observers.recording.reading import messages

    times = sorted(
        one.message.log_time
        for path in recordings
        for one in messages(path, [_CAMERA], windows[0][0], windows[-1][1])
        if any(begin <= one.message.log_time < end for begin, end in windows)
    )
    return frozenset(times[round(part * (len(times) - 1) / (FRAMES - 1))] for part in range(FRAMES) if times)


def _smaller(one: Read) -> Read | None:
    """Return a frame smaller, None for one that cannot be decoded."""
    import cv2

    try:
        frame = decode(jpeg_of(one.message.data))
    except ValueError:
        return None
    if frame is None:
        return None
    height, width = frame.shape[:2]
    if width > FRAME_WIDTH:
        size = FRAME_WIDTH, max(1, round(height * FRAME_WIDTH / width))
        frame = cv2.resize(frame, size, interpolation=cv2.INTER_AREA)
    jpeg = cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, FRAME_QUALITY])[1].tobytes()
    return one._replace(message=replace(one.message, data=image(jpeg, "jpeg", one.message.log_time)))
