"""Queues frames for one connection, and sends them in order of priority, within byte budgets."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Container
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import ConnectionSettings
from companion.link.access_control import COMMON_SHARES
from companion.link.connection import Connection
from companion.link.encode import MavlinkVersion, fits_1, pack_1
from companion.link.limits import TokenBucket
from companion.link.signing import Signing
from companion.link.streams import completes
from companion.wire.ids import CAMERA_COMPONENT_ID, COMPONENT_ID
from companion.wire.messages import MESSAGES, Bucket, Message
from companion.wire.signing import BLOCK

MAX_WAITING = 64
"""Frames of one budget that wait: a flood of requests pushes out only other replies."""
BUDGETS = ("unsolicited", "asked", "autopilot")
LIFETIME = 5.0
"""s that a frame waits at most by default."""
_RECENT_FRAMES = 256
"""Sent frames that are remembered, to recognize our own when they come back: one per sequence number."""
_RETRY_AFTER = 0.02
"""s until a device that took nothing is tried again. Without it, a loop that sleeps for `wait` would spin."""
_REVOCABLE = "resume"
"""The row whose frames may not leave late: they are written only when nothing waits, and taken back.

No heartbeat may wait, either: it tells the autopilot the state on which the resume was decided."""


@dataclass(order=True)
class _Frame:
    priority: int
    turn: int
    order: int
    name: str = field(compare=False)
    key: object = field(compare=False)
    to: tuple[int, int] | None = field(compare=False)
    bucket: Bucket | None = field(compare=False)
    message: Any = field(compare=False)
    size: int = field(compare=False)
    until: float = field(compare=False)


class Sender:
    """Sends one frame per `pace` s, the most urgent first. A frame waits until its budget affords it.

    - Within a budget no frame overtakes a more urgent one, so small frames cannot starve a call.
    - No two replies are sent in a row while another frame may go, so requests cannot block our own messages.
    - Replies of one priority go round the requesters in turn, so one requester cannot delay the others.
    - Senders that share a rate limit get no two replies in a row while another requester waits.
    - Only holds, setpoints and heartbeats (priority 0) are written while more than 0.1 s of a line waits in
      the device, and while a resume waits, which is written only when nothing else waits there.

    sent: bytes by budget. lost: frames dropped. left_out: messages that MAVLink 1 cannot carry.
    """

    def __init__(
        self,
        connection: Connection,
        settings: ConnectionSettings,
        now: float,
        *,
        system_id: int = 1,
        signing: Signing | None = None,
        link_id: int = 0,
        camera_id: int = CAMERA_COMPONENT_ID,
    ) -> None:
        """signing: signs each frame, with `link_id`. camera_id: component id of the rows of the camera."""
        self._connection = connection
        self._pace = settings.pace
        # Receivers count a component's lost frames by its sequence numbers, so each has its own.
        self._companion = mavlink.MAVLink(None, system_id, COMPONENT_ID)
        self._camera = mavlink.MAVLink(None, system_id, camera_id)
        self.version = MavlinkVersion()
        self._buckets: dict[Bucket, TokenBucket] = {
            "unsolicited": TokenBucket(settings.budget, settings.burst, now),
            "asked": TokenBucket(settings.asked_budget, settings.burst, now),
        }
        self._signing = signing
        self._link_id = link_id
        self._block = 0 if signing is None else BLOCK
        self._queue: list[_Frame] = []
        self._order = 0
        self._turns: dict[int, int] = {}
        self._next_at = now
        self._last_was_reply = self._last_was_shared = False
        self._recent: deque[tuple[int, int]] = deque(maxlen=_RECENT_FRAMES)
        self._newest_sent: dict[str, tuple[Any, float]] = {}
        """Of each row the newest message that was written to the device, and when."""
        self.sent = dict.fromkeys(BUDGETS, 0)
        self.lost = 0
        self.left_out = 0

    @property
    def system_id(self) -> int:
        """The system id in every frame sent."""
        return int(self._companion.srcSystem)

    @system_id.setter
    def system_id(self, value: int) -> None:
        self._companion.srcSystem = self._camera.srcSystem = value

    def push(
        self,
        name: str,
        message: Any,
        now: float,
        *,
        key: object = None,
        lifetime: float = LIFETIME,
        to: tuple[int, int] | None = None,
    ) -> None:
        """Queue a message of the table's row `name`; it replaces one with the same name and key.

        It is dropped after `lifetime` s. When 64 frames of a budget wait, the least urgent one of the
        receiver with the most is dropped, and counted as lost. to: whose turn the frame takes, None for all.
        While MAVLink 1 is in use, messages whose id it cannot carry are counted in `left_out` and dropped.
        """
        row = MESSAGES[name]
        assert row.priority is not None, f"the companion does not send {name}"
        packed = self._pack(name, message, now)
        if packed is None:
            self.left_out += 1
            return
        size = len(packed) + self._block
        turn = self._turn(row, to)
        frame = _Frame(
            row.priority, turn, self._order, name, key, to, row.bucket, message, size, now + lifetime
        )
        self._order += 1
        if key is not None:
            for place, waiting in enumerate(self._queue):
                if (waiting.name, waiting.key) == (name, key):
                    # It keeps its place, or a value that changes often would never reach the front.
                    frame.turn, frame.order = waiting.turn, waiting.order
                    self._queue[place] = frame
                    return
        self._queue.append(frame)
        self._queue.sort()
        of_budget = [waiting for waiting in self._queue if waiting.bucket == row.bucket]
        if len(of_budget) > MAX_WAITING:
            counts = Counter(waiting.to for waiting in of_budget)
            self._queue.remove(max(of_budget, key=lambda waiting: (counts[waiting.to], waiting)))
            self.lost += 1

    def set_budget(self, rate: float, now: float) -> None:
        """Set the B/s of unsolicited traffic from now on, 0 unlimited."""
        self._buckets["unsolicited"].set_rate(rate, now)

    def waiting(self, name: str, to: tuple[int, int] | None = None) -> int:
        """How many frames of row `name` wait; with `to`, only those for that receiver."""
        return sum(frame.name == name and to in (None, frame.to) for frame in self._queue)

    def sent_at(self, name: str, message: Any) -> float | None:
        """When `message`, the newest of row `name`, was written to the device; None before."""
        newest, at = self._newest_sent.get(name, (None, 0.0))
        return at if newest is message else None

    def has_room(self, name: str, now: float, *, reserve: int = 0) -> bool:
        """Whether the row's budget affords one more frame, besides the waiting ones and `reserve` bytes."""
        row = MESSAGES[name]
        if row.bucket is None:
            return True
        ahead = sum(frame.size for frame in self._queue if frame.bucket == row.bucket)
        return self._buckets[row.bucket].affords(ahead + row.bytes + self._block + reserve, now)

    def tick(self, now: float) -> None:
        """Drop frames that waited too long, and send what is due."""
        fresh = [frame for frame in self._queue if frame.until >= now]
        self.lost += len(self._queue) - len(fresh)
        self._queue = fresh
        while now >= self._next_at and (frame := self._first(now)) is not None:
            self._send(frame, now)

    def send_now(self, name: str, now: float) -> None:
        """Send the waiting frames of row `name` now, regardless of pace. Only for rows without a budget."""
        for frame in [one for one in self._queue if one.name == name and one.until >= now]:
            self._send(frame, now)

    def wait(self, now: float) -> float:
        """Seconds until the next frame may be sent, 1 when none waits."""
        if not self._queue:
            return 1.0
        return max(self._next_at - now, 0.0 if self._first(now) is not None else 0.05)

    def is_own(self, message: Any) -> bool:
        """Whether `message` is one of the newest frames sent here, which came back."""
        return (message.get_seq(), message.get_crc()) in self._recent

    def forget(self, name: str) -> None:
        """Drop the waiting frames of row `name`; a resume also where it was written and has not left."""
        self._queue = [frame for frame in self._queue if frame.name != name]
        if name == _REVOCABLE:
            self._connection.recall()

    def drop_all_but(self, names: Container[str]) -> None:
        """Drop the waiting frames of all rows but `names`, a resume as `forget` does."""
        self._queue = [frame for frame in self._queue if frame.name in names]
        if _REVOCABLE not in names:
            self._connection.recall()

    def _turn(self, row: Message, to: tuple[int, int] | None) -> int:
        """The turn of a new reply: one after the last waiting one for `to` of the same priority.

        Without one, it is one after the newest that was sent, so that a new requester joins the current turn.
        """
        if row.bucket != "asked":
            return 0
        equals = [one for one in self._queue if (one.bucket, one.priority) == (row.bucket, row.priority)]
        own = (one.turn for one in equals if one.to == to)
        return 1 + max(own, default=self._turns.get(row.priority or 0, 0))

    def _send(self, frame: _Frame, now: float) -> None:
        """Send `frame`. It goes on waiting when the device is full, or signing does not know the time."""
        packed = self._pack(frame.name, frame.message, now)
        if packed is not None and frame.name == _REVOCABLE and completes(packed):
            self._skip_number(frame.name)  # the next one makes another checksum
            packed = self._pack(frame.name, frame.message, now)
        if packed is None:
            self._queue.remove(frame)
            self.left_out += 1
            return
        if len(packed) + self._block > frame.size:  # the MAVLink version changed: check the budget again
            frame.size = len(packed) + self._block
            return
        if not self._write(packed, frame, now):
            self._next_at = now + max(self._pace, _RETRY_AFTER)
            return
        self._queue.remove(frame)
        self._newest_sent[frame.name] = frame.message, now
        self._last_was_reply = frame.bucket == "asked"
        if self._last_was_reply:
            self._turns[frame.priority] = frame.turn
            self._last_was_shared = frame.to in COMMON_SHARES
        mav = self._mav(frame.name)
        self._recent.append((int(mav.seq), int(frame.message.get_crc())))
        self._skip_number(frame.name)
        self._next_at = now + self._pace

    def _write(self, packed: bytes, frame: _Frame, now: float) -> bool:
        if self._signing is not None:
            if not self._signing.ready(now):
                return False
            packed = self._signing.sign(packed, frame.message, now, self._link_id)
        if not self._connection.write(packed, now, revocable=frame.name == _REVOCABLE):
            return False
        self.version.sent(packed, now)
        if frame.bucket is not None:
            self._buckets[frame.bucket].take(len(packed), now)
        self.sent[frame.bucket or "autopilot"] += len(packed)
        return True

    def _pack(self, name: str, message: Any, now: float) -> bytes | None:
        """Pack `message` in the MAVLink version in use; None when that cannot carry it."""
        mav = self._mav(name)
        if not self.version.packs_1(name, now):
            return bytes(message.pack(mav))
        return pack_1(message, mav) if fits_1(message) else None

    def _skip_number(self, name: str) -> None:
        mav = self._mav(name)
        mav.seq = (mav.seq + 1) % 256

    def _mav(self, name: str) -> Any:
        return self._camera if MESSAGES[name].of_camera else self._companion

    def _first(self, now: float) -> _Frame | None:
        """The next frame to send: the most urgent that its budget affords and the rules of turns allow."""
        first: dict[Bucket | None, _Frame] = {}
        for frame in self._sendable(now):
            before = first.setdefault(frame.bucket, frame)
            if self._last_was_shared and before.to in COMMON_SHARES and frame.to not in COMMON_SHARES:
                first[frame.bucket] = frame
        ready = [
            frame
            for bucket, frame in first.items()
            if bucket is None or self._buckets[bucket].affords(frame.size, now)
        ]
        others = [frame for frame in ready if frame.bucket != "asked"]
        return min(others if self._last_was_reply and others else ready, default=None)

    def _sendable(self, now: float) -> list[_Frame]:
        """The waiting frames that may be written to the device as it is now."""
        if self.waiting(_REVOCABLE) and (self.waiting("heartbeat") or not self._connection.idle(now)):
            return [one for one in self._queue if one.priority == 0 and one.name != _REVOCABLE]
        if self._queue and not self._connection.has_room(now):
            return [one for one in self._queue if one.priority == 0]
        return self._queue
