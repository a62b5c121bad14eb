"""Measures the stopping distance while a person drives and sets HOLD or GUIDED: `companion check --measure`.

It sends no commands: it receives mode and speed as the autopilot streams them, and reads the parameters that
say how often it does.
"""

from __future__ import annotations

import math
import signal
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

from companion.config import ConfigError, load_config, state_folder
from companion.config.link_settings import LinkSettingError
from companion.desk.check.autopilot import silence, talking
from companion.desk.check.here import status
from companion.desk.check.interview import ARDUPILOT, Heartbeat
from companion.desk.check.stop_file import write_stops
from companion.system.as_owner import as_owner
from companion.vehicle import known_autopilot
from companion.vehicle.brakes import Measured, fit

LONGEST = 3600.0
"""Seconds after which measuring ends by itself."""
MOST_HOLDS = 100
STANDS = 0.05
"""m/s up to which the vehicle counts as standing."""
_STANDING = 0.5
"""Seconds of standing after which a stop is complete."""
_NEVER_STOOD = 40.0
"""Seconds after which a stop that does not end is dropped."""
_LOST = 3.0
"""Seconds without a heartbeat after which the mode is unknown."""
_GAP = 1.0
"""Seconds between two speeds beyond which the distance between them is too uncertain."""
_STEADY_FOR = 2.0
"""Seconds before HOLD over which the vehicle must have driven steadily."""
_STEADY = 0.93
"""Least ratio of the last speed before HOLD to the cruising speed; its inverse is the greatest."""
_SLOWEST = 0.3
"""m/s below which a stop is too short to measure."""
_SILENT = "no speed is heard: stream GLOBAL_POSITION_INT here (SRn_POSITION or MAVn_POSITION 4)"
ENOUGH = 1.5
"""Least rate (Hz) of speeds to measure a stop. At 1 Hz one late speed breaks it off. 2 Hz give it within 1 %
in the simulated field."""
_ASKED_FOR = 4
"""Value of the parameter, Hz, that is asked for."""
_COUNTED_FOR = 3.0
"""Seconds of the autopilot's clock over which speeds are counted."""
_SPEED_WITHIN = 6.0
"""Seconds after which it is said that no speed is heard."""
STREAMS = (
    *(f"MAV{number}_POSITION" for number in range(1, 7)),
    *(f"SR{number}_POSITION" for number in range(7)),
)
"""ArduPilot's parameters for that, one a port: from 4.7, and up to 4.6."""


def too_seldom(rate: float, values: Mapping[str, float]) -> str:
    """Explain what to set where speeds come too seldom. rate: Hz. values: of the parameters `STREAMS`."""
    slow = [name for name in STREAMS if 0 < values.get(name, 0.0) < _ASKED_FOR]
    alike = [name for name in slow if round(values[name]) == round(rate)] or slow
    which = " or ".join(alike) or "MAVn_POSITION (SRn_POSITION up to 4.6)"
    port = "" if len(alike) == 1 else ", that of this port,"
    return (
        f"speeds come {rate:.1f} times a second, which is too seldom: set {which}{port} to {_ASKED_FOR}, "
        "reboot the autopilot, since it takes that at boot, and measure then"
    )


class _Speed(NamedTuple):
    at: float
    """Seconds of the autopilot's clock."""
    speed: float


@dataclass
class StopRecorder:
    """Measures stops from an autopilot's messages. Pure: time is an input.

    hold: HEARTBEAT.custom_mode of HOLD, or of the mode that brakes. name: of that mode. stops: those measured
    so far.
    """

    hold: int
    name: str = "HOLD"
    stops: list[Measured] = field(default_factory=list)
    _speeds: deque[_Speed] = field(default_factory=lambda: deque(maxlen=4000))
    _counted: int = 0
    _counted_from: float = 0.0
    _mode: int | None = None
    _heard_at: float = -math.inf
    _ahead: float = 0.0
    """Seconds of the autopilot's clock minus ours, at the newest speed."""
    _ordered_at: float | None = None
    """When HOLD was seen, in seconds of the autopilot's clock; None while no stop is measured."""

    def hear(self, message: Any, now: float) -> str:
        """Take a message. Returns a line to print, or "". now: monotonic seconds when the message came."""
        kind = message.get_type()
        if kind == "HEARTBEAT" and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
            return self._heartbeat(message, now)
        if kind == "GLOBAL_POSITION_INT":
            return self._position(message, now)
        return ""

    @property
    def rate(self) -> float | None:
        """How often speeds come, Hz. None: not known yet."""
        lasted = self._speeds[-1].at - self._counted_from if self._speeds else 0.0
        return (self._counted - 1) / lasted if lasted >= _COUNTED_FOR else None

    def _heartbeat(self, message: Any, now: float) -> str:
        before, self._mode = self._mode, int(message.custom_mode)
        lost, self._heard_at = now - self._heard_at > _LOST, now
        armed = message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        if self._ordered_at is not None:
            if self._mode != self.hold or not armed or lost:
                return self._drop(f"it did not stay in {self.name}, armed and heard")
        elif self._mode == self.hold and armed and before not in (None, self.hold) and not lost:
            return self._begin(now)
        return ""

    def _begin(self, now: float) -> str:
        ordered = now + self._ahead
        while self._speeds and self._speeds[0].at < ordered - _STEADY_FOR:
            self._speeds.popleft()
        if not self._speeds or self._speeds[-1].at < ordered - _GAP:
            return f"not counted: {_SILENT}"
        cruise = median(one.speed for one in self._speeds)
        if cruise < _SLOWEST:
            return f"not counted: {cruise:.1f} m/s is too slow to measure" if cruise > STANDS else ""
        # ArduPilot sends a heartbeat at once when its mode changes. If that one was lost, the vehicle is
        # braking already when the next one comes, and the measured distance would be too short.
        if not _STEADY * cruise <= self._speeds[-1].speed <= cruise / _STEADY:
            return (
                f"not counted: it was not driving steadily at {cruise:.1f} m/s when its {self.name} was heard"
            )
        self._ordered_at = ordered
        return ""

    def _position(self, message: Any, now: float) -> str:
        # Times are those of the autopilot's clock, since the link delays messages unevenly.
        one = _Speed(message.time_boot_ms / 1000.0, math.hypot(message.vx, message.vy) / 100.0)
        if self._speeds and one.at == self._speeds[-1].at:
            return ""
        if not self._speeds or one.at < self._speeds[-1].at:
            self._counted, self._counted_from = 0, one.at
        self._counted += 1
        if self._speeds and not 0.0 < one.at - self._speeds[-1].at <= _GAP:
            self._speeds.clear()
            self._speeds.append(one)
            return self._drop("speeds came too seldom") if self._ordered_at is not None else ""
        self._speeds.append(one)
        self._ahead = one.at - now
        ordered = self._ordered_at
        if ordered is None:
            while self._speeds[0].at < one.at - _STEADY_FOR:
                self._speeds.popleft()
            return ""
        if one.at - ordered > _NEVER_STOOD:
            return self._drop(f"it never stood in {_NEVER_STOOD:.0f} s")
        moving = max((each.at for each in self._speeds if each.speed > STANDS), default=ordered)
        return self._complete(ordered, moving) if one.at - moving >= _STANDING else ""

    def _complete(self, ordered: float, stood: float) -> str:
        begin = _at(self._speeds, ordered)
        way = [begin, *(one for one in self._speeds if one.at > ordered)]
        metres = sum((b.at - a.at) * (a.speed + b.speed) / 2.0 for a, b in pairwise(way))
        stop = Measured(round(begin.speed, 2), round(metres, 2))
        self._ordered_at = None
        if stop.way <= 0.0:
            return "not counted: it stood at once"
        self.stops.append(stop)
        seconds = stood - ordered
        return f"{self.name} {len(self.stops)} at {stop.speed:.2f} m/s: {stop.way:.2f} m, {seconds:.1f} s"

    def _drop(self, why: str) -> str:
        self._ordered_at = None
        return f"not counted: {why}"


def _at(speeds: deque[_Speed], at: float) -> _Speed:
    """Interpolate the speed at a time; outside of the known times the nearest speed counts."""
    before = max((one for one in speeds if one.at <= at), default=speeds[0])
    after = min((one for one in speeds if one.at >= at), default=before)
    share = (at - before.at) / (after.at - before.at) if after.at > before.at else 0.0
    return _Speed(at, before.speed + share * (after.speed - before.speed))


def measure(file: str, *, link: str | None = None, longest: float = LONGEST) -> int:
    """Print each stop until Ctrl-C, then the fitted lines for the configuration. Returns 1 on failure."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        config = load_config(file)
    except ConfigError as error:
        print(error)
        return 1
    if link is None and status(state_folder(config)) is not None:
        print("the companion runs and owns the link: stop it, or give the check a way of its own with --link")
        return 1
    recorder, braking = StopRecorder(hold=-1), StopRecorder(hold=-1, name="GUIDED")
    line = ""

    def listen(message: Any, now: float) -> None:
        nonlocal line
        heard = [one.hear(message, now) for one in (recorder, braking)]
        line = heard[0] or heard[1] or line

    try:
        with talking(config, link or config.link.url, lambda _: STREAMS) as (interview, turn):
            interview.listen = listen
            until = interview.began + longest
            ready, silent_at = False, math.inf
            try:
                while time.monotonic() < until and len(recorder.stops) < MOST_HOLDS:
                    if turn() and interview.autopilot is None:
                        break
                    if interview.autopilot is not None and recorder.hold < 0:
                        recorder.hold, braking.hold = _modes_of(interview.autopilot)
                        print(_HEARD.format(system=interview.autopilot.system_id), flush=True)
                        silent_at = time.monotonic() + _SPEED_WITHIN
                    if not ready and recorder.rate is not None:
                        _check_rate(recorder.rate, interview.values)
                        ready = True
                        print(_OPENING, flush=True)
                    elif not ready and time.monotonic() >= silent_at:
                        silent_at = math.inf
                        print(_SILENT, flush=True)
                    if line:
                        print(line, flush=True)
                        line = ""
            except KeyboardInterrupt:
                pass
            if interview.autopilot is None:
                print(silence(link or config.link.url, interview))
                return 1
    except (LinkSettingError, _NotMeasurableError) as error:
        print(error)
        return 1
    _store(state_folder(config), recorder.stops, braking.stops)
    return _conclude(recorder.stops, braking.stops)


def _store(folder: Path, holds: list[Measured], brakes: list[Measured]) -> None:
    """Keep the stops for `companion evidence`."""
    if not holds and not brakes:
        return
    try:
        with as_owner(folder):
            print(f"stored in {write_stops(folder, [('HOLD', holds), ('GUIDED', brakes)], time.time())}")
    except OSError as error:
        print(f"not stored in {folder}: {(error.strerror or str(error)).lower()}: you may have to use sudo")


class _NotMeasurableError(Exception):
    """The HOLD of this autopilot cannot be measured; the text says why."""


def _check_rate(rate: float, values: Mapping[str, float]) -> None:
    """Raise where speeds come too seldom to measure a stop."""
    if rate < ENOUGH:
        raise _NotMeasurableError(too_seldom(rate, values))


def _modes_of(heard: Heartbeat) -> tuple[int, int]:
    """Return the mode that holds, and the one in which the script brakes before."""
    known = known_autopilot(heard.kind, heard.vehicle)
    if known is None or heard.kind != ARDUPILOT or known.brake_mode is None:
        raise _NotMeasurableError(
            "only an ArduPilot rover's HOLD is measured: PX4 circles in LOITER, which is no braking. Measure "
            "the way on the ground"
        )
    return known.hold_mode, known.brake_mode


_HEARD = "System {system} is heard. Nothing is commanded. Do not drive yet: it listens how often speeds come."
_OPENING = """\
Speeds come often enough: drive steadily, set HOLD, wait until it stands, drive again.
Brake three times at walking pace, and three times at the fastest that it drives. Ctrl-C ends.
For hold_by = "brake" do the same with GUIDED in place of HOLD, and send no target."""


def _conclude(holds: list[Measured], brakes: list[Measured]) -> int:
    lines: list[str] = []
    for name, prefix, stops in (("HOLD", "", holds), ("GUIDED", "brake_", brakes)):
        if not stops and (prefix or brakes):
            continue
        try:
            found = fit(stops, name)
        except ValueError as error:
            print(f"nothing fitted: {error}")
            continue
        print(
            f"\n# {len(stops)} {name}s measured, m/s and m: "
            + ", ".join(f"{v:g} {way:g}" for v, way in stops)
        )
        print(
            f"# Never less than measured, at most {100 * found.excess:.0f} % more. Unknown above the fastest."
        )
        lines += [f"{prefix}time_constant = {found.time_constant:g}", f"{prefix}braking = {found.braking:g}"]
    if not lines:
        return 1
    print("\n".join(["[stopping]", *lines]))
    return 0
