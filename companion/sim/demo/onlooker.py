"""Says what a call of the demo is about, as somebody who stands beside the trail and looks at its picture."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from companion.sim.field.control import FieldError

FRAMES_A_SECOND = 12.0
"""Of the simulated camera, until two summaries have told how many it takes."""


class Looks(Protocol):
    """The control channel of the field, see `FieldControl`."""

    def look(self, box: Sequence[float], at: float | None) -> dict[str, Any]:
        """Say what a box of a picture shows. Raises FieldError."""


@dataclass(frozen=True)
class Shown:
    """What a box of a picture truly shows.

    kind: of the thing, or of the ground, "" for neither. thing: id of the thing, patch: of the ground; None
    where it shows the other. surprise: whether the thing stands on the path. zone: the kind of place ahead.
    outline: the thing's own box, in fractions of the picture, where little of it is in the box.
    """

    kind: str
    zone: str
    thing: str | None = None
    patch: str | None = None
    surprise: bool = False
    outline: Sequence[float] | None = None

    @property
    def id(self) -> str | None:
        """The thing or the patch of ground."""
        return self.thing or self.patch


class Onlooker:
    """Finds when a call's frame was taken, and looks at its box in the field's picture of then."""

    def __init__(self, field: Looks) -> None:
        self._field = field
        self._frame = 0
        """Id of the frame of the newest summary."""
        self._taken = 0.0
        """When it was taken: monotonic seconds."""
        self._rate = FRAMES_A_SECOND

    def summary(self, event: dict[str, Any], at: float) -> None:
        """Take in an event of a summary: it says how old its frame is. at: monotonic seconds."""
        frame, taken = event["frame_id"], at - event["frame_age_ms"] / 1000
        if self._frame and frame > self._frame and taken > self._taken:
            self._rate = (frame - self._frame) / (taken - self._taken)
        self._frame, self._taken = frame, taken

    def about(self, call: dict[str, Any]) -> Shown | None:
        """Return what a call or hold asks about: what its box shows, else its region of interest.

        call: its event. Where the picture of its frame is kept no more, it is the newest one. None while no
        summary has come.
        """
        if not self._frame:
            return None
        box = call.get("worst_tile_box") or call["roi"]
        taken = self._taken + (call["frame_id"] - self._frame) / self._rate
        return self._look(box, taken) or self._look(box, None)

    def ahead(self, region: Sequence[float]) -> Shown | None:
        """Return what the newest picture shows in a region; None where there is none."""
        return self._look(region, None)

    def _look(self, box: Sequence[float], at: float | None) -> Shown | None:
        with contextlib.suppress(FieldError):
            return Shown(**self._field.look(box, at))
        return None
