"""Simulates the autopilot's mission: one item every 10 m of the trail, and what MAVLink tells of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import development as mavlink

if TYPE_CHECKING:
    from companion.sim.field.rover import Rover


SPACING = 10.0
"""m of the trail from one item to the next."""


class SimulatedMission:
    """A mission along the trail. It goes round, or ends after `length` m.

    One that goes round has a last item that jumps back to the first one, as MAV_CMD_DO_JUMP does.
    started: the autopilot drove it. complete: its last item was reached. counts_from: the first item's
    number.
    """

    def __init__(self, rover: Rover, counts_from: int) -> None:
        self._rover = rover
        self._counts_from = counts_from
        self.length: float | None = None
        self.started = self.complete = False
        self._reached = 0

    @property
    def state(self) -> int:
        """MISSION_STATE while the mission is not driven. Never PAUSED, which not every autopilot reports."""
        if self.complete:
            return int(mavlink.MISSION_STATE_COMPLETE)
        return int(mavlink.MISSION_STATE_NOT_STARTED)

    def begin_anew(self) -> None:
        """Begins with the first item: the rover drives to the trail's start, then along it."""
        self._rover.restart_mission()
        self.forget()

    def forget(self) -> None:
        """Forgets how far it came, as a reboot does."""
        self.started = self.complete = False
        self._reached = self._passed()

    def advance(self) -> list[Any]:
        """Follows the rover, which drives it. Returns a MISSION_ITEM_REACHED for each item just reached."""
        self.started = True
        told = []
        while self._reached < self._passed():
            self._reached += 1
            told.append(mavlink.MAVLink_mission_item_reached_message(self._number(self._reached)))
        ended = self.length is not None and self._rover.progress >= self.length
        self.complete = self.complete or ended
        return told

    def current(self, state: int, *, in_mode: bool) -> Any:
        """Makes MISSION_CURRENT. state: MISSION_STATE. in_mode: the autopilot is in the mission's mode."""
        mode = 1 if in_mode else 2
        jump = self.length is None
        return mavlink.MAVLink_mission_current_message(
            self._number(self._passed() + 1), self._items + jump, state, mode
        )

    @property
    def _items(self) -> int:
        return max(1, math.ceil((self.length or self._rover.lap) / SPACING))

    def _passed(self) -> int:
        """Counts the items passed, over all rounds; the last one of a mission that ends lies at its end."""
        passed = max(0, int(self._rover.progress // SPACING))
        if self.length is None:
            return passed
        return self._items if self._rover.progress >= self.length else min(passed, self._items - 1)

    def _number(self, item: int) -> int:
        """Returns the number on the wire of an item, which counts from 1 over all rounds."""
        within = (item - 1) % self._items if self.length is None else min(item, self._items) - 1
        return within + self._counts_from
