"""Events as JSON objects, one a line, for programs."""

from __future__ import annotations

import dataclasses
import json
from enum import Enum, IntEnum, IntFlag
from typing import Any

from gcs_plugin.events import Event


def plain(value: Any) -> Any:
    """Enums by their names in lower case, flags as lists of names, dataclasses as objects."""
    if isinstance(value, IntFlag):
        return [str(flag.name).lower() for flag in type(value) if flag and flag in value]
    if isinstance(value, IntEnum):
        return value.name.lower()
    if isinstance(value, Enum):
        return value.value
    if dataclasses.is_dataclass(value):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def record(event: Event, time: float) -> dict[str, Any]:
    """`event` as an object: its name, seconds since the start, the rover's system id, then its fields.

    A call's, a summary's or an acknowledgement's own fields stand beside them.
    """
    fields: dict[str, Any] = {"event": event.event, "time": round(time, 3), "system": event.system}
    for name, value in plain(event).items():
        fields.update(value if isinstance(value, dict) else {name: value})
    return fields


def to_line(fields: dict[str, Any]) -> str:
    """One line of JSON."""
    return json.dumps(fields, separators=(",", ":"))
