"""`companion check --measure`: a person drives and sets HOLD, and this fits the brakes to what was seen.

It commands nothing and asks for nothing: it listens to mode and speed as the autopilot streams them.
"""

from __future__ import annotations

import math
import signal
import time
from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

from companion.config import ConfigError, load_config
from companion.link.settings import LinkError
from companion.policy.stopping import Measured, fit
from companion.preflight.autopilot import silence, talking
from companion.preflight.here import state_folder, status
from companion.preflight.interview import ARDUPILOT, Heartbeat
from companion.vehicle import known_autopilot

LONGEST = 3600.0
"""Seconds after which it ends by itself."""
MOST_HOLDS = 100
STANDS = 0.05
"""m/s."""
_STANDING = 0.5
_NEVER_STOOD = 40.0
_LOST = 3.0
"""Seconds without a heartbeat."""
_GAP = 1.0
"""Seconds between two speeds that say too little of the way between them."""
_REMEMBERED = 2.0
"""Seconds over which it must have driven steadily."""
_STEADY = 0.93
"""Share of the speed by which it may have slowed down or sped up before its HOLD was heard."""
_SLOWEST = 0.3
_SILENT = "no speed is heard: stream GLOBAL_POSITION_INT here (SRn_POSITION or MAVn_POSITION 4)"


class _Speed(NamedTuple):
    at: float
    """Seconds by the autopilot's clock."""
    speed: float


@dataclass
class Recorder:
    """Hears an autopilot; each stop, or why one does not count, comes out. Pure: times come in.

    hold: HEARTBEAT.custom_mode of its HOLD. stops: measured so far.
    """

    hold: int
    stops: list[Measured] = field(default_factory=list)
    _speeds: deque[_Speed] = field(default_factory=lambda: deque(maxlen=4000))
    _mode: int | None = None
    _heard_at: float = -math.inf
    _ahead: float = 0.0
    """The autopilot's clock less ours, as the newest speed had it."""
    _ordered_at: float | None = None
    """By the autopilot's clock; None while no stop is measured."""

    def hear(self, message: Any, now: float) -> str:
        """A line for the person, or "". now: s, when it came."""
        kind = message.get_type()
        if kind == "HEARTBEAT" and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
            return self._heartbeat(message, now)
        if kind == "GLOBAL_POSITION_INT":
            return self._position(message, now)
        return ""

    def _heartbeat(self, message: Any, now: float) -> str:
        before, self._mode = self._mode, int(message.custom_mode)
        lost, self._heard_at = now - self._heard_at > _LOST, now
        armed = message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        if self._ordered_at is not None:
            if self._mode != self.hold or not armed or lost:
                return self._dropped("it did not stay in HOLD, armed and heard")
        elif self._mode == self.hold and armed and before not in (None, self.hold) and not lost:
            return self._begin(now)
        return ""

    def _begin(self, now: float) -> str:
        ordered = now + self._ahead
        while self._speeds and self._speeds[0].at < ordered - _REMEMBERED:
            self._speeds.popleft()
        if not self._speeds or self._speeds[-1].at < ordered - _GAP:
            return f"not counted: {_SILENT}"
        cruise = median(one.speed for one in self._speeds)
        if cruise < _SLOWEST:
            return f"not counted: {cruise:.1f} m/s is too slow to measure" if cruise > STANDS else ""
        # ArduPilot tells a mode at once. Where that heartbeat was lost, the brakes act before the next one.
        if not _STEADY * cruise <= self._speeds[-1].speed <= cruise / _STEADY:
            return f"not counted: it was not driving steadily at {cruise:.1f} m/s when its HOLD was heard"
        self._ordered_at = ordered
        return ""

    def _position(self, message: Any, now: float) -> str:
        one = _Speed(message.time_boot_ms / 1000.0, math.hypot(message.vx, message.vy) / 100.0)
        if self._speeds and not 0.0 < one.at - self._speeds[-1].at <= _GAP:
            if one.at == self._speeds[-1].at:
                return ""
            self._speeds.clear()
            self._speeds.append(one)
            return self._dropped("speeds came too seldom") if self._ordered_at is not None else ""
        self._speeds.append(one)
        self._ahead = one.at - now
        ordered = self._ordered_at
        if ordered is None:
            while self._speeds[0].at < one.at - _REMEMBERED:
                self._speeds.popleft()
            return ""
        if one.at - ordered > _NEVER_STOOD:
            return self._dropped(f"it never stood in {_NEVER_STOOD:.0f} s")
        moving = max((each.at for each in self._speeds if each.speed > STANDS), default=ordered)
        return self._stood(ordered, moving) if one.at - moving >= _STANDING else ""

    def _stood(self, ordered: float, stood: float) -> str:
        begin = _at(self._speeds, ordered)
        way = [begin, *(one for one in self._speeds if one.at > ordered)]
        metres = sum((b.at - a.at) * (a.speed + b.speed) / 2.0 for a, b in pairwise(way))
        stop = Measured(round(begin.speed, 2), round(metres, 2))
        self._ordered_at = None
        if stop.way <= 0.0:
            return "not counted: it stood at once"
        self.stops.append(stop)
        return f"HOLD {len(self.stops)} at {stop.speed:.2f} m/s: {stop.way:.2f} m, {stood - ordered:.1f} s"

    def _dropped(self, why: str) -> str:
        self._ordered_at = None
        return f"not counted: {why}"


def _at(speeds: deque[_Speed], at: float) -> _Speed:
    """The speed at a time between two that are known, or next to them."""
    before = max((one for one in speeds if one.at <= at), default=speeds[0])
    after = min((one for one in speeds if one.at >= at), default=before)
    share = (at - before.at) / (after.at - before.at) if after.at > before.at else 0.0
    return _Speed(at, before.speed + share * (after.speed - before.speed))


def measure(file: str, *, link: str | None = None, longest: float = LONGEST) -> int:
    """Print each HOLD until Ctrl-C, then the lines for the configuration; 0 where they could be fitted."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        config = load_config(file)
    except ConfigError as error:
        print(error)
        return 1
    if link is None and status(state_folder(config)) is not None:
        print("the companion runs and owns the link: stop it, or give the check a way of its own with --link")
        return 1
    recorder = Recorder(hold=-1)
    told = ""

    def listen(message: Any, now: float) -> None:
        nonlocal told
        told = recorder.hear(message, now) or told

    try:
        with talking(config, link or config.link.url, lambda _: ()) as (interview, turn):
            interview.listen = listen
            until = interview.began + longest
            try:
                while time.monotonic() < until and len(recorder.stops) < MOST_HOLDS:
                    if turn() and interview.autopilot is None:
                        break
                    if interview.autopilot is not None and recorder.hold < 0:
                        recorder.hold = _hold_of(interview.autopilot)
                        print(_OPENING.format(system=interview.autopilot.system_id), flush=True)
                    if told:
                        print(told, flush=True)
                        told = ""
            except KeyboardInterrupt:
                pass
            if interview.autopilot is None:
                print(silence(link or config.link.url, interview))
                return 1
    except (LinkError, _NotMeasurableError) as error:
        print(error)
        return 1
    return _conclude(recorder.stops)


class _NotMeasurableError(Exception):
    """This autopilot's HOLD cannot be measured so; the text says why."""


def _hold_of(heard: Heartbeat) -> int:
    known = known_autopilot(heard.kind, heard.vehicle)
    if known is None or heard.kind != ARDUPILOT:
        raise _NotMeasurableError(
            "only an ArduPilot rover's HOLD is measured: PX4 circles in LOITER, which is no braking. Measure "
            "the way on the ground"
        )
    return known.hold_mode


_OPENING = """\
System {system} is heard. Nothing is commanded: drive steadily, set HOLD, wait until it stands, drive again.
Brake three times at walking pace, and three times at the fastest that it drives. Ctrl-C ends."""


def _conclude(stops: list[Measured]) -> int:
    try:
        found = fit(stops)
    except ValueError as error:
        print(f"nothing fitted: {error}")
        return 1
    print(f"\n# {len(stops)} HOLDs measured, m/s and m: " + ", ".join(f"{v:g} {way:g}" for v, way in stops))
    print(f"# Never less than measured, at most {100 * found.excess:.0f} % more. Unknown above the fastest.")
    print(f"[stopping]\ntime_constant = {found.time_constant:g}\nbraking = {found.braking:g}")
    return 0
