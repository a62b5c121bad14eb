"""Chooses the connections that a message is sent on. Nothing is forwarded from one to another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from companion.link.channel import Channel
from companion.link.limits import LeaseTable
from companion.link.sender import LIFETIME
from companion.wire.ids import AUTOPILOT_COMPONENT_ID, SenderId

MAX_ROUTES = 64
KEPT = 10.0
"""s of silence after which another sender may take a remembered sender's place."""
AUTOPILOT_SILENCE = 3.0
"""s without a heartbeat after which the autopilot counts as not received on a connection."""


class Outbox:
    """Sends broadcasts on all connections, and a reply on the one where its receiver was last received.

    Messages to the autopilot go to its home: the first connection, in the order of the configuration, that
    received it in the last 3 s. While none did, the home stays. `moves` counts how often it changed.
    """

    def __init__(self, channels: Sequence[Channel], share: Callable[[SenderId], SenderId]) -> None:
        """share: maps a sender to the key under which its replies take turns, see `AccessControl.share`."""
        self._channels = channels
        self._share = share
        self._routes: LeaseTable[SenderId, Channel] = LeaseTable(MAX_ROUTES, KEPT)
        self._autopilot_at: dict[str, float] = {}
        self._home: Channel | None = None
        self.moves = 0

    @property
    def system_id(self) -> int:
        """The system id in every frame sent."""
        return self._channels[0].sender.system_id

    @system_id.setter
    def system_id(self, value: int) -> None:
        for channel in self._channels:
            channel.sender.system_id = value

    def note_route(self, sender: SenderId, channel: Channel, now: float) -> None:
        """Remember that `sender` was received on `channel`. At most 64; the first keep their places."""
        self._routes.renew(sender, channel, now)

    def note_autopilot(self, channel: Channel, now: float) -> bool:
        """Note our autopilot's heartbeat on `channel`; True when its telemetry there counts."""
        self._autopilot_at[channel.name] = now
        in_reach = [one for one in self._channels if self._receives_autopilot(one, now)]
        # Where another component uses our ids only holds may be sent, so any other connection is better.
        home = next((one for one in in_reach if not one.id_conflict), in_reach[0])
        if home is not self._home:
            self._home = home
            self.moves += 1
        return self.is_home(channel)

    @property
    def home(self) -> str | None:
        """Name of the connection whose autopilot telemetry counts; None before it is received."""
        return None if self._home is None else self._home.name

    def is_home(self, channel: Channel) -> bool:
        """Whether the autopilot's telemetry counts on `channel`: on one only, or it would count twice."""
        return self._home is channel

    def channel(self, to: SenderId) -> Channel | None:
        """The connection on which `to` is reached; None when it was not received yet."""
        if self._home is not None and to == (self.system_id, AUTOPILOT_COMPONENT_ID):
            return self._home
        return self._routes.get(to)

    def push(
        self,
        name: str,
        message: Any,
        now: float,
        *,
        key: object = None,
        lifetime: float = LIFETIME,
        to: SenderId | None = None,
    ) -> None:
        """Queue a message of the table's row `name`; it replaces one with the same name and key.

        It is dropped after `lifetime` s. When a queue is full, the least urgent frame of the receiver with
        the most waiting frames is dropped, and counted as lost. to: system and component id of the receiver,
        None for all; a receiver that we never received from is sent to on all connections.
        """
        share = None if to is None else self._share(to)
        for channel in self._channels_to(to):
            if channel.takes(name):
                channel.sender.push(name, message, now, key=key, lifetime=lifetime, to=share)

    def takes(self, name: str, to: SenderId) -> bool:
        """Whether a message of row `name` to `to` is queued: not while another component uses our ids."""
        return any(channel.takes(name) for channel in self._channels_to(to))

    def send_now(self, name: str, now: float) -> None:
        """Send the queued messages of row `name` now, if the device takes them."""
        for channel in self._channels:
            channel.send_now(name, now)

    def waiting(self, name: str, to: SenderId | None = None) -> int:
        """Frames of row `name` that wait, on the connection with the fewest. to: only those of its share."""
        share = None if to is None else self._share(to)
        return min(channel.sender.waiting(name, to=share) for channel in self._channels_to(to))

    def waits(self, name: str) -> bool:
        """Whether a frame of row `name` waits on any connection."""
        return any(channel.sender.waiting(name) for channel in self._channels)

    def sent_at(self, name: str, message: Any) -> float | None:
        """When `message`, the newest of row `name`, first left by any connection; None before."""
        times = (channel.sender.sent_at(name, message) for channel in self._channels)
        return min((at for at in times if at is not None), default=None)

    def is_own(self, message: Any) -> bool:
        """Whether `message` is one of our own newest frames, which came back on any connection."""
        return any(channel.sender.is_own(message) for channel in self._channels)

    def forget(self, name: str) -> None:
        """Drop the queued messages of row `name`."""
        for channel in self._channels:
            channel.sender.forget(name)

    def _channels_to(self, to: SenderId | None) -> Sequence[Channel]:
        channel = None if to is None else self.channel(to)
        return self._channels if channel is None else (channel,)

    def _receives_autopilot(self, channel: Channel, now: float) -> bool:
        received_at = self._autopilot_at.get(channel.name)
        return received_at is not None and now - received_at <= AUTOPILOT_SILENCE
