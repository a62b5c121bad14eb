"""Plays a human at each step of the hand-over of guiding, in virtual time.

A run without a human says when each step comes; the same run is then played again with a human in it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from bench.modes.guided_rover import COARSE, TICK, Asked, GuidedRover
from bench.modes.judging import HAND, STATION
from bench.virtual_time import Clock, virtual_time
from companion.sim.field.modes import Mode

DELAYS = (0.0, 0.02, 0.05, 0.1)
"""s that the wire takes, each way. Where it takes 0.2 s, the companion gives up taking over."""
AROUND = 0.15
"""s before and after a step in which the human acts."""
BY_MODE = ("MANUAL", "LOITER", "STEERING", "RTL", "HOLD", "AUTO")
COMMANDED, CLICKS = "GUIDED", ("go to a place", "target", "mission item")
"""A mode and targets of a ground station."""
YIELD = ("HOLD by script", "GUIDED by script")
"""Set one after the other, within a cycle."""
MAY_MOVE = 0.5
"""s for which our targets may still move a rover that is in a human's GUIDED."""
TOGETHER = 5
"""Trials for one run without a human."""
_STARTS, _DRIVES, _BLOCKED, _ENDS = 3.0, (3.0, 3.5), (1.0, 2.5), 11.5
"""s until AUTO, from there to a blocked way, for which it is blocked, and the end without a human.

In its first 5 s the script does not guide: somebody may have sent targets.
"""
_WATCHED = 2.6
"""s after the human, in which a request that was refused is made again, and a loss of targets held."""


@dataclass(frozen=True)
class GuidedTrial:
    """What a human does. offset: s by which that comes after the step. at: s of the run.

    first: before what arrives from the companion in that tick.
    """

    step: str
    does: str
    offset: float
    at: float
    first: bool


@dataclass(frozen=True)
class GuidedOutcome:
    """What came out. inside: the mode, and who had set it, in which the human acted.

    changes: modes that were entered then and by no human. ends: the mode that stands. moved: s for which
    targets of ours still moved a rover in a human's GUIDED.
    """

    delay: float
    trial: GuidedTrial
    inside: str
    changes: tuple[str, ...]
    ends: str
    moved: float = 0.0

    @property
    def yielded(self) -> bool:
        """Whether the script entered GUIDED anew for a human, for each target of ours that still came."""
        humans = self.trial.does == COMMANDED or self.trial.does in CLICKS
        times = len(self.changes) // len(YIELD)
        return humans and self.inside.startswith("GUIDED") and times > 0 and self.changes == YIELD * times

    @property
    def overridden(self) -> bool:
        """Whether a mode of ours replaced the human's, or our targets went on moving the rover.

        A target in AUTO sets no mode. The mission goes on, and may be held; GUIDED would now be the human's.
        """
        if self.yielded:
            return self.moved > MAY_MOVE
        in_mission = self.trial.does in CLICKS and self.inside.startswith("AUTO")
        replaced = [one for one in self.changes if not in_mission or one.startswith("GUIDED")]
        return bool(replaced) or self.moved > MAY_MOVE


class _Run:
    """One run from its start. Equal randoms give equal runs, up to where a human acts."""

    def __init__(self, folder: Path, random: Random, delay: float, clock: Clock) -> None:
        self.rover = GuidedRover(folder, clock, random, delay)
        self._begun, self._blocked = clock.now, _STARTS + random.uniform(*_DRIVES)
        self._free = self._blocked + random.uniform(*_BLOCKED)
        self._started = False

    @property
    def now(self) -> float:
        return self.rover.clock.now - self._begun

    def go_on(self, until: float, act: Callable[[], None] | None = None, *, first: bool = False) -> None:
        """Lets time pass. act: happens in the first tick."""
        while self.now < until:
            if self.now >= _STARTS and not self._started:
                self._started = True
                self.rover.start()
            self.rover.eyes.blocked = self._blocked <= self.now < self._free
            early = self.now < self._blocked - 2 * AROUND
            self.rover.step(COARSE if early else TICK, act, first=first)
            act = None

    def steps(self) -> dict[str, float]:
        """When each step came, in s of the run. Raises ValueError where one did not."""
        log, shift = self.rover.autopilot.mode_log, self.now - self.rover.time
        asked = [Asked(one.at - self._begun, one.mode) for one in self.rover.asked]
        guided = [change.t + shift for change in log if change.mode is Mode.GUIDED]
        back = [change.t + shift for change in log if change.mode is Mode.AUTO][1:]
        # GUIDED is asked for again and again while it guides.
        modes = list(dict.fromkeys(one.mode for one in asked))
        if modes != [Mode.GUIDED, Mode.AUTO] or len(guided) != 1 or len(back) != 1:
            raise ValueError(f"it was not guided and given back: {asked}, {list(log)}")
        given_back = next(one.at for one in asked if one.mode == Mode.AUTO)
        return {
            "ready": self._blocked,
            "GUIDED asked for": asked[0].at,
            "GUIDED": guided[0],
            "guides": (guided[0] + given_back) / 2,
            "AUTO asked for": given_back,
            "AUTO": back[0],
        }


def draw(random: Random, steps: dict[str, float]) -> GuidedTrial:
    """Draws a trial. AUTO is set by hand only where it does not stand."""
    step = random.choice(list(steps))
    offset = random.uniform(-AROUND, AROUND)
    at = steps[step] + offset
    doings = [*BY_MODE, COMMANDED, *CLICKS]
    if not steps["GUIDED"] + TICK < at < steps["AUTO"] - TICK:
        doings.remove("AUTO")
    return GuidedTrial(step, random.choice(doings), round(offset, 3), at, random.random() < 0.5)


def play_all(delay: float, number: int, seed: str) -> tuple[list[GuidedOutcome], str]:
    """Plays so many trials of one run; returns what came out, and why it was not guided, "" if it was."""
    try:
        return list(play(delay, number, seed)), ""
    except ValueError as why:
        return [], str(why)


def play(delay: float, number: int, seed: str) -> Iterator[GuidedOutcome]:
    """Plays so many trials of one run. Raises ValueError where it is not guided without a human, either."""
    with TemporaryDirectory(prefix="guided-", ignore_cleanup_errors=True) as folder:
        with virtual_time() as clock:
            run = _Run(Path(folder) / "alone", Random(seed), delay, clock)
            run.go_on(_ENDS)
            steps = run.steps()
            run.rover.close()
        random = Random(f"{seed} trials")
        for trial in range(number):
            yield _play_one(Path(folder) / str(trial), seed, delay, draw(random, steps))


def _play_one(folder: Path, seed: str, delay: float, trial: GuidedTrial) -> GuidedOutcome:
    with virtual_time() as clock:
        run = _Run(folder, Random(seed), delay, clock)
        rover, autopilot = run.rover, run.rover.autopilot
        run.go_on(trial.at - TICK / 2)
        seen: list[Any] = []

        def act() -> None:
            seen[:] = [f"{autopilot.mode.name} by {autopilot.mode_by}", clock.now]
            do(rover, trial.does)
            seen.append(len(autopilot.mode_log))

        run.go_on(run.now + _WATCHED + 2 * delay, act, first=trial.first)
        inside, at, earlier = seen
        changes = [one for one in list(autopilot.mode_log)[earlier:] if one.by not in (HAND, STATION)]
        told = tuple(f"{one.mode.name} by {one.by}" for one in changes)
        ours = inside.startswith("GUIDED") or trial.does == COMMANDED
        moved = max((one - at for one in rover.targets), default=0.0) if ours else 0.0
        rover.close()
        return GuidedOutcome(delay, trial, inside, told, autopilot.mode.name, round(max(moved, 0.0), 3))


def do(rover: GuidedRover, what: str) -> None:
    """Does as a human: sets a mode by hand, or sends as a ground station does."""
    if what in BY_MODE:
        rover.autopilot.set_mode(Mode[what], HAND)
        return
    position = int(mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
    place = (int(mavlink.MAV_CMD_NAV_WAYPOINT), 2, 0, 0.0, 0.0, 0.0, 0.0, 0, 0, 0.0, 0)
    mode = (1.0, float(Mode.GUIDED), 0.0, 0.0, 0.0, 0.0, 0.0)
    messages = {
        COMMANDED: mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, *mode),
        "go to a place": mavlink.MAVLink_command_int_message(
            1, 1, position, mavlink.MAV_CMD_DO_REPOSITION, 0, 0, -1.0, 0.0, 0.0, 0.0, 0, 0, 0.0
        ),
        "target": mavlink.MAVLink_set_position_target_global_int_message(
            0, 1, 1, position, 0xDF8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0
        ),
        "mission item": mavlink.MAVLink_mission_item_int_message(1, 1, 0, position, *place),
    }
    rover.click(messages[what])


def figures(outcomes: Sequence[GuidedOutcome], without: int = 0) -> dict[str, Any]:
    """Sums up. without: runs that were not guided without a human, either."""
    return {
        "trials": len(outcomes),
        "overridden": sum(one.overridden for one in outcomes),
        "yielded": sum(one.yielded for one in outcomes),
        "longest_moved_s": max((one.moved for one in outcomes), default=0.0),
        "not_guided": without,
        "steps": _counted(outcomes, lambda one: one.trial.step),
        "does": _counted(outcomes, lambda one: one.trial.does),
        "inside": _counted(outcomes, lambda one: one.inside),
        "ends": _counted(outcomes, lambda one: one.ends),
        "delays_ms": _counted(outcomes, lambda one: str(round(1000 * one.delay))),
    }


def _counted(
    outcomes: Sequence[GuidedOutcome], key: Callable[[GuidedOutcome], str]
) -> dict[str, dict[str, int]]:
    trials = Counter(map(key, outcomes))
    overridden = Counter(key(one) for one in outcomes if one.overridden)
    return {name: {"trials": trials[name], "overridden": overridden[name]} for name in sorted(trials)}


def line(one: GuidedOutcome) -> str:
    """Formats a trial as a line for a reader."""
    trial = one.trial
    told = f"{1000 * one.delay:3.0f} ms  {trial.step:16} {1000 * trial.offset:+4.0f} ms  {trial.does:13}"
    told += f" inside {one.inside}" + (f"  then {', '.join(one.changes)}" if one.changes else "")
    told += f"  moved {one.moved:.2f} s" if one.moved else ""
    told += "  yielded" if one.yielded else ""
    return told + ("  WRONG" if one.overridden else "")
