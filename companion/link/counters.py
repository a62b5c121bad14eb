"""Sums up what all connections sent, dropped and rejected."""

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
    """Counts of all connections together since the start; `connections`: of each by name.

    sent: bytes by budget ("unsolicited", "asked", "autopilot"). dropped_summaries: not sent for lack of
    budget. lost: frames that waited too long or found the queue full. bad: broken frames received. unsaid:
    texts not sent because too many waited, or too many requests were refused. rejected: requests by reason.
    autopilot: name of the connection whose autopilot telemetry counts, None before it is received.
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
    """Sum up the counters as they stand now."""
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
