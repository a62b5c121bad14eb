"""Describes what the autopilot reports of its mission: which item is current, and whether it is complete."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class MissionState(IntEnum):
    """MAVLink's MISSION_STATE."""

    UNKNOWN = 0
    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


@dataclass(frozen=True)
class Mission:
    """The newest report of the mission. Items are numbered as the autopilot numbers them.

    item: the current one. total: how many there are, None where that is not reported. id: of the mission's
    content, 0 where that is not reported. at: when it was reported, seconds of the link's monotonic clock.
    fresh: it was reported in the last 5 s, and since the autopilot entered its mode.
    reached: the item that was reached last in this mode, None for none. reached_at: when.
    """

    item: int
    total: int | None
    state: MissionState
    id: int
    at: float
    fresh: bool = True
    reached: int | None = None
    reached_at: float = 0.0

    def at_last(self, first: int) -> bool:
        """Whether the last item was reached, or the current one is past the end. first: the first's number.

        Where it is not reported how many there are: the item that was reached has stayed the current one.
        """
        if self.total is None:
            return self.reached == self.item and self.at > self.reached_at
        last = self.total - 1 + first
        return self.item > last or (self.reached is not None and self.reached >= last)

    def replaces(self, other: Mission) -> bool:
        """Whether this is another mission than `other`, as far as the autopilot reports that."""
        return (self.total, self.id) != (other.total, other.id)
