"""Models one direction of a bad radio: frames come out late, twice, in another order or not at all."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from random import Random


@dataclass(frozen=True)
class LinkConditions:
    """The properties of a bad radio; shares are in [0, 1].

    loss: share lost. twice: share that comes a second time, up to `late` s after the first. shuffled: share
    that comes up to `late` s late, after frames that were sent later. stall_every: mean s between stalls of
    `stall_for` s, in which nothing comes out, and then all at once; 0: no stalls. rate: B/s, 0: unlimited;
    frames that do not fit the radio's memory of `memory` bytes are lost. delay: s that every frame takes.
    """

    loss: float = 0.0
    twice: float = 0.0
    shuffled: float = 0.0
    late: float = 2.0
    stall_every: float = 0.0
    stall_for: float = 1.0
    rate: float = 0.0
    memory: int = 2048
    delay: float = 0.05


class RadioModel:
    """One direction of a bad radio; the same seed, frames and times give the same result."""

    def __init__(self, weather: LinkConditions, seed: str) -> None:
        self._weather = weather
        self._random = Random(seed)
        self._flying: list[tuple[float, int, bytes]] = []
        self._order = 0
        self._free_at = 0.0
        self._stalled_until = 0.0
        self._stall_at = self._next_stall(0.0)
        self.put_in = self.lost = self.doubled = 0

    def put(self, frame: bytes, now: float) -> None:
        """Sends one frame."""
        weather = self._weather
        self.put_in += 1
        if weather.rate:
            self._free_at = max(self._free_at, now)
            if (self._free_at - now) * weather.rate + len(frame) > weather.memory:
                self.lost += 1
                return
            self._free_at += len(frame) / weather.rate
        if self._random.random() < weather.loss:
            self.lost += 1
            return
        due = max(now, self._free_at if weather.rate else now) + weather.delay
        if self._random.random() < weather.shuffled:
            due += self._random.uniform(0.0, weather.late)
        self._fly(frame, due)
        if self._random.random() < weather.twice:
            self.doubled += 1
            self._fly(frame, due + self._random.uniform(0.0, weather.late))

    def take(self, now: float) -> list[bytes]:
        """Returns the frames that have come out by now."""
        while now >= self._stall_at:
            self._stalled_until = self._stall_at + self._weather.stall_for
            self._stall_at = self._next_stall(self._stalled_until)
        if now < self._stalled_until:
            return []
        out = []
        while self._flying and self._flying[0][0] <= now:
            out.append(heapq.heappop(self._flying)[2])
        return out

    def _fly(self, frame: bytes, due: float) -> None:
        heapq.heappush(self._flying, (due, self._order, frame))
        self._order += 1

    def _next_stall(self, after: float) -> float:
        every = self._weather.stall_every
        return after + self._random.expovariate(1.0 / every) if every else float("inf")
