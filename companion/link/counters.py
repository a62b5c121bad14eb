"""What left by all connections together, what was held back, and what was turned away."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from companion.link.access_control import AccessControl
from companion.link.alerts import TextSender
from companion.link.channel import Channel, ChannelCounters
from companion.link.outbox import Outbox
from companion.link.sender import BUDGETS


@dataclass(frozen=True)
class Counters:
    """Since the start, of all connections together; `connections`: of each by name.

    sent: bytes by budget ("unsolicited", "asked", "autopilot"). dropped_summaries: kept off the wire by the
    budget. lost: frames that waited too long or found the queue full. bad: broken frames heard. unsaid: texts
    kept back because too many waited, or too many wishes were refused. rejected: requests turned away, by
    reason. autopilot: name of the connection on which it is listened to, None before it was heard.
    """

    sent: Mapping[str, int]
    dropped_summaries: int
    lost: int
    bad: int
    unsaid: int
    rejected: Mapping[str, int]
    autopilot: str | None
    connections: Mapping[str, ChannelCounters]


def count(
    channels: Iterable[Channel], outbox: Outbox, text_sender: TextSender, access: AccessControl
) -> Counters:
    """As they stand now."""
    each = {channel.name: channel.counters for channel in channels}
    return Counters(
        sent={budget: sum(one.sent[budget] for one in each.values()) for budget in BUDGETS},
        dropped_summaries=sum(one.dropped_summaries for one in each.values()),
        lost=sum(one.lost for one in each.values()),
        bad=sum(one.bad for one in each.values()),
        unsaid=text_sender.unsaid,
        rejected=dict(access.rejected.items()),
        autopilot=outbox.home,
        connections=each,
    )
