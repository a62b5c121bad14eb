"""Sends the autopilot zero-velocity setpoints and message interval requests."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import development as mavlink

from companion.link import encode
from companion.link.outbox import Outbox
from companion.link.vehicle import RemoteControl
from companion.vehicle import known_autopilot
from companion.vehicle.state import Vehicle
from companion.wire.ids import AUTOPILOT_COMPONENT_ID
from companion.wire.messages import MESSAGES


class Setpoints:
    """Sends zero-velocity setpoints at the table's rate while `on`. When they stop, the vehicle may move.

    target: m/s and degrees/s counter-clockwise, which are sent to GUIDED; None: nothing is.
    """

    def __init__(self, outbox: Outbox, now: float) -> None:
        self.on = False
        self.target: tuple[float, float] | None = None
        self._outbox = outbox
        self._started = now
        self._due = now

    def tick(self, vehicle: Vehicle | None, now: float) -> None:
        """Queue a setpoint or target when one is due; it replaces one that is still waiting."""
        if not self.on:
            self._outbox.forget("setpoint")
        if self.target is None:
            self._outbox.forget("target")
        row = "setpoint" if self.on else "target"
        if vehicle is None or not (self.on or self.target) or now < self._due:
            return
        period = MESSAGES[row].period or 0.0
        self._due = max(self._due + period, now)
        system, uptime = vehicle.system_id, round((now - self._started) * 1000)
        if self.on or self.target is None:
            message = encode.stand_still(system, uptime)
        else:
            message = encode.drive(system, uptime, self.target[0], -math.radians(self.target[1]))
        self._outbox.push(row, message, now, key=0, lifetime=period, to=(system, AUTOPILOT_COMPONENT_ID))


# SILENCE: s without a message after which it is requested. PATIENCE: s from one request to the next.
PULSES_SILENCE = 1.0
PULSES_PATIENCE = 2.0
"""RC channels carry the off switch, so they are requested again sooner than a position."""
HEALTH_SILENCE = 3.0
HEALTH_PATIENCE = 10.0
MODE_SILENCE = 2.0
MODE_PATIENCE = 5.0
_MISSED = 6
"""Periods of silence after which a message is requested again."""
_QUICK, _QUICK_MISSED, _QUICK_PATIENCE = 0.1, 0.3, 2.0
"""s: the period of attitude and position by which the vehicle is driven; the silence and patience for it."""


class MessageIntervals:
    """Requests missing messages, and all of them when the autopilot returns: it may have rebooted."""

    def __init__(self, outbox: Outbox, remote_control: RemoteControl) -> None:
        self.wants_rc_channels = False
        self.quick = False
        """Whether attitude and position must come more often."""
        self._outbox = outbox
        self._remote_control = remote_control
        self._returns = 0
        self._asked_at: dict[int, float] = {}
        self._quick_asked = False
        """Whether `quick` was asked for, since the autopilot returned."""

    def tick(self, vehicle: Vehicle | None, returns: int, now: float) -> None:
        """Request what is missing. returns: how often the autopilot came back after a silence."""
        if vehicle is None:
            return
        if returns != self._returns:
            self._returns = returns
            self._asked_at.clear()
            self._quick_asked = False
            self._remote_control.forget()
        for row, message_id, heard_at in (
            ("position", mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, vehicle.position_at),
            ("attitude", mavlink.MAVLINK_MSG_ID_ATTITUDE, vehicle.attitude_at),
        ):
            silent = now - (-math.inf if heard_at is None else heard_at)
            if self.quick and (not self._quick_asked or silent > _QUICK_MISSED):
                patience = _QUICK_PATIENCE if self._quick_asked else 0.0
                self._ask(vehicle, message_id, _QUICK, patience, now)
            elif not self.quick and self._quick_asked:
                self._ask(vehicle, message_id, MESSAGES[row].period or 0.0, 0.0, now)
            else:
                self._ask_if_silent(vehicle, row, message_id, heard_at, now)
        self._quick_asked = self.quick
        for row, message_id, heard_at in (("time", mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, vehicle.clock_at),):
            self._ask_if_silent(vehicle, row, message_id, heard_at, now)
        autopilot = known_autopilot(vehicle.autopilot, vehicle.type)
        reported_at = -math.inf if vehicle.mode_at is None else vehicle.mode_at
        if autopilot is not None and autopilot.reports_mode_late and now - reported_at > MODE_SILENCE:
            period = MESSAGES["current mode"].period or 0.0
            self._ask(vehicle, mavlink.MAVLINK_MSG_ID_CURRENT_MODE, period, MODE_PATIENCE, now)
        if self.wants_rc_channels and now - self._remote_control.pulses_at > PULSES_SILENCE:
            period = MESSAGES["rc"].period or 0.0
            self._ask(vehicle, mavlink.MAVLINK_MSG_ID_RC_CHANNELS, period, PULSES_PATIENCE, now)
        if self.wants_rc_channels and now - self._remote_control.health_at > HEALTH_SILENCE:
            period = MESSAGES["rc health"].period or 0.0
            self._ask(vehicle, mavlink.MAVLINK_MSG_ID_SYS_STATUS, period, HEALTH_PATIENCE, now)
        told_at = None if vehicle.mission is None else vehicle.mission.at
        for row, message_id, heard_at in (
            ("mission", mavlink.MAVLINK_MSG_ID_MISSION_CURRENT, told_at),
            ("throttle", mavlink.MAVLINK_MSG_ID_VFR_HUD, vehicle.throttle_at),
        ):
            self._ask_if_silent(vehicle, row, message_id, heard_at, now)

    def _ask_if_silent(
        self, vehicle: Vehicle, row: str, message_id: int, heard_at: float | None, now: float
    ) -> None:
        period = MESSAGES[row].period or 0.0
        if heard_at is None or now - heard_at > _MISSED * period:
            self._ask(vehicle, message_id, period, MESSAGES["interval"].period or 0.0, now)

    def _ask(self, vehicle: Vehicle, message_id: int, period: float, patience: float, now: float) -> None:
        if now - self._asked_at.get(message_id, -math.inf) >= patience:
            self._asked_at[message_id] = now
            message = encode.ask_for(vehicle.system_id, message_id, period)
            to = (vehicle.system_id, AUTOPILOT_COMPONENT_ID)
            self._outbox.push("interval", message, now, key=message_id, to=to)
