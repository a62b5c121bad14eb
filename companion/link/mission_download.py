"""Downloads the autopilot's mission item by item, and reads the items ahead again while it has it."""

from __future__ import annotations

import math
from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.link import encode
from companion.link.outbox import Outbox
from companion.vehicle import known_autopilot
from companion.vehicle.mission import MOST_ITEMS, MissionItem, read_item
from companion.vehicle.state import Mission, Vehicle
from companion.wire.ids import AUTOPILOT_COMPONENT_ID, COMPONENT_ID

TIMEOUT = 1.0
"""s that an answer may take."""
TRIES = 5
PAUSE = 10.0
"""s until a download that was not answered begins anew."""
REFUSED_FOR = 60.0
"""s until a mission that was refused is read again: it may have been replaced by one as long."""
SETTLES = 1.0
"""s without a change after which a mission that is being changed is downloaded."""
GAP = 0.02
"""s from one request to the next: a mission may not fill the wire."""
_BEHIND, _AHEAD = 1, 3
"""Items before and after the current one that are read again."""
_MISSION: int = mavlink.MAV_MISSION_TYPE_MISSION
KINDS = frozenset({"MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ACK"})
"""Messages of the autopilot for `MissionDownload.receive`, by MAVLink name."""


class _Stage(Enum):
    WAITING = "waiting"  # until it is due
    COUNTING = "counting"
    READING = "reading"
    COMPLETE = "complete"


class MissionDownload:
    """Has the mission's items while `wanted`.

    It downloads them when the autopilot reports another mission. Autopilots that report no id of the mission
    may get another one with as many items unnoticed. So of a complete mission one of the items about the
    current one is read again each second; where it differs, all are.
    items: None where they are not known. why: then the reason, for a person.
    """

    def __init__(self, outbox: Outbox) -> None:
        self._outbox = outbox
        self.wanted = False
        self.items: tuple[MissionItem, ...] | None = None
        self.why = ""
        self._of: Mission | None = None
        """The report of the mission that is downloaded."""
        self._returns = 0
        self._stage = _Stage.WAITING
        self._due = -math.inf
        self._read: list[MissionItem] = []
        self._count = 0
        self._turn = 0
        """Which of the items ahead is read again next."""
        self._asked: int | None = None
        """The number of the item that is asked for."""
        self._asked_at = -math.inf
        self._tries = 0
        self._vehicle: Vehicle | None = None
        self._forget("not asked for")

    def tick(self, vehicle: Vehicle | None, returns: int, now: float) -> None:
        """Ask for what is due. returns: how often the autopilot came back after a silence."""
        self._vehicle = vehicle
        mission = None if vehicle is None else vehicle.mission
        if not self.wanted or mission is None:
            self._forget("the autopilot reports no mission" if self.wanted else "not asked for")
            return
        if self._of is None or mission.replaces(self._of) or returns != self._returns:
            later = SETTLES if self._of is not None else 0.0
            self._of, self._returns = mission, returns
            self._begin_again("it is being downloaded", now + later)
        if self._stage is _Stage.WAITING:
            if now >= self._due:
                self._stage = _Stage.COUNTING
                self._ask(None, now)
        elif self._asked_at > -math.inf:
            self._ask_again(now)
        elif now >= self._due:
            self._ask_next(now)

    def receive(self, message: Any, now: float) -> None:
        """Take one of `KINDS` of our autopilot. What is not for us, or was not asked for, is ignored."""
        to = (message.target_system, message.target_component)
        if to != (self._outbox.system_id, COMPONENT_ID) or message.mission_type != _MISSION:
            return
        kind = message.get_type()
        if self._asked_at == -math.inf:
            return
        if kind == "MISSION_ACK":
            if message.type != mavlink.MAV_MISSION_ACCEPTED:
                self._begin_again(f"the autopilot refuses it: MAV_MISSION_RESULT {message.type}", now + PAUSE)
        elif kind == "MISSION_COUNT" and self._stage is _Stage.COUNTING:
            self._take_count(int(message.count), now)
        # A late answer to an earlier request has another number.
        elif kind == "MISSION_ITEM_INT" and self._asked is not None and message.seq == self._asked:
            try:
                self._take_item(read_item(message), now)
            except ValueError as error:
                self._begin_again(str(error), now + REFUSED_FOR)

    def _take_count(self, count: int, now: float) -> None:
        if count > MOST_ITEMS:
            self._begin_again(f"it has {count} items, more than {MOST_ITEMS}", now + REFUSED_FOR)
        elif count == 0:
            self._begin_again("it has no items", now + PAUSE)
        else:
            self._stage, self._read, self._count = _Stage.READING, [], count
            self._answered(now + GAP)

    def _take_item(self, item: MissionItem, now: float) -> None:
        if self._stage is _Stage.COMPLETE:
            if self.items is not None and item != self.items[item.seq]:
                self._begin_again("it has changed", now + SETTLES)
            else:
                self._answered(now + TIMEOUT)
            return
        self._read.append(item)
        self._answered(now + GAP)
        if len(self._read) == self._count:
            self._stage, self.items, self.why = _Stage.COMPLETE, tuple(self._read), ""
            self._answered(now + TIMEOUT)
            self._push("mission taken", encode.mission_taken(self._system), now)

    def _ask_next(self, now: float) -> None:
        if self._stage is _Stage.READING:
            self._ask(len(self._read), now)
            return
        ahead = self._items_ahead()
        if ahead:
            self._turn += 1
            self._ask(ahead[self._turn % len(ahead)], now)

    def _items_ahead(self) -> range:
        """The items that are read again. Home is none of them: it may move, and the mission stays."""
        vehicle = self._vehicle
        if vehicle is None or vehicle.mission is None or self.items is None:
            return range(0)
        autopilot = known_autopilot(vehicle.autopilot, vehicle.type)
        first = 0 if autopilot is None else autopilot.first_item
        current = vehicle.mission.item
        return range(max(first, current - _BEHIND), min(len(self.items), current + _AHEAD + 1))

    def _ask_again(self, now: float) -> None:
        if now - self._asked_at < TIMEOUT:
            return
        if self._tries >= TRIES:
            self._begin_again("the autopilot does not answer", now + PAUSE)
        else:
            self._ask(self._asked, now, tries=self._tries + 1)

    def _ask(self, item: int | None, now: float, *, tries: int = 1) -> None:
        """Ask for an item, None for the number of items."""
        self._asked, self._asked_at, self._tries = item, now, tries
        if item is None:
            self._push("mission list", encode.mission_list(self._system), now)
        else:
            self._push("mission request", encode.mission_request(self._system, item), now)

    def _push(self, row: str, message: Any, now: float) -> None:
        to = (self._system, AUTOPILOT_COMPONENT_ID)
        self._outbox.push(row, message, now, key=0, lifetime=TIMEOUT, to=to)

    @property
    def _system(self) -> int:
        return 0 if self._vehicle is None else self._vehicle.system_id

    def _answered(self, due: float) -> None:
        self._asked, self._asked_at, self._due = None, -math.inf, due

    def _begin_again(self, why: str, due: float) -> None:
        self.items, self.why, self._stage, self._read = None, why, _Stage.WAITING, []
        self._answered(due)

    def _forget(self, why: str) -> None:
        self._of = None
        self._begin_again(why, -math.inf)
