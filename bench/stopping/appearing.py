"""Puts a drum before a driving rover, nearer than it can stop or not, and tells how fast it is touched.

In virtual time and one process: the simulated rover and camera, the shipped perceiver with the demo's
configuration, the rules of calls and holds. What wire, autopilot and script take is assumed. Each seed has a
place, a speed and a delay; with these each distance is tried by HOLD and with the brake before it.
Run: python -m bench.stopping.appearing [--runs 20]. The last line is one JSON object; nothing fails.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from random import Random
from typing import Any

from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame
from bench.calls.engines import alone, of_the_field
from bench.calls.field import FilmedField
from bench.stopping.jobs import FAST, SLOW
from companion.calls.decisions import SetMode
from companion.calls.machine import OperatorCalls
from companion.calls.mode_monitor import ModeReport
from companion.calls.policy import PolicyState
from companion.config import Config
from companion.config.stopping import OVERSHOOT, Stopping, judge_stopping
from companion.daemon.settings.runtime import call_numbers
from companion.sim.field.rover import STANDSTILL, STEP, MotorDrive, Rover
from companion.sim.field.things import FieldThing, World
from companion.vehicle import ardupilot
from companion.wire.ids import Policy

RATE = 10.0
SHARES = (0.5, 1.0, 1.5)
"""Of the stopping distance, from the rover's front to the drum, as it appears."""
JUDGED, SCRIPT = 0.05, 0.1
"""s from a frame's capture to the command; s at most from there until the script sets the mode."""
SEEN_BEFORE = 1.5
"""s of frames before the drum appears, in which nothing may be held."""
BRAKED = 0.1
"""m/s below which the script sets HOLD."""
PLACES = 20
"""Places that are tried for a seed, until one is not held for something else."""
DRUM = "a drum"
RADIUS, TALL = 0.29, 0.88


@dataclass(frozen=True)
class Appeared:
    """What came of one run. speed: m/s as the drum appeared. touched: m/s at contact, 0: it stood before it.

    needs: the stopping distance in m that `companion check` computes from this speed. gap: m that were left.
    """

    brakes: bool
    share: float
    speed: float
    needs: float
    touched: float
    gap: float


class _Approach:
    """A rover that drives at a speed from a place on; frames and decisions are those of the companion."""

    def __init__(self, random: Random, seed: int, engine: AnyTraverse, config: Config) -> None:
        world = World(seed, ())
        self._speed, self._config = random.uniform(SLOW, FAST), config
        world.trail.start = random.uniform(0.0, world.trail.length)
        self._late = JUDGED + random.uniform(0.0, SCRIPT)
        self._field, self._rover = FilmedField(world), Rover(world.trail, cruise_speed=self._speed)
        self._engine = deepcopy(engine, {id(engine.perceiver): engine.perceiver})
        self._rover.drive = MotorDrive.FOLLOW
        while self._rover.speed < 0.99 * self._speed:
            self._rover.step(STEP)
        numbers = call_numbers(config, self._engine.settings)
        self._calls = OperatorCalls(numbers, PolicyState(Policy.HOLD), self._rover.time)
        self._frames, self._next = 0, self._rover.time
        self._held_at = math.inf
        """When the autopilot sets the mode, s of the rover's time."""

    def run(self, share: float) -> list[Appeared]:
        """Returns what came of it by both ways; nothing where it was held before the drum appeared."""
        rover = self._rover
        until = rover.time + SEEN_BEFORE
        while rover.time < until:
            self._drive_on()
        if self._held_at < math.inf:
            return []
        needs = self._needs()
        self._put(share * needs)
        while not self._touches(rover) and rover.time < self._held_at:
            self._drive_on()
        return [Appeared(brakes, share, self._speed, needs, *self._stop(brakes)) for brakes in (False, True)]

    def _needs(self) -> float:
        """Returns the stopping distance from the speed that the rover really drives."""
        section = replace(self._config.stopping, speed=self._speed / OVERSHOOT)
        judged = judge_stopping(replace(self._config, stopping=section))
        assert isinstance(judged, Stopping)
        return judged.needs

    def _put(self, distance: float) -> None:
        world, rover = self._field.world, self._rover
        at = world.trail.pose((rover.s + rover.body.radius + distance + RADIUS) % world.trail.length)
        world.add(FieldThing(DRUM, "drum", at.x, at.y, RADIUS, TALL, surprise=True))

    def _touches(self, rover: Rover) -> bool:
        return DRUM in self._field.world.contact(rover.x, rover.y, rover.body.radius)

    def _stop(self, brakes: bool) -> tuple[float, float]:
        """Stops, with the brake first or not. Returns m/s at contact and m left; one of them is 0."""
        trail = self._field.world.trail
        rover = deepcopy(self._rover, {id(trail): trail})
        begun = rover.time
        while rover.speed > STANDSTILL:
            if self._touches(rover):
                return rover.speed, 0.0
            over = rover.time - begun >= ardupilot.LONGEST_BRAKE or rover.speed < BRAKED
            rover.drive = MotorDrive.STOP if brakes and not over else MotorDrive.HOLD
            rover.step(STEP)
        drum = self._field.world.things[DRUM]
        return 0.0, math.hypot(drum.x - rover.x, drum.y - rover.y) - rover.body.radius - RADIUS

    def _drive_on(self) -> None:
        rover = self._rover
        if self._held_at == math.inf and rover.time >= self._next - 1e-9:
            self._next += 1.0 / RATE
            self._see()
        rover.step(STEP)

    def _see(self) -> None:
        rover, self._frames = self._rover, self._frames + 1
        now = rover.time
        report = ModeReport(
            ardupilot.AUTO,
            armed=True,
            travelled=rover.distance,
            reported_at=now,
            autopilot=ardupilot.ROVER,
            compares=True,
            takes_resume=True,
        )
        decisions = list(self._calls.vehicle_reported(report, now))
        frame = self._field.frame(rover.pose, now, rover.distance)
        assert frame.image is not None
        seen = self._engine.step(Frame(self._frames, now, frame.image), now, frame.place)
        decisions += [*self._calls.assessed(seen, now), *self._calls.tick(now)]
        if any(isinstance(one, SetMode) for one in decisions):
            self._held_at = now + self._late


def run(seed: int, engine: AnyTraverse, config: Config) -> list[Appeared]:
    """Returns all runs of a seed, from the first place at which nothing else is held for."""
    for place in range(PLACES):
        found = [
            one
            for share in SHARES
            for one in _Approach(Random(f"{seed} {place}"), seed, engine, config).run(share)
        ]
        if found:
            return found
    raise RuntimeError(f"seed {seed}: it was held for something else everywhere")


def figures(found: Sequence[Appeared]) -> dict[str, Any]:
    """Sums up. touched: runs with a contact; m/s at contact are over all runs, 0 where there was none."""
    told: dict[str, Any] = {"runs": len(found)}
    for brakes, name in ((False, "hold"), (True, "brake")):
        for share in SHARES:
            own = [one for one in found if one.brakes is brakes and one.share == share]
            speeds = sorted(one.touched for one in own)
            told[f"{name} {share:g}"] = {
                "runs": len(own),
                "touched": sum(speed > 0.0 for speed in speeds),
                "median_m_s": round(speeds[len(speeds) // 2], 2) if speeds else None,
                "most_m_s": round(speeds[-1], 2) if speeds else None,
            }
    return told


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.stopping.appearing", description=__doc__)
    parser.add_argument("--runs", type=int, default=20, help="seeds, each by both ways (default 20)")
    found: list[Appeared] = []
    seeds, config = range(1, parser.parse_args().runs + 1), of_the_field(RATE, FAST)
    engine = alone(config)
    for seed in seeds:
        for one in run(seed, engine, config):
            found.append(one)
            came = f"touched at {one.touched:.2f} m/s" if one.touched else f"{one.gap:.2f} m left"
            way = "brake" if one.brakes else "hold "
            ahead = one.share * one.needs
            print(
                f"seed {seed:2}  {way}  {one.speed:.2f} m/s  {one.share:g} = {ahead:.2f} m: {came}",
                flush=True,
            )
    print(json.dumps(figures(found)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
