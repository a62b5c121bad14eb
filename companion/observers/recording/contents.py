"""Converts what is recorded to JSON values, and to Foxglove's messages. Pure."""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum, Flag
from typing import Any

import numpy as np

from anytraverse.assessment import Assessment, Reason
from anytraverse.grid import CELL
from anytraverse.grid_map import UNKNOWN, GridMap
from anytraverse.memory import Memory
from anytraverse.regions import Region
from companion.calls.decisions import (
    CallClosed,
    CallOpened,
    Decision,
    FaultAcceptanceEnds,
    FaultAccepted,
    GoLapsed,
    HoldMoved,
    HoldRenamed,
    HoldShown,
    HoldStarted,
    ResumeCancelled,
    SetMode,
    WouldHold,
    WouldResume,
)
from companion.observers.recording.foxglove import encode
from companion.wire.json_values import place_document

_DIGITS = 6
_LARGEST_READ = 1 << 20
"""Bytes of JSON that are read: a hundred times those of ours."""
EVENTS = (CallOpened, CallClosed, HoldStarted, HoldMoved, WouldHold, WouldResume)
"""Decisions whose surroundings are kept longest."""


def plain(value: Any) -> Any:
    """Convert a value to JSON: a data class to an object, flags and enums to names, NaN to null."""
    match value:
        case None | bool() | str():
            return value
        case Flag():
            return [one.name.lower() for one in type(value) if one and one in value and one.name]
        case Enum():
            return value.name.lower()
        case int():
            return value
        case float():
            return round(value, _DIGITS) if math.isfinite(value) else None
        case Mapping():
            return {str(key): plain(one) for key, one in value.items()}
        case tuple() | list() | set() | frozenset():
            found = [plain(one) for one in value]
            return sorted(found) if isinstance(value, (set, frozenset)) else found
        case bytes():
            return value.hex()
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    return str(value)


def as_json(content: Mapping[str, Any]) -> bytes:
    """Encode JSON values."""
    return json.dumps(content, separators=(",", ":"), allow_nan=False).encode()


def read_json(data: bytes) -> Mapping[str, Any]:
    """Read what `as_json` encoded; {} for anything else: a recording may come from anywhere."""
    if len(data) > _LARGEST_READ:
        return {}
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def assessment(
    seen: Assessment, judged_at: float, duration: float, sectors: tuple[float | None, ...]
) -> bytes:
    """Describe a judged frame. Times are monotonic seconds, as in every message."""
    roi, match, adopted = seen.roi, seen.match, seen.adopted
    figures: dict[str, Any] = {"roi": None}
    if roi is not None:
        names = ("traversability", "uncertainty", "strangeness", "known_share", "drivable_share")
        figures = {**{name: getattr(roi, name) for name in names}, "roi": roi}
    content = {
        "frame": seen.frame.id,
        "captured_at": seen.frame.captured_at,
        "judged_at": judged_at,
        "duration": duration,
        "age": seen.age,
        "lean": seen.frame.lean,
        "pose": seen.frame.pose,
        "reach": seen.frame.reach,
        "ok": seen.ok,
        "reasons": seen.reasons,
        **figures,
        "similarity": seen.similarity,
        "scene_age": seen.scene_age,
        "undecided": seen.undecided,
        "match": match and {"scene": match.entry.order, "similarity": match.similarity},
        "adopted": adopted and {"scene": adopted.order, "call": adopted.call_id},
        "dropped": seen.dropped,
        "findings": seen.findings,
        "sectors": sectors,
    }
    return as_json(plain(content))


def words(memory: Memory) -> bytes:
    """Describe the words in use, and of how many taps each is made."""
    taps = {word: len(memory.examples[word]) for word in memory.examples}
    return as_json({"words": plain(dict(memory.preferences.items())), "taps": taps})


def decision(one: Decision) -> bytes:
    """Describe a decision of the state machine."""
    return as_json({"decision": _NAMES[type(one)], **plain(_figures(one))})


_NAMES = {
    CallOpened: "call opened",
    CallClosed: "call closed",
    HoldStarted: "hold started",
    HoldMoved: "hold moved",
    HoldShown: "hold shown",
    HoldRenamed: "hold renamed",
    GoLapsed: "go lapsed",
    ResumeCancelled: "resume cancelled",
    FaultAccepted: "fault accepted",
    FaultAcceptanceEnds: "fault acceptance ends",
    SetMode: "set mode",
    WouldHold: "would hold",
    WouldResume: "would resume",
}


def _figures(one: Decision) -> dict[str, Any]:
    match one:
        case CallOpened(call) | CallClosed(call):
            place = place_document(call.place)
            told = {"id": call.id, "frame": call.frame_id, "reasons": call.reasons, "place": place}
            return {**told, "outcome": call.outcome, "state": call.state}
        case HoldStarted(hold, reasons):
            return {"id": hold.id, "reasons": reasons}
        case HoldMoved(hold, event, resuming):
            return {"id": hold.id, "event": event, "resuming": resuming}
        case HoldShown(hold, seen):
            return {"id": hold.id, "frame": seen.frame.id}
        case HoldRenamed(old, hold):
            return {"id": hold.id, "before": old}
        case GoLapsed(number) | ResumeCancelled(number):
            return {"id": number}
        case FaultAccepted(number, accepted):
            return {"id": number, "faults": accepted.faults if accepted is not None else ()}
        case FaultAcceptanceEnds(seconds, metres):
            return {"seconds": seconds, "metres": metres}
        case SetMode(mode, expected, hold):
            return {"mode": mode, "expected": expected, "id": hold}
        case WouldHold(reasons, number):
            return {"number": number, "reasons": reasons}
        case WouldResume(reasons, number, lasted, by_hand):
            return {"number": number, "reasons": reasons, "lasted": lasted, "by_hand": by_hand}


def image(data: bytes, kind: str, at: int) -> bytes:
    """Make a foxglove.CompressedImage. kind: "jpeg" or "png". at: ns since 1970, here and below."""
    content = {"timestamp": at, "data": data, "format": kind, "frame_id": "camera"}
    return encode("foxglove.CompressedImage", content)


def grid(told: GridMap, at: int) -> bytes:
    """Make a foxglove.Grid of the rows and columns with known cells. Its x and y are those of odometry."""
    share, uncertainty = told.layers
    known = share != UNKNOWN
    rows, columns = (np.flatnonzero(known.any(axis=axis)) for axis in (1, 0))
    if not rows.size:
        rows = columns = np.zeros(1, np.intp)
    (top, bottom), (left, right) = ((int(one[0]), int(one[-1]) + 1) for one in (rows, columns))
    cells = np.stack([share, uncertainty], axis=-1)[top:bottom, left:right]
    column, row = told.corner
    place = {"x": (column + left) * CELL, "y": (row + top) * CELL, "z": 0.0}
    fields = [
        {"name": name, "offset": offset, "type": 1} for offset, name in enumerate(("drivable", "uncertainty"))
    ]
    content = {
        "timestamp": at,
        "frame_id": "odometry",
        "pose": {"position": place, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}},
        "column_count": right - left,
        "cell_size": {"x": CELL, "y": CELL},
        "row_stride": 2 * (right - left),
        "cell_stride": 2,
        "fields": fields,
        "data": cells.tobytes(),
    }
    return encode("foxglove.Grid", content)


_WHITE = {"r": 1.0, "g": 1.0, "b": 1.0, "a": 1.0}
_YELLOW = {"r": 0.94, "g": 0.89, "b": 0.26, "a": 1.0}
_INK = {"r": 0.05, "g": 0.07, "b": 0.09, "a": 0.8}


def image_annotations(seen: Assessment, region: Region, title: str, at: int) -> bytes:
    """Make foxglove.ImageAnnotations: a title, the ROI in white, and in yellow the tile of a bad frame."""
    height, width = seen.frame.image.shape[:2]
    outlines = [(region.corners, _WHITE, 1.5)]
    if seen.tile is not None and seen.reasons & {Reason.UNKNOWN_OBJECT, Reason.BLOCKED}:
        outlines.append((seen.tile.shown.corners, _YELLOW, 3.0))
    points = [
        {
            "timestamp": at,
            "type": 2,  # LINE_LOOP
            "points": [{"x": x * width, "y": y * height} for x, y in corners],
            "outline_color": colour,
            "thickness": thickness,
        }
        for corners, colour, thickness in outlines
    ]
    text = {
        "timestamp": at,
        "position": {"x": 6.0, "y": 0.05 * height},
        "text": title,
        "font_size": 0.04 * height,
        "text_color": _WHITE,
        "background_color": _INK,
    }
    return encode("foxglove.ImageAnnotations", {"points": points, "texts": [text], "timestamp": at})


def location(latitude: float, longitude: float, at: int) -> bytes:
    """Make a foxglove.LocationFix. Degrees."""
    content = {"latitude": latitude, "longitude": longitude, "timestamp": at, "frame_id": "vehicle"}
    return encode("foxglove.LocationFix", content)


_LEVELS = ((logging.CRITICAL, 5), (logging.ERROR, 4), (logging.WARNING, 3), (logging.INFO, 2))


def log_line(level: int, name: str, text: str, at: int) -> bytes:
    """Make a foxglove.Log. level: as in `logging`."""
    number = next((number for least, number in _LEVELS if level >= least), 1)
    content = {"timestamp": at, "level": number, "message": text, "name": name}
    return encode("foxglove.Log", content)
