"""Runs one connection: its device, parser, queue, budgets, sequence numbers and rates."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from companion.config.link_settings import MAIN, ConnectionSettings, LinkSettings
from companion.link.connection import Connection
from companion.link.parser import Parser
from companion.link.periodic import PeriodicTelemetry
from companion.link.sender import Sender
from companion.link.signing import Signing
from companion.link.transport import Transport, opener
from companion.wire.ids import AUTOPILOT_COMPONENT_ID, CAMERA_COMPONENT_ID, COMPONENT_ID

READS_PER_POLL = 512
"""More datagrams than a UDP socket buffers by default: after a stall, one poll reaches the newest mode."""
BYTES_PER_POLL = 256 * 1024
"""Bytes of one poll: a sender that is faster than we read must not stop the main loop."""
READS_AT_MOST = 4096
ID_CONFLICT_FOR = 10.0
"""s of silence after another component sent under our ids."""
STOPPING = frozenset({"hold", "setpoint", "sticks"})
"""Rows that are sent even while another component uses our ids: that must not prevent a hold."""
_IDLE = 0.1


@dataclass(frozen=True)
class ChannelCounters:
    """Counts what one connection sent and lost since the start.

    trouble: why nothing can be sent there now, None when all is well. mavlink: the version in use, 1 or 2.
    sent: bytes by budget ("unsolicited", "asked", "autopilot"). dropped_summaries: not sent for lack of
    budget. lost: frames that waited too long or found the queue full. left_out: messages that MAVLink 1
    cannot carry. bad: broken frames received.
    """

    trouble: str | None
    mavlink: int
    sent: Mapping[str, int]
    dropped_summaries: int
    lost: int
    left_out: int
    bad: int


class Channel:
    """One connection, which is opened again whenever it is lost.

    For 10 s after another component sent under our ids, only rows of `STOPPING` are sent: two components with
    the same ids would confuse the ground.
    """

    def __init__(
        self, name: str, settings: ConnectionSettings, connection: Connection, sender: Sender, now: float
    ) -> None:
        self.name = name
        self.asked_budget = settings.asked_budget
        self._connection = connection
        self._parser = Parser()
        self.sender = sender
        self.periodic = PeriodicTelemetry(self.sender, now)
        self._waits_for_vehicle = settings.waits_for_vehicle
        self._opened = 0
        self._id_conflict_at: float | None = None
        self._may_send = False

    @property
    def label(self) -> str:
        """The connection's name for a person."""
        return "link" if self.name == MAIN else f"link {self.name}"

    @property
    def id_conflict(self) -> bool:
        """Whether another component uses our ids here."""
        return self._id_conflict_at is not None

    @property
    def trouble(self) -> str | None:
        """Why nothing can be sent here now; None when all is well."""
        if self.id_conflict:
            own = f"{self.sender.system_id}/{COMPONENT_ID}"
            return f"another component {own} talks on {self.label}: stop it, or this one stays silent"
        if self._connection.trouble is not None:
            return f"{self.label} lost: {self._connection.trouble}"
        return None

    @property
    def counters(self) -> ChannelCounters:
        """The counters as they stand now."""
        return ChannelCounters(
            trouble=self.trouble,
            mavlink=1 if self.sender.version.is_1 else 2,
            sent=dict(self.sender.sent),
            dropped_summaries=self.periodic.dropped,
            lost=self.sender.lost,
            left_out=self.sender.left_out,
            bad=self._parser.bad,
        )

    def fileno(self) -> int | None:
        """The file descriptor to select on; None while the device is absent."""
        return self._connection.fileno()

    def wait(self, now: float) -> float:
        """Seconds after which `tick` may have something to send, at most 0.1."""
        return min(_IDLE, self.sender.wait(now)) if self._may_send else _IDLE

    def close(self) -> None:
        """Close the device."""
        self._connection.close()

    def poll(self, now: float) -> Iterator[list[Any]]:
        """Yield the messages of each read, until none wait. Call `note_accepted` before the next read."""
        room = BYTES_PER_POLL
        for _ in range(READS_PER_POLL):
            data = b""
            if not self._parser.behind:
                data = self._connection.read(now) if room > 0 else b""
                room -= len(data)
                self._notice_opening()
                if not data:
                    return
            yield self._parser.feed(data, now, whole=self._connection.datagrams)

    def note_accepted(self, sender: tuple[int, int], now: float) -> None:
        """Report that a message of `sender` in the last read was accepted."""
        self._connection.note_accepted(
            now, autopilot=sender == (self.sender.system_id, AUTOPILOT_COMPONENT_ID)
        )

    def discard_received(self, now: float) -> None:
        """Discard what waits to be read."""
        self._parser.forget()
        for _ in range(READS_AT_MOST):
            if not self._connection.read(now):
                break

    def _notice_opening(self) -> None:
        if self._opened != self._connection.opened:
            self._opened = self._connection.opened
            self._parser.forget()
            self.sender.version.forget()
            self.periodic.send_heartbeat_now()

    def note_id_conflict(self, now: float) -> bool:
        """Note that another component sent under our ids here; True when that is new."""
        new, self._id_conflict_at = self._id_conflict_at is None, now
        self.sender.drop_all_but(STOPPING)
        return new

    def takes(self, name: str) -> bool:
        """Whether messages of row `name` are sent: in an id conflict only those that stop the vehicle."""
        return not self.id_conflict or name in STOPPING

    def send_now(self, name: str, now: float) -> None:
        """Send the queued messages of row `name` at once, not with the next `tick`."""
        if self._may_send:
            self.sender.send_now(name, now)

    def may_send(self, now: float, *, has_vehicle: bool) -> bool:
        """Whether more than `STOPPING` may be sent.

        On udpin and serial connections, nothing is sent before the autopilot is received.
        """
        if self._id_conflict_at is not None and now - self._id_conflict_at > ID_CONFLICT_FOR:
            self._id_conflict_at = None
        self._may_send = has_vehicle or not self._waits_for_vehicle
        return self._may_send and not self.id_conflict

    def tick(self, now: float, *, calling: bool) -> None:
        """Send what is due, within pace and budgets. Call `may_send` first.

        calling: whether a call or hold is open.
        """
        if not self._may_send:
            return
        if not self.id_conflict:
            self.periodic.tick(now, calling=calling, resuming=self.sender.waiting("resume") > 0)
        self.sender.tick(now)


def channels_of(
    settings: LinkSettings,
    now: float,
    *,
    openers: Mapping[str, Callable[[], Transport]],
    signing: Signing | None,
    camera_id: int = CAMERA_COMPONENT_ID,
) -> list[Channel]:
    """Make a channel for each connection, in order. Raises LinkSettingError.

    Openers and signing: as for `Link`.
    """
    system_id, found = settings.system_id, []
    for number, (name, one) in enumerate(settings.connections().items()):
        connection = Connection(openers.get(name) or opener(one.address()), now)
        sender = Sender(
            connection, one, now, system_id=system_id, signing=signing, link_id=number, camera_id=camera_id
        )
        found.append(Channel(name, one, connection, sender, now))
    return found
