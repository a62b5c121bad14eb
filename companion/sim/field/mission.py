"""Simulates the autopilot's mission: one item every 10 m of the trail, and what MAVLink tells of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

if TYPE_CHECKING:
    from companion.sim.field.rover import Rover


SPACING = 10.0
"""m of the trail from one item to the next."""


class MissionPlace(NamedTuple):
    """An item as the mission has it.

    command: MAV_CMD. x, y: on the field, in m. jump: number of the item that a jump goes to.
    """

    command: int
    x: float
    y: float
    jump: int = 0


class SimulatedMission:
    """A mission along the trail. It goes round, or ends after `length` m.

    One that goes round has a last item that jumps back to the first one, as MAV_CMD_DO_JUMP does.
    started: the autopilot drove it. complete: its last item was reached. counts_from: the first item's
    number.
    """

    def __init__(self, rover: Rover, counts_from: int) -> None:
        self._rover = rover
        self.counts_from = counts_from
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

    @property
    def count(self) -> int:
        """How many items there are on the wire, with home and the jump where it has them."""
        return self.counts_from + self._items + (self.length is None)

    def item(self, number: int) -> MissionPlace | None:
        """Returns the item of this number on the wire; None for one that is not there."""
        if not 0 <= number < self.count:
            return None
        if number == self.counts_from + self._items:
            return MissionPlace(int(mavlink.MAV_CMD_DO_JUMP), 0.0, 0.0, jump=self.counts_from)
        passed = number - self.counts_from + 1
        end = self._rover.lap if self.length is None else self.length
        x, y = self._rover.place(min(passed * SPACING, end))
        return MissionPlace(int(mavlink.MAV_CMD_NAV_WAYPOINT), x, y)

    def set_current(self, number: int) -> bool:
        """Makes an item the current one. False: there is none of this number, or it is home or the jump.

        What lies before it in its round counts as passed. What the rover has driven past is passed again as
        soon as it drives the mission.
        """
        if not self.counts_from <= number < self.counts_from + self._items:
            return False
        rounds = self._reached // self._items if self.length is None else 0
        self._reached = rounds * self._items + number - self.counts_from
        return True

    def current(self, state: int, *, in_mode: bool) -> Any:
        """Makes MISSION_CURRENT. state: MISSION_STATE. in_mode: the autopilot is in the mission's mode."""
        mode = 1 if in_mode else 2
        jump = self.length is None
        return mavlink.MAVLink_mission_current_message(
            self._number(self._reached + 1), self._items + jump, state, mode
        )

    @property
    def _items(self) -> int:
        return max(1, math.ceil((self.length or self._rover.lap) / SPACING))

    def _passed(self) -> int:
        """Counts the items passed, over all rounds; the last one of a mission or a round lies at its end."""
        progress, end = max(0.0, self._rover.progress), self.length
        if end is None:
            rounds, progress = divmod(progress, self._rover.lap)
            return int(rounds) * self._items + min(int(progress // SPACING), self._items - 1)
        return self._items if progress >= end else min(int(progress // SPACING), self._items - 1)

    def _number(self, item: int) -> int:
        """Returns the number on the wire of an item, which counts from 1 over all rounds."""
        within = (item - 1) % self._items if self.length is None else min(item, self._items) - 1
        return within + self.counts_from
