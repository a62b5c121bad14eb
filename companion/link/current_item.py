"""Makes an item of the mission the current one, and makes sure that it is."""

from __future__ import annotations

import math
from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.link import encode
from companion.link.outbox import Outbox
from companion.vehicle.state import Vehicle
from companion.wire.ids import AUTOPILOT_COMPONENT_ID

TRIES = 3
TIMEOUT = 0.5
"""s from one try to the next."""
_GOES_ON = frozenset(
    {mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_IN_PROGRESS, mavlink.MAV_RESULT_TEMPORARILY_REJECTED}
)


class ItemSetting(Enum):
    """What became of the newest `CurrentItem.set`."""

    NONE = "none"
    WAITS = "waits"
    SET = "set"
    REFUSED = "refused"
    UNANSWERED = "unanswered"


class CurrentItem:
    """Sends DO_SET_MISSION_CURRENT until MISSION_CURRENT shows the item: three times, every 0.5 s.

    state: of the newest one. item: its number.
    """

    def __init__(self, outbox: Outbox) -> None:
        self._outbox = outbox
        self.item = 0
        self.state = ItemSetting.NONE
        self._since = self._asked_at = -math.inf
        self._tries = 0

    def set(self, item: int, now: float) -> None:
        """Begin to make `item` the current one; it replaces one that waits. The next `tick` sends it."""
        self.item, self.state = item, ItemSetting.WAITS
        self._since, self._asked_at, self._tries = now, -math.inf, 0

    @property
    def waits(self) -> bool:
        """Whether the newest item is not set yet, and not refused."""
        return self.state is ItemSetting.WAITS

    def cancel(self) -> None:
        """Send no more; one that was sent may still take effect."""
        self.state = ItemSetting.NONE
        self._outbox.forget("set item")

    def tick(self, vehicle: Vehicle | None, now: float) -> None:
        """Look whether the item is the current one, and send the command anew where it is due."""
        if self.state is not ItemSetting.WAITS:
            return
        mission = None if vehicle is None else vehicle.mission
        if mission is not None and mission.at >= self._since and mission.item == self.item:
            self.state = ItemSetting.SET
        elif now - self._asked_at < TIMEOUT:
            pass
        elif self._tries >= TRIES or vehicle is None:
            self.state = ItemSetting.UNANSWERED
        else:
            self._asked_at, self._tries = now, self._tries + 1
            message, to = (
                encode.set_item(vehicle.system_id, self.item),
                (vehicle.system_id, AUTOPILOT_COMPONENT_ID),
            )
            self._outbox.push("set item", message, now, key=0, lifetime=TIMEOUT, to=to)

    def answered(self, message: Any) -> None:
        """Take a COMMAND_ACK of our autopilot to us. That it was accepted is not believed until it shows."""
        ours = message.command == mavlink.MAV_CMD_DO_SET_MISSION_CURRENT and self._tries > 0
        if ours and self.state is ItemSetting.WAITS and message.result not in _GOES_ON:
            self.state = ItemSetting.REFUSED
