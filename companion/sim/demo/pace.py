"""Chooses how fast the demo's rover drives, by how many pictures this computer judges. Pure."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from companion.daemon.policy.hold_gate import GUIDES_FROM

SPEED = 1.5
"""m/s that the simulated rover drives where the computer is fast enough."""


class DemoPace(NamedTuple):
    """How the demo is played.

    rate: pictures/s that the daemon aims to judge. freshness: T, in s. speed, guided: m/s at which the rover
    stops in time by these, with policy hold and with policy guide.
    """

    rate: float
    freshness: float
    speed: float
    guided: float

    def drives(self, *, guide: bool) -> float:
        """Return the speed in m/s."""
        return self.guided if guide else self.speed

    @property
    def drawn(self) -> float:
        """Pictures/s that the simulated camera takes: drawing them costs time, too."""
        return min(12.0, max(2.0, 2.0 * self.rate))

    @property
    def silence(self) -> float:
        """Seconds of silence after which the script on the autopilot takes the daemon for dead."""
        return max(1.5, self.freshness)


PACES = (
    DemoPace(10.0, 1.0, SPEED, 1.2),
    DemoPace(4.0, 2.0, 1.0, 0.8),
    DemoPace(2.0, 3.0, 0.8, 0.65),
    DemoPace(1.0, 5.0, 0.55, 0.45),
    DemoPace(0.5, 10.0, 0.3, 0.3),
)
"""From fast to slow. Each has time to spare for a computer that becomes busier."""
_FULL_RATE, _FULL_LATENCY = 8.0, 0.25
"""Pictures/s, and s from capture until judged, that are good enough for the first pace."""
_SHARE = 0.7
"""Of the pictures/s that were judged, what the other paces aim at, at most."""
_LATENCIES = 4.0
"""Latencies that fit into T, at least."""
WINDOW = 3.0
"""Seconds for which pictures are counted."""
LONGEST = 12.0
"""Seconds after which a slow computer is believed to be one: all programs have started then."""


class Judging(NamedTuple):
    """What a computer can do. rate: pictures judged a second. latency: s from capture until judged."""

    rate: float
    latency: float

    def __str__(self) -> str:
        text = f"{self.rate:.1f} pictures a second"
        return (
            text if self.latency < _FULL_LATENCY else f"{text}, each {self.latency:.1f} s after it was taken"
        )


def pace_for(judging: Judging, *, guide: bool = False) -> DemoPace:
    """Return the fastest pace that this computer keeps, the slowest where it keeps none.

    guide: only paces with which policy guide is given.
    """
    if judging.rate >= _FULL_RATE and judging.latency <= _FULL_LATENCY:
        return PACES[0]
    paces = _paces(guide=guide)
    for pace in paces[1:]:
        if pace.rate <= _SHARE * judging.rate and pace.freshness >= _LATENCIES * judging.latency:
            return pace
    return paces[-1]


def slower(pace: DemoPace, judging: Judging | None, *, guide: bool = False) -> DemoPace | None:
    """Return the pace to go on at where this one was not kept, None after the slowest.

    judging: what was measured at this pace, None: nothing. It may have been a moment only, so that no more
    than one pace is left out for it. guide: as for `pace_for`.
    """
    after = [one for one in _paces(guide=guide) if one.rate < pace.rate][:2]
    if judging is None:
        return after[0] if after else None
    kept = pace_for(judging, guide=guide)
    return next((one for one in after if one.rate <= kept.rate), after[-1] if after else None)


def _paces(*, guide: bool) -> Sequence[DemoPace]:
    return [one for one in PACES if one.rate >= GUIDES_FROM] if guide else PACES


class JudgingMeter:
    """Counts the pictures that the daemon judges, by its status. Time is an input, in monotonic seconds."""

    def __init__(self) -> None:
        self._samples: deque[tuple[float, int]] = deque(maxlen=600)
        self._latency = 0.0
        self._best: Judging | None = None
        self.began: float | None = None
        """When the first pictures were judged."""
        self.frames = 0
        """Pictures that were judged so far."""

    def take(self, status: Mapping[str, Any], now: float) -> None:
        """Take the daemon's status, which it writes once a second."""
        frames = int(status.get("frames", 0))
        if frames < self.frames:  # the daemon was started again
            self._samples.clear()
            self.began, self.frames, self._best = None, 0, None
        if not frames or frames == self.frames:
            return
        self.frames, self._latency = frames, float(status.get("latency_ms") or 0.0) / 1e3
        self.began = self.began or now
        self._samples.append((now, frames))
        while len(self._samples) > 2 and now - self._samples[1][0] >= WINDOW:
            self._samples.popleft()

    def judging(self, now: float) -> Judging | None:
        """Return what was judged in the last `WINDOW` s, None while that is not known.

        No new picture counts, too: then the rate falls with the time.
        """
        if not self._samples or now - self._samples[0][0] < WINDOW:
            return None
        began, first = self._samples[0]
        newest, last = self._samples[-1]
        # The status is a second old at most; what follows it is not yet told.
        ended = newest if now - newest < WINDOW / 2 else now
        return Judging((last - first) / max(ended - began, WINDOW / 2), self._latency)

    def settled(self, now: float) -> Judging | None:
        """Return the same once it may be decided by: at once where all is well, else the best of `LONGEST` s.

        Other programs are still being loaded meanwhile.
        """
        found = self.judging(now)
        if found is None or self.began is None:
            return None
        self._best = max(found, self._best or found)
        if pace_for(found) is PACES[0]:
            return found
        return self._best if now - self.began >= LONGEST else None
