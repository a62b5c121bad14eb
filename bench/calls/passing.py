"""Drives up to a drum, is held, and drives on by an answer or by hand: is it held again for the same thing?

In virtual time, with the rover's own rules of calls and holds, at several speeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from anytraverse.assessment import Reason
from anytraverse.frame import Frame
from bench.calls.engines import alone, of_the_field
from bench.calls.field import FilmedField
from companion.calls.decisions import Call, CallOpened, Decision, HoldStarted, SetMode
from companion.calls.machine import OperatorCalls
from companion.calls.mode_monitor import ModeReport
from companion.calls.policy import PolicyState
from companion.calls.tracking import resized
from companion.daemon.settings.runtime import call_numbers
from companion.sim.field.render import LABELS
from companion.sim.field.things import World
from companion.vehicle import ardupilot
from companion.wire.ids import Motion, Policy

RATE = 10.0
SPEEDS = (0.5, 1.0, 2.0)
WAYS = ("go", "AUTO while rolling", "AUTO standing", "GUIDED while rolling", "GUIDED standing")
BEFORE_M, AFTER_M, LONGEST_S = 13.0, 10.0, 20.0
"""Metres before the drum at which a run begins; what it drives after the answer, metres or seconds."""
_HOLD, _AUTO, _GUIDED = ardupilot.ROVER.hold_mode, 10, 15
_BRAKES = 2.0
"""m/s2 of the rover in HOLD."""


@dataclass(frozen=True)
class _Approach:
    """One run: a world, a speed in m/s, and a way to drive on."""

    seed: int
    speed: float
    way: str


@dataclass(frozen=True)
class Passed:
    """What followed the answer about the drum.

    asked: whether it was asked about at all. again: it held again. other: holds and calls for something else.
    """

    asked: bool
    again: bool = False
    other: int = 0


class _Drive:
    """A rover that drives up to a drum, in the time of its frames."""

    def __init__(self, job: _Approach) -> None:
        self._job, self._field = job, FilmedField(World(job.seed, ("drum",)))
        config = of_the_field(RATE, job.speed)
        self._engine = alone(config)
        numbers = call_numbers(config, self._engine.settings)
        self._calls = OperatorCalls(numbers, PolicyState(Policy.HOLD), 0.0)
        world = self._field.world
        drum = next(thing for thing in world.things.values() if thing.kind == "drum")
        self._drum = drum.id
        self._drum_at, _ = world.trail.nearest(drum.x, drum.y)
        self._mode, self._now, self._speed, self._travelled, self._frames = _AUTO, 0.0, job.speed, 0.0, 0
        self._wanted: list[int] = []
        self._held_at: float | None = None
        self._asked: str | None = None

    def run(self) -> Passed:
        """Drive until the drum is asked about, drive on, and return what followed."""
        asked, again, other = False, False, 0
        ends_at, ends_m = 300.0, 60.0
        while self._now < ends_at and self._travelled < ends_m:
            about = self._frame()
            if about is not None:
                self._held_at, self._asked = self._now, about
                if asked:
                    again, other = again or about == self._drum, other + (about != self._drum)
            if self._held_at is not None and self._drives_on():
                if self._asked == self._drum and not asked:
                    asked = True
                    ends_at, ends_m = self._now + LONGEST_S, self._travelled + AFTER_M
                self._held_at = None
        return Passed(asked, again, other)

    def _frame(self) -> str | None:
        """Let a frame's time pass. Return what a hold or call that starts is about."""
        self._now = round(self._now + 1 / RATE, 3)
        self._frames += 1
        if self._wanted:
            self._mode = self._wanted.pop(0)
        braked = max(0.0, self._speed - _BRAKES / RATE)
        self._speed = braked if self._mode == _HOLD else self._job.speed
        self._travelled += self._speed / RATE
        trail = self._field.world.trail
        pose = trail.pose(max(trail.start, self._drum_at - BEFORE_M) + self._travelled)
        frame = self._field.frame(pose, self._now, self._travelled)
        report = ModeReport(
            self._mode,
            armed=True,
            travelled=self._travelled,
            reported_at=self._now,
            autopilot=ardupilot.ROVER,
            round_trip=0.02,
            compares=True,
            takes_resume=True,
        )
        decisions = self._calls.vehicle_reported(report, self._now)
        assert frame.image is not None
        seen = self._engine.step(Frame(self._frames, self._now, frame.image), self._now, frame.place)
        decisions += [*self._calls.assessed(seen, self._now), *self._calls.tick(self._now)]
        self._obey(decisions)
        if not any(isinstance(one, HoldStarted | CallOpened) for one in decisions):
            return None
        call = self._calls.call
        thing = self._field.about(call, frame)[0] if call is not None else None
        if call is not None and thing != self._drum and self._shows_a_drum(call):
            return self._drum
        return str(thing or "no thing")

    def _shows_a_drum(self, call: Call) -> bool:
        """Whether the thing that is asked about covers some of a drum, though its tile has only the rim."""
        labels = self._field.labels
        mask = call.thing.mask if call.thing is not None and Reason.UNKNOWN_OBJECT in call.reasons else None
        drum = labels == LABELS.index("drum")
        return mask is not None and bool((resized(mask, *labels.shape) & drum).any())

    def _obey(self, decisions: Sequence[Decision]) -> None:
        self._wanted += [one.mode for one in decisions if isinstance(one, SetMode)]

    def _drives_on(self) -> bool:
        """Answer, or set a mode by hand, where the time for it has come."""
        assert self._held_at is not None
        since, way = self._now - self._held_at, self._job.way
        if self._calls.hold is None or not self._calls.hold.standing:
            return False
        if since < 3.0 and not way.endswith("while rolling"):
            return False
        if way == "go":
            call = self._calls.call
            observation = call.seen.observation if call is not None and call.seen is not None else None
            outcome = self._engine.answer(
                (), self._now, call=observation, call_id=self._calls.current_id, go=True
            )
            self._obey(self._calls.apply_answer(self._calls.current_id, Motion.GO, (), outcome, self._now)[1])
        else:
            self._mode = _AUTO if way.startswith("AUTO") else _GUIDED
        return True


def drive(job: _Approach) -> Passed:
    """Do one run."""
    return _Drive(job).run()


def approaches(seeds: Sequence[int], ways: Sequence[str] = WAYS) -> list[_Approach]:
    """Return all runs: each way at each speed."""
    return [_Approach(seed, speed, way) for seed in seeds for speed in SPEEDS for way in ways]


def figures(jobs: Sequence[_Approach], found: Sequence[Passed]) -> dict[str, Any]:
    """Return the figures as JSON values: after how many of all answers the same thing held again."""
    own = [(job, one) for job, one in zip(jobs, found, strict=True) if one.asked]
    return {
        "held_again": sum(one.again for _, one in own),
        "of": len(own),
        "by_way": {way: sum(one.again for job, one in own if job.way == way) for way in WAYS},
        "held_for_other": sum(one.other > 0 for _, one in own),
        "never_asked": len(found) - len(own),
    }
