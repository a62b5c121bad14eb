"""Signs the frames that the companion sends, and accepts only frames that are signed with its key."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from companion.config.link_settings import LinkSettingError
from companion.system.computer import is_synchronised
from companion.vehicle.state import SOFTWARE_MADE
from companion.wire import signing as wire
from companion.wire.ids import AUTOPILOT_COMPONENT_ID
from companion.wire.signing import DAY, TICKS, SignedStream, SigningKey, ticks
from companion.wire.signing_store import NAME, SigningKeyError, TimestampFile, read_key

log = logging.getLogger(__name__)


class SigningClock:
    """Finds the time for signing. A board without a clock battery may start anywhere in the past.

    The wall clock counts where the network set it, or while it is later than this software, and at most a
    day before the newest timestamp of the last run (`newest`). Otherwise only verified frames give the time.
    wall: returns s since 1970. synchronised: returns whether the network set that.
    """

    def __init__(
        self,
        newest: int,
        wall: Callable[[], float] = time.time,
        synchronised: Callable[[], bool] = is_synchronised,
    ) -> None:
        self._earliest = max(ticks(SOFTWARE_MADE), newest - DAY)
        self._wall = wall
        self.is_synchronised = synchronised
        self._offset: int | None = None

    def now(self, now: float) -> int | None:
        """The time as a signing timestamp; None while it is not known. now: s, monotonic."""
        own = ticks(self._wall())
        if own >= self._earliest or self.is_synchronised():
            return own
        return None if self._offset is None else self._offset + int(now * TICKS)

    def update(self, timestamp: int, now: float) -> None:
        """Take the time of a verified frame, which may be a little late; the latest one counts."""
        if timestamp >= self._earliest:
            offset = timestamp - int(now * TICKS)
            self._offset = offset if self._offset is None else max(self._offset, offset)


RECENT = 10.0
LOG_EVERY = 60.0
PRIVATE_TELEMETRY = frozenset(
    {
        "HEARTBEAT",
        "GLOBAL_POSITION_INT",
        "ATTITUDE",
        "VFR_HUD",
        "SYSTEM_TIME",
        "SYS_STATUS",
        "RC_CHANNELS",
        "CURRENT_MODE",
        "MISSION_CURRENT",
        "MISSION_ITEM_REACHED",
        "MISSION_COUNT",
        "MISSION_ITEM_INT",
        "MISSION_ACK",
        "COMMAND_ACK",
        "STATUSTEXT",
    }
)
"""Messages that are accepted unsigned from an autopilot without a key, on a wire of its own."""
RADIO_FRAMES = frozenset({"RADIO", "RADIO_STATUS"})
"""Messages of the radio itself, which has no key. They are ignored, as anybody could send them."""
_V2 = 0xFD
_NO_TIME = "no clock: silent until a signed frame of the autopilot or the ground tells the time"
_HINTS = {
    wire.UNSIGNED: "is not signed: load our key into it, or set unsigned_autopilot on a private wire",
    wire.SIGNATURE: "is signed with another key: load our key into it",
    wire.REPLAY: "is signed with an old time: it needs GPS, or a ground station that signs",
    wire.AHEAD: "is signed far ahead of our clock: set the clock, or load the key into it again",
}


class Signing:
    """Signs and checks frames with one key for all connections; each signs with its own link id."""

    def __init__(
        self, key: SigningKey, store: TimestampFile, clock: SigningClock, *, unsigned_autopilot: bool = False
    ) -> None:
        self._key = key
        self._store = store
        self._timestamps = store.timestamps
        self._clock = clock
        self._unsigned_autopilot = unsigned_autopilot
        self._now = 0.0
        self._own: set[SignedStream] = set()
        self._refused: tuple[str, float] | None = None
        self._autopilot_at = float("-inf")
        """When a frame of the autopilot was verified last, monotonic seconds."""
        self._logged: dict[str, float] = {}
        self._count: Counter[str] = Counter()

    def ready(self, now: float) -> bool:
        """Whether the time is known; nothing can be signed before."""
        return self._clock.now(now) is not None

    @property
    def behind(self) -> bool:
        """Whether an autopilot with our key and an old time is received: one frame of ours corrects it."""
        return self._refused_lately() == wire.REPLAY

    @property
    def trouble(self) -> str | None:
        """Why frames cannot be sent or accepted, and what to do; None when all is well."""
        if not self.ready(self._now):
            return _NO_TIME
        reason = self._refused_lately()
        # While the autopilot is verified, what is refused in its name is somebody else's: anybody could make
        # this text come and go, and fill the log with it.
        if reason and self._now - self._autopilot_at > RECENT:
            return f"what the autopilot says {_HINTS[reason]}"
        if self._store.trouble:
            return f"{NAME} is not written ({self._store.trouble}): check the disk before a restart"
        return None

    @property
    def stores(self) -> bool:
        """Whether timestamps can be stored, as far as is known."""
        return not self._store.trouble

    @staticmethod
    def is_radio_report(message: Any) -> bool:
        """Whether `message` is a radio's own report, which is ignored without being counted as refused."""
        return message.get_type() in RADIO_FRAMES and not wire.is_signed(bytes(message.get_msgbuf()))

    def refusal(self, message: Any, now: float, *, first: bool = True) -> wire.FrameRefusal | Literal["echo"]:
        """Why a decoded message is refused: unsigned, signature, replay, ahead or echo; "" when accepted.

        first: whether it came by the first connection, the only one where an autopilot may be without a key.
        """
        frame = bytes(message.get_msgbuf())
        if first and not wire.is_signed(frame) and self._may_be_unsigned(frame, message):
            return ""
        clock, synchronised = self._clock.now(now), self._clock.is_synchronised()
        reason = wire.refusal(frame, self._key, self._timestamps, clock, synchronised=synchronised)
        if reason == wire.REPLAY and wire.stream_of(frame) in self._own:
            return "echo"
        if reason:
            self._refuse(reason, message, now)
            return reason
        self._take_time(frame, message, now)
        return ""

    def sign(self, frame: bytes, message: Any, now: float, link: int = 0) -> bytes:
        """Return `frame`, the packed `message`, with a signature. link: the connection's link id.

        Call it only when `ready`. Raises ValueError for a MAVLink 1 frame.
        """
        stream = SignedStream(frame[5], frame[6], link)
        timestamp = self._timestamps.next(stream, self._clock.now(now) or 0)
        self._own.add(stream)
        return self._key.sign(frame, message.crc_extra, link, timestamp)

    def tick(self, now: float) -> None:
        """Have new timestamps stored."""
        self._now = now
        self._store.tick(now)

    def close(self) -> None:
        """Write all timestamps to disk."""
        self._store.close()

    def _may_be_unsigned(self, frame: bytes, message: Any) -> bool:
        if frame[0] != _V2 or not self._unsigned_autopilot:
            return False
        return (
            message.get_srcComponent() == AUTOPILOT_COMPONENT_ID and message.get_type() in PRIVATE_TELEMETRY
        )

    def _take_time(self, frame: bytes, message: Any, now: float) -> None:
        self._clock.update(wire.timestamp_of(frame), now)
        if message.get_srcComponent() != AUTOPILOT_COMPONENT_ID:
            return
        self._refused, self._autopilot_at = None, now
        if message.get_type() == "SYSTEM_TIME":
            self._clock.update(wire.ticks(message.time_unix_usec / 1e6), now)

    def _refuse(self, reason: str, message: Any, now: float) -> None:
        sender = message.get_srcSystem(), message.get_srcComponent()
        self._count[reason] += 1
        if sender[1] == AUTOPILOT_COMPONENT_ID:
            if reason == wire.UNSIGNED and self._unsigned_autopilot and message.get_msgbuf()[0] == _V2:
                return  # counted as refused, but not reported: this autopilot is configured not to sign
            self._refused = reason, now
        if now - self._logged.get(reason, -LOG_EVERY) >= LOG_EVERY:
            self._logged[reason] = now
            log.warning(
                "refused %s of %d/%d: %s", message.get_type(), *sender, f"{reason}, {self._count[reason]}"
            )

    def _refused_lately(self) -> str:
        if self._refused is None or self._now - self._refused[1] > RECENT:
            return ""
        return self._refused[0]


def open_signing(
    key: Path, folder: Path, *, unsigned_autopilot: bool = False, wall: Callable[[], float] = time.time
) -> Signing:
    """Make a Signing from the key file `key`, with timestamps stored in `folder`. Raises LinkSettingError."""
    try:
        secret = read_key(key)
        store = TimestampFile(folder, clock=wire.ticks(wall()))
    except SigningKeyError as error:
        raise LinkSettingError(str(error)) from None
    except OSError as error:
        raise LinkSettingError(f"{folder / NAME}: {(error.strerror or str(error)).lower()}") from error
    if store.notice:
        log.warning("%s", store.notice)
    clock = SigningClock(store.timestamps.last, wall)
    return Signing(secret, store, clock, unsigned_autopilot=unsigned_autopilot)
