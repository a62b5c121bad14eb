"""Counts what came of drives. Pure: no camera, no rules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from bench.field_drive.trails import FieldRoute, Placed

PASSED = 1.0
"""m behind a thing's middle from which it is passed."""
IN_FRONT, BEHIND = 7.0, 0.5
"""m along the trail to a thing that a stop or a call is about, at most; and behind it."""


@dataclass
class DriveResult:
    """What came of one drive under one policy. Lengths in m.

    route, driven: metres of the route, and how far along it the rover came. contacts, late_contacts: ids of
    what it touched, those of what was late apart. rooms, passed: things with room that were not late,
    and those of them that it passed without a touch and without asking about them. asked: calls, and holds
    that nobody was called for. stood: it ended standing. needless: stops with nothing in the way. edge: least
    distance from its side to the path's edge, below 0 off the path. takeovers: AUTO to GUIDED by itself.
    overrides: modes of a human that it replaced. late: things that were. taken: things that somebody took
    away. by_hand: times that somebody set AUTO over a hold with nothing in the way. seconds: of the drive.
    """

    policy: str
    seed: int
    route: float
    driven: float = 0.0
    contacts: list[str] = field(default_factory=list)
    late_contacts: list[str] = field(default_factory=list)
    rooms: int = 0
    passed: int = 0
    asked: int = 0
    stood: bool = False
    needless: int = 0
    edge: float = 0.0
    takeovers: int = 0
    overrides: int = 0
    late: int = 0
    taken: int = 0
    by_hand: int = 0
    seconds: float = 0.0

    def __str__(self) -> str:
        end = "stood" if self.stood else "came through"
        touched = f", touched {', '.join(self.contacts)}" if self.contacts else ""
        return (
            f"seed {self.seed:2} {self.policy:6} {end} at {self.driven:.0f} of {self.route:.0f} m in "
            f"{self.seconds:.0f} s: passed {self.passed} of {self.rooms}, asked {self.asked}, "
            f"needless {self.needless}{touched}"
        )


class Score:
    """Follows one drive. Progress is in metres along the route."""

    def __init__(self, policy: str, route: FieldRoute) -> None:
        rooms = [one for one in route.placed if one.room and not one.drivable and not one.late]
        self.result = DriveResult(policy, route.seed, route.metres, rooms=len(rooms), edge=float("inf"))
        self.result.late = sum(one.late for one in route.placed)
        self._route, self._rooms = route, rooms
        self._free = {thing.id for one in route.placed if one.drivable for thing in one.things}
        self._late = {thing.id for one in route.placed if one.late for thing in one.things}
        self._about: set[int] = set()
        self._there: set[int] = set()
        self._ids: set[int] = set()
        self._renamed: set[int] = set()

    def in_way(self, progress: float, within: float = IN_FRONT) -> Placed | None:
        """Return what is next on the route, at most so far ahead, and still there; None for nothing."""
        for one in self._route.placed:
            away = one.s - self._route.begin - progress
            if (
                -BEHIND <= away <= within
                and not one.drivable
                and one.things[0].id in self._route.world.things
            ):
                return one
        return None

    def touched(self, names: Sequence[str]) -> None:
        """Take in the ids of what the rover touches now."""
        for name in names:
            contacts = self.result.late_contacts if name in self._late else self.result.contacts
            if name not in contacts and name not in self._free:
                contacts.append(name)

    def touches(self, one: Placed) -> bool:
        """Whether the rover has touched it."""
        met = {*self.result.contacts, *self.result.late_contacts}
        return any(thing.id in met for thing in one.things)

    def moved(self, progress: float, edge: float) -> None:
        """Take in how far the rover is, and how far its side is from the path's edge."""
        self.result.driven = min(max(self.result.driven, progress), self.result.route)
        self.result.edge = min(self.result.edge, edge)

    def id_is(self, number: int, progress: float) -> None:
        """Take in the id of the open call or hold, 0 for none."""
        if number and number not in self._ids:
            self._ids.add(number)
            if (one := self.in_way(progress)) is not None:
                self._about.add(id(one))

    def renamed(self, old: int) -> None:
        """Take in that this id is not used any more, since its hold has a call now."""
        self._renamed.add(old)

    def held(self, progress: float) -> None:
        """Take in that a stop begins."""
        self.result.needless += self.in_way(progress) is None

    def ended(self, *, stood: bool, seconds: float) -> DriveResult:
        """Return what came of it."""
        found, world = self.result, self._route.world
        passed = [
            one
            for one in self._rooms
            if found.driven > one.s - self._route.begin + PASSED
            and id(one) not in self._about
            and not self.touches(one)
            and one.things[0].id in world.things
        ]
        found.passed, found.asked = len(passed), len(self._ids - self._renamed)
        found.stood, found.seconds = stood, round(seconds, 1)
        return found


def figures(found: Sequence[DriveResult]) -> dict[str, Any] | None:
    """Sum up the drives of one policy; None without any."""
    if not found:
        return None
    metres, driven = sum(one.route for one in found), sum(one.driven for one in found)
    rooms = sum(one.rooms for one in found)
    return {
        "runs": len(found),
        "contacts": sum(len(one.contacts) for one in found),
        "route_share": round(driven / metres, 3),
        "passed_share": round(sum(one.passed for one in found) / rooms, 3) if rooms else None,
        "asked": sum(one.asked for one in found),
        "stood": sum(one.stood for one in found),
        "needless_stops_per_100m": round(100 * sum(one.needless for one in found) / driven, 2)
        if driven
        else None,
        "edge_min_m": round(min(one.edge for one in found), 2),
        "takeovers": sum(one.takeovers for one in found),
        "human_overrides": sum(one.overrides for one in found),
        "late": sum(one.late for one in found),
        "late_contacts": sum(len(one.late_contacts) for one in found),
        "with_room": rooms,
        "taken_away": sum(one.taken for one in found),
        "set_auto_by_hand": sum(one.by_hand for one in found),
        "driven_m": round(driven),
        "seconds": round(sum(one.seconds for one in found)),
    }
