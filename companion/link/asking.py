"""Messages that the autopilot is asked to stream: on our own port only, so that no radio pays for them."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import development as mavlink

from companion.autopilots import known_autopilot
from companion.link import encode
from companion.link.heard import Vehicle
from companion.link.outbox import Outbox
from companion.link.receiver import Receiver
from companion.wire.ids import AUTOPILOT_COMPONENT_ID
from companion.wire.messages import MESSAGES

PULSES_SILENCE = 1.0
PULSES_PATIENCE = 2.0
"""The off switch is asked for again sooner than a position."""
HEALTH_SILENCE = 3.0
HEALTH_PATIENCE = 10.0
MODE_SILENCE = 2.0
MODE_PATIENCE = 5.0
_MISSED = 6
"""Periods of silence after which a stream is asked for again."""


class Asking:
    """Asks for what stays away, and at once for all when the autopilot is back: it may have rebooted."""

    def __init__(self, outbox: Outbox, receiver: Receiver) -> None:
        self.wants_pulses = False
        self._outbox = outbox
        self._receiver = receiver
        self._returns = 0
        self._asked_at: dict[int, float] = {}

    def tick(self, vehicle: Vehicle | None, returns: int, now: float) -> None:
        """Ask for what is due. returns: how often the autopilot was heard after a silence."""
        if vehicle is None:
            return
        if returns != self._returns:
            self._returns = returns
            self._asked_at.clear()
            self._receiver.forget()
        for row, message_id, heard_at in (
            ("position", mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, vehicle.position_at),
            ("attitude", mavlink.MAVLINK_MSG_ID_ATTITUDE, vehicle.attitude_at),
            ("time", mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, vehicle.clock_at),
        ):
            period = MESSAGES[row].period or 0.0
            if heard_at is None or now - heard_at > _MISSED * period:
                self._ask(vehicle, message_id, period, MESSAGES["interval"].period or 0.0, now)
        autopilot = known_autopilot(vehicle.autopilot, vehicle.type)
        told_at = -math.inf if vehicle.mode_at is None else vehicle.mode_at
        if autopilot is not None and autopilot.tells_late and now - told_at > MODE_SILENCE:
            period = MESSAGES["mode told"].period or 0.0
            self._ask(vehicle, mavlink.MAVLINK_MSG_ID_CURRENT_MODE, period, MODE_PATIENCE, now)
        if self.wants_pulses and now - self._receiver.pulses_at > PULSES_SILENCE:
            period = MESSAGES["rc"].period or 0.0
            self._ask(vehicle, mavlink.MAVLINK_MSG_ID_RC_CHANNELS, period, PULSES_PATIENCE, now)
        if self.wants_pulses and now - self._receiver.health_at > HEALTH_SILENCE:
            period = MESSAGES["rc health"].period or 0.0
            self._ask(vehicle, mavlink.MAVLINK_MSG_ID_SYS_STATUS, period, HEALTH_PATIENCE, now)

    def _ask(self, vehicle: Vehicle, message_id: int, period: float, patience: float, now: float) -> None:
        if now - self._asked_at.get(message_id, -math.inf) >= patience:
            self._asked_at[message_id] = now
            message = encode.ask_for(vehicle.system_id, message_id, period)
            to = (vehicle.system_id, AUTOPILOT_COMPONENT_ID)
            self._outbox.push("interval", message, now, key=message_id, to=to)
