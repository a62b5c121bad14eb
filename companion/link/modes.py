"""The mode that the autopilot is asked for."""

from __future__ import annotations

from companion.autopilots import known_autopilot
from companion.link import encode
from companion.link.guard import Guard
from companion.link.heard import Vehicle
from companion.link.outbox import Outbox
from companion.wire.ids import AUTOPILOT_COMPONENT_ID

LIFETIME = 1.0
"""s that a mode waits to be sent: what holds then may not hold later."""


class Modes:
    """One at a time: the newest takes the place of one that waits."""

    def __init__(self, outbox: Outbox, guard: Guard) -> None:
        self._outbox = outbox
        self._guard = guard

    def ask(self, vehicle: Vehicle | None, custom_mode: int, now: float) -> None:
        """See `Link.set_mode`. An autopilot that is not heard, or not known, is asked for nothing."""
        autopilot = known_autopilot(vehicle.autopilot, vehicle.type) if vehicle is not None else None
        if vehicle is None or autopilot is None:
            self._guard.rejected["no autopilot for modes"] += 1
            return
        message = encode.set_mode(vehicle.system_id, autopilot.command(custom_mode))
        to = (vehicle.system_id, AUTOPILOT_COMPONENT_ID)
        self.forget()
        row = "resume" if custom_mode in autopilot.holdable else "hold"
        self._outbox.push(row, message, now, lifetime=LIFETIME, to=to)

    def urge_hold(self, now: float) -> None:
        """One that does not drive leaves now."""
        self._outbox.urge("hold", now)

    def forget(self) -> None:
        """What waits is not wanted any more."""
        self._outbox.forget("hold")
        self._outbox.forget("resume")
