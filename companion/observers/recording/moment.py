"""Tells what was so at a moment of a recording: the picture, its maps, how it was judged, state and vehicle.

A recording may come from anybody, so that each value is checked.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping
from typing import Any

from mcap.records import Message as Written

from companion.observers.recording.contents import read_json
from companion.observers.recording.foxglove import NS, jpeg_of, outlines_of
from companion.observers.recording.seeking import Seeker
from companion.observers.recording.topics import TOPICS, Topic
from companion.wire.json_values import list_of, mapping_of, number_of, text_of, weights_of, whole_of
from companion.wire.packing import clean

MS = 1_000_000
"""Nanoseconds of a millisecond."""
_LARGEST_PICTURE, _LARGEST_MAP = 4 << 20, 1 << 20
_WIDEST_MAP = 4096
"""Pixels: a browser unpacks it."""
_JUDGED_WITHIN = 5 * NS
"""How long after its capture a frame was judged, at most."""
_MOST = 8
"""Reasons, and outlines, that are told."""


class Moments:
    """Tells of the moments of one recording. Times are ms since its begin."""

    def __init__(self, seeker: Seeker, begin: int) -> None:
        """begin: ns since 1970."""
        self._seeker = seeker
        self._begin = begin

    def frame(self, at: int) -> bytes:
        """Return the picture at a moment, as JPEG; b"" where there is none. Raises OSError."""
        found, _, _ = self._frame(at)
        return _picture(found, b"\xff\xd8", _LARGEST_PICTURE) if found is not None else b""

    def moment(self, at: int) -> dict[str, Any]:
        """Tell what was so at the last frame until a moment, else at the first one. Raises OSError."""
        found, before, after = self._frame(at)
        seen = found.log_time if found is not None else self._until(at)
        told: dict[str, Any] = {
            "at": self._ms(seen),
            "previous": None if before is None else self._ms(before.log_time),
            "next": None if after is None else self._ms(after.log_time),
            "time": round(seen / NS, 3),
        }
        if found is not None:
            told |= {"frame": found.sequence, **self._pictures(found)}
        return told | self._state(seen) | self._vehicle(seen)

    def _until(self, at: int) -> int:
        """Return the last nanosecond of a millisecond, since 1970."""
        return self._begin + (at + 1) * MS - 1

    def _ms(self, at: int) -> int:
        return max(0, (at - self._begin) // MS)

    def _frame(self, at: int) -> tuple[Written | None, Written | None, Written | None]:
        """Return the frame at a moment, and those before and after it."""
        until = self._until(at)
        frames = self._seeker.around(_name(Topic.CAMERA), until)
        place = max(0, sum(one.log_time <= until for one in frames) - 1)
        here = frames[place] if frames else None
        before = frames[place - 1] if place else None
        return here, before, frames[place + 1] if place + 1 < len(frames) else None

    def _pictures(self, frame: Written) -> dict[str, Any]:
        """Tell the picture of a frame, what it was judged as, and what is marked in it."""
        at, told = frame.log_time, {"picture": _picture(frame, b"\xff\xd8", _LARGEST_PICTURE)}
        for name, topic in (("traversability", Topic.TRAVERSABILITY), ("uncertainty", Topic.UNCERTAINTY)):
            its = self._belonging(topic, frame, at)
            png = _picture(its, b"\x89PNG\r\n\x1a\n", _LARGEST_MAP) if its is not None else b""
            told[name] = png if _is_small(png) else b""
        outlines = self._outlines(self._belonging(Topic.ANNOTATIONS, frame, at))
        judged = self._belonging(Topic.ASSESSMENT, frame, at + _JUDGED_WITHIN)
        return {
            **{name: b64encode(one).decode() for name, one in told.items()},
            "outlines": outlines,
            "judged": _judged(read_json(judged.data)) if judged is not None else None,
        }

    def _belonging(self, topic: Topic, frame: Written, until: int) -> Written | None:
        """Return the message of a topic that belongs to a frame. until: ns, when it is at the latest."""
        for one in self._seeker.around(_name(topic), frame.log_time):
            if one.sequence == frame.sequence and frame.log_time <= one.log_time <= until:
                return one
        return None

    def _outlines(self, told: Written | None) -> list[list[tuple[float, float]]]:
        """Return the region of interest, and where it is to look, in pixels of the picture."""
        try:
            found = outlines_of(told.data) if told is not None else []
        except ValueError:
            return []
        fine = [
            [(round(x, 1), round(y, 1)) for x, y in one[:_MOST] if abs(x) < 1e5 and abs(y) < 1e5]
            for one in found
        ]
        return fine[:_MOST]

    def _state(self, at: int) -> dict[str, Any]:
        told = self._last(Topic.STATE, at)
        return {
            **{name: clean(text_of(told.get(name))) for name in ("state", "policy", "kind", "stage")},
            "open": whole_of(told.get("open"), 1, 0xFFFF),
            "holding": told.get("holding") is True,
            "reasons": [clean(text_of(one)) for one in list_of(told.get("reasons"))[:_MOST]],
            "words": weights_of(self._last(Topic.WORDS, at).get("words")),
        }

    def _vehicle(self, at: int) -> dict[str, Any]:
        told = self._last(Topic.VEHICLE, at)
        place = [number_of(one, -1e6, 1e6) for one in list_of(told.get("position"))[:3]]
        return {
            "speed": number_of(told.get("speed"), -100, 100),
            "armed": told.get("armed") if isinstance(told.get("armed"), bool) else None,
            "place": place[:2] if len(place) == 3 and None not in place else None,
        }

    def _last(self, topic: Topic, at: int) -> Mapping[str, Any]:
        found = self._seeker.last(_name(topic), at)
        return read_json(found.data) if found is not None else {}


def _name(topic: Topic) -> str:
    return TOPICS[topic].name


def _picture(message: Written, begins: bytes, most: int) -> bytes:
    """Return the picture of a foxglove.CompressedImage that begins so, b"" for any other bytes."""
    try:
        found = jpeg_of(message.data)
    except ValueError:
        return b""
    return found if found.startswith(begins) and len(found) <= most else b""


def _is_small(png: bytes) -> bool:
    """Whether a PNG says that it is no larger than a map is."""
    sides = int.from_bytes(png[16:20], "big"), int.from_bytes(png[20:24], "big")
    return all(0 < side <= _WIDEST_MAP for side in sides)


def _judged(told: Mapping[str, Any]) -> dict[str, Any]:
    """Tell what a frame was judged as."""
    names = ("traversability", "uncertainty", "drivable_share", "similarity")
    return {
        "ok": told.get("ok") is True,
        "reasons": [clean(text_of(one)) for one in list_of(told.get("reasons"))[:_MOST]],
        **{name: number_of(told.get(name), -1, 1) for name in names},
        "tile": number_of(mapping_of(mapping_of(told.get("roi")).get("worst_tile")).get("uncertainty"), 0, 1),
    }
