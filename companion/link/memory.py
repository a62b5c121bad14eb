"""A link without a device, for tests and rehearsals in virtual time."""

from __future__ import annotations

from collections import deque

_MAX_WAITING = 4096


class MemoryTransport:
    """One end of a pair; what one end writes the other reads. `broken`: read and write raise OSError."""

    datagrams = True

    def __init__(self) -> None:
        self._inbox: deque[bytes] = deque(maxlen=_MAX_WAITING)
        self._outbox: deque[bytes] = self._inbox
        self.broken = False
        self.full = False

    def read(self) -> bytes:
        """The oldest frame that waits."""
        self._check()
        return self._inbox.popleft() if self._inbox else b""

    def write(self, frame: bytes) -> bool:
        """False while `full`."""
        self._check()
        if self.full:
            return False
        self._outbox.append(frame)
        return True

    def believe(self, now: float, *, autopilot: bool) -> None:
        """There is one other end only."""

    def fileno(self) -> int | None:
        """There is none."""
        return None

    def close(self) -> None:
        """Nothing to give back."""

    def _check(self) -> None:
        if self.broken:
            raise OSError("unplugged")


def pair() -> tuple[MemoryTransport, MemoryTransport]:
    """Two ends."""
    one, other = MemoryTransport(), MemoryTransport()
    one._outbox, other._outbox = other._inbox, one._inbox
    return one, other
