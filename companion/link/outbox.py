"""Which connections a message leaves by. Nothing that was heard on one is passed on to another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from companion.link.channel import Channel
from companion.link.inbound import Sender
from companion.link.limits import LeaseTable
from companion.link.sender import LIFETIME
from companion.wire.ids import AUTOPILOT_COMPONENT_ID

MAX_ROUTES = 64
KEPT = 10.0
"""s without a word after which another sender may be remembered in one's place."""
AUTOPILOT_SILENCE = 3.0


class Outbox:
    """To everybody by all connections, to somebody by the one where he was heard last.

    To the autopilot by the first, in the order of the configuration, that heard it in the last 3 s; while
    none did, by the one before.
    """

    def __init__(self, channels: Sequence[Channel], share: Callable[[Sender], Sender]) -> None:
        """share: under whom a sender counts where replies go by turns."""
        self._channels = channels
        self._share = share
        self._routes: LeaseTable[Sender, Channel] = LeaseTable(MAX_ROUTES, KEPT)
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

    def hear(self, sender: Sender, channel: Channel, now: float) -> None:
        """`sender` was heard on `channel`. 64 senders are remembered, those first who were there first."""
        self._routes.renew(sender, channel, now)

    def hear_autopilot(self, channel: Channel, now: float) -> bool:
        """Our autopilot's heartbeat came by `channel`; True when what it says there counts."""
        self._autopilot_at[channel.name] = now
        near = [one for one in self._channels if self._hears_autopilot(one, now)]
        home = next((one for one in near if not one.clash), near[0])
        if home is not self._home:
            self._home = home
            self.moves += 1
        return self.is_home(channel)

    @property
    def home(self) -> str | None:
        """Name of the connection on which the autopilot is listened to; None before it was heard."""
        return None if self._home is None else self._home.name

    def is_home(self, channel: Channel) -> bool:
        """Whether the autopilot is listened to on `channel`: on one only, or all would count twice."""
        return self._home is channel

    def channel(self, to: Sender) -> Channel | None:
        """Where somebody is reached; None when he was not heard."""
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
        to: Sender | None = None,
    ) -> None:
        """Queue a message of the table's row `name`; one with the same name and key takes its place.

        Forgotten after `lifetime` s. When a queue is full the least urgent frame of whoever waits for most
        is lost, and counted.
        to: system and component id that it is meant for, None for everybody; one never heard: by all.
        """
        share = None if to is None else self._share(to)
        for channel in self._reach(to):
            channel.push(name, message, now, key=key, lifetime=lifetime, to=share)

    def urge(self, name: str, now: float) -> None:
        """What waits of this row leaves now, where the device takes it."""
        for channel in self._channels:
            channel.urge(name, now)

    def waiting(self, name: str, to: Sender | None = None) -> int:
        """How many frames of this row wait where fewest do; to: for him, or who shares with him."""
        share = None if to is None else self._share(to)
        return min(channel.sender.waiting(name, to=share) for channel in self._reach(to))

    def is_own(self, message: Any) -> bool:
        """Whether `message` is one that was sent from here a moment ago and came back, maybe elsewhere."""
        return any(channel.sender.is_own(message) for channel in self._channels)

    def forget(self, name: str) -> None:
        """What waits of this row is not wanted any more."""
        for channel in self._channels:
            channel.sender.forget(name)

    def _reach(self, to: Sender | None) -> Sequence[Channel]:
        channel = None if to is None else self.channel(to)
        return self._channels if channel is None else (channel,)

    def _hears_autopilot(self, channel: Channel, now: float) -> bool:
        heard_at = self._autopilot_at.get(channel.name)
        return heard_at is not None and now - heard_at <= AUTOPILOT_SILENCE
