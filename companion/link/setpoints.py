"""Zero velocity for an autopilot that stands only as long as it hears so."""

from __future__ import annotations

from companion.link import encode
from companion.link.heard import Vehicle
from companion.link.outbox import Outbox
from companion.wire.ids import AUTOPILOT_COMPONENT_ID
from companion.wire.messages import MESSAGES


class Setpoints:
    """While `on`, a setpoint is due at the table's rate. An end of them may set the vehicle moving."""

    def __init__(self, outbox: Outbox, now: float) -> None:
        self.on = False
        self._outbox = outbox
        self._started = now
        self._due = now

    def tick(self, vehicle: Vehicle | None, now: float) -> None:
        """Queue what is due; one that could not leave in time gives way to the next."""
        if not self.on or vehicle is None:
            self._outbox.forget("setpoint")
            return
        if now < self._due:
            return
        period = MESSAGES["setpoint"].period or 0.0
        self._due = max(self._due + period, now)
        message = encode.stand_still(vehicle.system_id, round((now - self._started) * 1000))
        to = (vehicle.system_id, AUTOPILOT_COMPONENT_ID)
        self._outbox.push("setpoint", message, now, key=0, lifetime=period, to=to)
