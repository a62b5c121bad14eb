"""Chooses pairs of frames of a drive between which the vehicle drove a known way, almost straight."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.desk.drives.drive import DriveFrame
from companion.desk.drives.frames import open_drive
from companion.desk.drives.recorded import RecordedDrive
from companion.desk.ground.mount_fit import CannotTellError, FramePair, Grey, grey

_SHORTEST, _BEST, _LONGEST = 0.3, 0.7, 1.8
"""Metres between the frames of a pair."""
_MOST_TURNED = 2.0
"""Degrees. The lens is not where the vehicle turns about, so that a turn moves it aside."""
_MOST_PAIRS = 60
_GAP = 1.0
"""Seconds between two reports of the autopilot over which nothing is assumed."""
_FAR = 1e6
"""Metres that count as driven in a gap, so that no pair spans it."""

Floats = NDArray[np.float64]


class DrivenMotion:
    """How the vehicle moved: what it is at a time is interpolated between reports, NaN across a gap."""

    def __init__(self, reports: Iterable[Mapping[str, Any]], speed: float | None = None) -> None:
        """reports: contents of /vehicle, from anybody. speed: m/s that counts instead of the reported one."""
        told = list(reports)
        self._constant = speed
        speeds = _series(told, "position_at", lambda one: [one.get("speed")])
        self._speed_at, way = speeds[:, 0], speeds[:, 1]
        passed = np.diff(self._speed_at)
        gone = np.where(passed <= _GAP, passed * (way[1:] + way[:-1]) / 2, _FAR)
        self._way = np.concatenate([np.zeros(min(1, len(way))), np.cumsum(gone)])
        turned = _series(told, "attitude_at", lambda one: _attitude(one.get("attitude")))
        self._attitude_at, self._attitude = turned[:, 0], np.unwrap(turned[:, 1:], period=360.0, axis=0)

    @property
    def known(self) -> bool:
        """Whether the speed is known at any time."""
        return self._constant is not None or len(self._way) > 1

    def way(self, at: Floats) -> Floats:
        """Return the metres driven until each time."""
        if self._constant is not None:
            return self._constant * at
        return _interpolated(at, self._speed_at, self._way)

    def attitude(self, at: Floats) -> Floats:
        """Return roll, pitch and yaw at each time, (n, 3), in degrees without jumps; 0 where none is told."""
        if len(self._attitude_at) == 0:
            return np.zeros((len(at), 3))
        columns = [_interpolated(at, self._attitude_at, self._attitude[:, one]) for one in range(3)]
        return np.stack(columns, axis=1)


class _Step(NamedTuple):
    """A pair to be: numbers of its frames, and how the vehicle moved between them, as in `FramePair`."""

    first: int
    second: int
    ahead: float
    turned: float
    pitched: float
    banked: float


@dataclass(frozen=True)
class _Run:
    """Frames in their order, with the clock of the vehicle's motion. frames: begins anew at each call."""

    frames: Callable[[], Iterator[tuple[float, DriveFrame]]]
    motion: DrivenMotion

    def steps(self) -> list[_Step]:
        at = np.array([at for at, _ in self.frames()])
        return straight_steps(self.motion.way(at), self.motion.attitude(at)) if len(at) else []


def driven_pairs(where: str, rate: float, speed: float | None) -> list[FramePair]:
    """Return the pairs of a drive, at most `_MOST_PAIRS`, of pictures of one size.

    rate: as for `open_drive`. speed: m/s at which it was driven straight, where no recording tells.
    Raises CannotTellError without a speed, and DriveError.
    """
    runs = list(_runs(where, rate, speed))
    if not any(run.motion.known for run in runs):
        raise CannotTellError(
            "it is not known how fast it was driven: give a recording with the autopilot's position and "
            "speed, or --speed, and drive straight"
        )
    found = [(run, step) for run in runs for step in run.steps()]
    chosen = [found[one] for one in np.linspace(0, len(found) - 1, min(len(found), _MOST_PAIRS)).astype(int)]
    pairs = [pair for run in runs for pair in _pairs(run, [step for one, step in chosen if one is run])]
    return [pair for pair in pairs if pair.first.shape == pair.second.shape == pairs[0].first.shape]


def straight_steps(way: Floats, attitude: Floats) -> list[_Step]:
    """Return the steps of a drive that follow each other.

    way, attitude: of each frame, see `DrivenMotion`.
    """
    found, first = list[_Step](), 0
    while first < len(way) - 1:
        ahead, moved = way[first + 1 :] - way[first], attitude[first + 1 :] - attitude[first]
        right = (ahead >= _SHORTEST) & (ahead <= _LONGEST) & (np.abs(moved[:, 2]) <= _MOST_TURNED)
        if not right.any():
            first += 1
            continue
        best = int(np.argmin(np.where(right, np.abs(ahead / _BEST - 1.0), np.inf)))
        banked, pitched, turned = moved[best].tolist()
        second = first + 1 + best
        found.append(_Step(first, second, float(ahead[best]), turned, pitched, banked))
        first = second
    return found


def _runs(where: str, rate: float, speed: float | None) -> Iterator[_Run]:
    drive = open_drive(where, rate)
    if isinstance(drive, RecordedDrive):
        for part in drive.parts():
            yield _Run(partial(_captured, part), DrivenMotion(part.reports(), speed))
    else:
        yield _Run(
            lambda: ((one.at, one) for one in open_drive(where, rate).frames()), DrivenMotion([], speed)
        )


def _captured(drive: RecordedDrive) -> Iterator[tuple[float, DriveFrame]]:
    for one in drive.recorded():
        at = _figure(one.seen.get("captured_at"))
        if math.isfinite(at):
            yield at, one.frame


def _pairs(run: _Run, steps: Sequence[_Step]) -> Iterator[FramePair]:
    """Read the pictures of the steps."""
    wanted = {number for step in steps for number in step[:2]}
    pictures = dict[int, Grey]()
    for number, (_, frame) in enumerate(run.frames() if wanted else ()):
        if number in wanted and frame.image is not None:
            pictures[number] = grey(frame.image)
    for first, second, *moved in steps:
        if first in pictures and second in pictures:
            yield FramePair(pictures[first], pictures[second], *moved)


def _series(
    told: Sequence[Mapping[str, Any]], clock: str, values: Callable[[Mapping[str, Any]], Sequence[Any]]
) -> Floats:
    """Return rows of a time and its values, with rising times; what is not a number is left out."""
    rows = dict[float, list[float]]()
    for one in told:
        at, *row = map(_figure, [one.get(clock), *values(one)])
        if all(map(math.isfinite, (at, *row))):
            rows.setdefault(at, row)
    width = len(values({}))
    return np.array([[at, *rows[at]] for at in sorted(rows)]).reshape(-1, 1 + width)


def _attitude(told: Any) -> Sequence[Any]:
    return told if isinstance(told, list) and len(told) == 3 else (None, None, None)


def _figure(raw: Any) -> float:
    return float(raw) if isinstance(raw, float | int) and abs(raw) < 1e12 else math.nan


def _interpolated(at: Floats, times: Floats, values: Floats) -> Floats:
    if len(times) < 2:
        return np.full(len(at), np.nan)
    after = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
    known = (at >= times[0]) & (at <= times[-1]) & (times[after] - times[after - 1] <= _GAP)
    return np.where(known, np.interp(at, times, values), np.nan)
