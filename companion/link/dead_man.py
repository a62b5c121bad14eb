"""Streams centred sticks to a PX4, so that it stops the vehicle by its own fail-safe when the stream ends.

MANUAL_CONTROL must come from nobody else then: PX4 would go on by the other's sticks when ours end. And with
the parameters that this needs, PX4 ignores a transmitter, on which somebody may rely.
"""

from __future__ import annotations

import logging
from enum import Enum
from typing import Any

from companion.link import encode
from companion.link.alerts import TextSender
from companion.link.inbound import RcChannels
from companion.link.outbox import Outbox
from companion.vehicle import known_autopilot
from companion.vehicle.state import Vehicle
from companion.wire import notices
from companion.wire.ids import AUTOPILOT_COMPONENT_ID, ERROR, WARNING, SenderId
from companion.wire.messages import MESSAGES

log = logging.getLogger(__name__)

ROW = "sticks"
STICKS = frozenset({"MANUAL_CONTROL", "RC_CHANNELS_OVERRIDE"})
"""Messages by which somebody else steers."""
LISTENS_FIRST = 3.0
"""s from the autopilot's first heartbeat for which others are listened for, before the stream may begin.

A lost request for RC_CHANNELS is repeated within that time.
"""
TRANSMITTER = "transmitter"


class DeadManState(str, Enum):
    """What the dead man does."""

    OFF = "off"
    """It is not configured, or the autopilot is none whose fail-safe it can use."""
    READY = "ready"
    """It streams once the vehicle drives by itself under policy hold."""
    ON = "on"
    """It streams: the vehicle's own fail-safe acts when that ends."""
    REFUSED = "refused"
    """Somebody else's sticks were heard. It does not stream any more until the companion is started again."""


class DeadMan:
    """Sends MANUAL_CONTROL at the table's rate while `on`, until somebody else's sticks are heard.

    enabled: whether it is configured. on: whether the vehicle's state wants the stream.
    """

    def __init__(self, outbox: Outbox, text_sender: TextSender) -> None:
        self.enabled = self.on = False
        self._outbox = outbox
        self._text_sender = text_sender
        self._refused_for = ""
        self._fits = self._streams = False
        self._heard_since: float | None = None
        self._due = 0.0

    @property
    def state(self) -> DeadManState:
        """What it does now."""
        if not (self.enabled and self._fits):
            return DeadManState.OFF
        if self._refused_for:
            return DeadManState.REFUSED
        return DeadManState.ON if self._streams else DeadManState.READY

    @property
    def reminder(self) -> str:
        """The text to repeat while it is refused, else ""."""
        return notices.dead_man_refused(self._refused_for) if self.state is DeadManState.REFUSED else ""

    @property
    def wants_rc_channels(self) -> bool:
        """Whether it must hear of a transmitter."""
        return self.enabled and self._fits

    def sticks_received(self, sender: SenderId, message: Any, now: float) -> None:
        """Take a message of `STICKS` from anybody else. It counts where it steers our vehicle."""
        system_id = self._outbox.system_id
        target = message.target if message.get_type() == "MANUAL_CONTROL" else message.target_system
        # The autopilot tells the sticks that it follows, which are ours.
        if target in (0, system_id) and sender != (system_id, AUTOPILOT_COMPONENT_ID):
            self._refuse(f"{sender[0]}/{sender[1]}", now)

    def rc_received(self, channels: RcChannels, now: float) -> None:
        """Take RC_CHANNELS. It counts where the signal is live.

        That the receiver is healthy (SYS_STATUS) does not count: PX4 says so of our sticks, too.
        """
        if channels.count > 0:
            self._refuse(TRANSMITTER, now)

    def tick(self, vehicle: Vehicle | None, now: float) -> None:
        """Queue a message when one is due; it replaces one that is still waiting."""
        if not self.enabled or vehicle is None:
            return
        autopilot = known_autopilot(vehicle.autopilot, vehicle.type)
        self._fits = autopilot is not None and autopilot.stops_without_sticks
        if self._heard_since is None:
            self._heard_since = now
        listened = now - self._heard_since >= LISTENS_FIRST
        streamed, self._streams = self._streams, self._wanted and listened
        if streamed is not self._streams:
            log.info("the dead man's stream %s", "begins" if self._streams else "ends")
            ends_driving = (
                autopilot is not None and vehicle.custom_mode in autopilot.holdable and vehicle.armed
            )
            if streamed and ends_driving and not self._refused_for:
                self._text_sender.send(notices.dead_man_ends(), WARNING, now)
        if not self._streams:
            self._outbox.forget(ROW)
        elif now >= self._due:
            period = MESSAGES[ROW].period or 0.0
            self._due = max(self._due + period, now)
            to = (vehicle.system_id, AUTOPILOT_COMPONENT_ID)
            message = encode.centred_sticks(vehicle.system_id)
            self._outbox.push(ROW, message, now, key=0, lifetime=2 * period, to=to)

    @property
    def _wanted(self) -> bool:
        return self.on and self._fits and not self._refused_for

    def _refuse(self, whom: str, now: float) -> None:
        if not self.wants_rc_channels or self._refused_for:
            return
        self._refused_for = whom
        log.error(
            "the dead man is off until the companion is started again, since sticks are heard: %s. "
            'End them, or set [call] px4_deadman = "off"',
            whom,
        )
        self._text_sender.send(notices.dead_man_refused(whom), ERROR, now)
