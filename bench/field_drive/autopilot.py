"""Stands in for autopilot, script and wire: a request for a mode takes its time, and is compared first.

Out of AUTO, and out of the GUIDED in which the companion drives, the script brakes before it sets HOLD. What
the companion drives by is obeyed at once, and where it does not come for `GUIDE_LOST` s the script stops.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from random import Random

from companion.calls.decisions import SetMode
from companion.calls.mode_monitor import ModeAnswer, ModeReport
from companion.guide.rules import GuideAnswer
from companion.sim.field.rover import STANDSTILL, MotorDrive, Rover
from companion.vehicle import ardupilot
from companion.vehicle.state import Mission, MissionState

QUICKEST, SLOWEST = 0.05, 0.15
"""s from a request until the script has set the mode."""
BRAKED = 0.1
"""m/s below which the script ends its brake in HOLD."""
GUIDE_LOST = 0.7
APART = 4.0
"""m of the trail from one waypoint of the mission to the next."""


class ScriptedAutopilot:
    """An armed ArduPilot Rover in AUTO, with the script.

    brake: s for which it may brake before HOLD. item: the mission's current one; the first is 1. takeovers:
    how often the companion took over from AUTO. overrides: modes of a human that a request replaced.
    """

    def __init__(self, rover: Rover, random: Random, brake: float) -> None:
        self.rover, self.brake = rover, brake
        self.mode, self.item = ardupilot.AUTO, 1
        self.takeovers = self.overrides = 0
        self._random = random
        self._asked: deque[tuple[float, SetMode, bool]] = deque()
        self._shown: deque[int] = deque()
        self._by_human = self._guided = False
        self._brakes_until: float | None = None
        self._brakes_for = 0
        """The hold that asked for the brake, 0: the script itself."""
        self._target_at = -math.inf
        self._drive()

    def request(self, asked: SetMode, *, guide: bool = False) -> None:
        """Take in a request; they are carried out in their order. guide: it is to drive round something."""
        due = self.rover.time + self._random.uniform(QUICKEST, SLOWEST)
        self._asked.append((max([due, *(one[0] for one in self._asked)]), asked, guide))

    def target(self, target: tuple[float, float] | None) -> None:
        """Take in m/s and degrees/s counter-clockwise; None: nothing comes."""
        if target is None or self.mode != ardupilot.GUIDED or self._brakes_until is not None:
            return
        self.rover.target = target[0], math.radians(target[1])
        self._target_at = self.rover.time
        self._drive()

    def by_hand(self, mode: int) -> None:
        """Let a human set a mode."""
        self._enter(mode)
        self._by_human = True

    def step(self) -> Iterator[ModeAnswer | GuideAnswer]:
        """Carry out what is due, and yield its answers."""
        now = self.rover.time
        while self.mode == ardupilot.AUTO and self.rover.progress >= APART * self.item:
            self.item += 1
        while self._asked and self._asked[0][0] <= now:
            _, asked, guide = self._asked.popleft()
            yield self._guide(asked) if guide else self._hold_or_resume(asked)
        braked = self.rover.speed < BRAKED
        if self._brakes_until is not None and (braked or now >= self._brakes_until):
            asked_by = self._brakes_for
            self._enter(ardupilot.HOLD)
            if asked_by:
                yield ModeAnswer(ardupilot.HOLD, accepted=True)
        elif self._guided and self._brakes_until is None and now - self._target_at > GUIDE_LOST:
            self._brake(0)

    def report(self, now: float) -> ModeReport:
        """Return what the companion hears of it now: of two changes the earlier one first."""
        return ModeReport(
            self._shown.popleft() if self._shown else self.mode,
            armed=True,
            travelled=self.rover.distance,
            reported_at=now,
            autopilot=ardupilot.ROVER,
            round_trip=SLOWEST,
            compares=True,
            takes_resume=True,
            mission=self.mission(now),
            stands=self.rover.speed < STANDSTILL,
            brake=self.brake,
        )

    def mission(self, now: float) -> Mission:
        """Return the report of the mission."""
        drives = self.mode == ardupilot.AUTO
        return Mission(self.item, None, MissionState.ACTIVE if drives else MissionState.NOT_STARTED, 1, now)

    def _hold_or_resume(self, asked: SetMode) -> ModeAnswer:
        if self._brakes_until is not None and asked.mode == ardupilot.HOLD:
            self._brakes_for = asked.hold
            return ModeAnswer(asked.mode, accepted=True, brakes_out_of=ardupilot.AUTO)
        if asked.expected not in (None, self.mode):
            accepted = self.mode == asked.mode and not self._by_human
            return ModeAnswer(asked.mode, accepted=accepted, by_hand=not accepted)
        self.overrides += self._by_human and asked.expected is None
        if (
            asked.mode != ardupilot.HOLD
            or not self.brake
            or not (self.mode == ardupilot.AUTO or self._guided)
        ):
            self._enter(asked.mode)
            return ModeAnswer(asked.mode, accepted=True)
        self._brake(asked.hold)
        return ModeAnswer(asked.mode, accepted=True, brakes_out_of=ardupilot.AUTO)

    def _guide(self, asked: SetMode) -> GuideAnswer:
        taking = asked.mode == ardupilot.GUIDED
        if asked.mode == asked.expected or (taking and self._guided):  # it asks whether it still guides
            return GuideAnswer(asked.mode, done=self._guided or None)
        if asked.mode == self.mode and not taking and not self._by_human:  # it was done before
            return GuideAnswer(asked.mode, done=True)
        ours = self._guided or (taking and not self._by_human)
        if self.mode != asked.expected or self._brakes_until is not None or not ours:
            return GuideAnswer(asked.mode, None)
        self._enter(asked.mode)
        if taking:
            self._guided, self._target_at = True, self.rover.time
            self.takeovers += 1
        return GuideAnswer(asked.mode, done=True)

    def _brake(self, hold: int) -> None:
        if self.mode == ardupilot.GUIDED:  # only a GUIDED that is entered anew brakes
            self._enter(ardupilot.HOLD)
        self._enter(ardupilot.GUIDED)
        self._brakes_until, self._brakes_for = self.rover.time + self.brake, hold

    def _enter(self, mode: int) -> None:
        self.rover.target, self._brakes_until = None, None
        self._by_human = self._guided = False
        if mode != self.mode:
            self._shown.append(mode)
        self.mode = mode
        self._drive()

    def _drive(self) -> None:
        guided = MotorDrive.STOP if self.rover.target is None else MotorDrive.TARGET
        drives = {ardupilot.AUTO: MotorDrive.FOLLOW, ardupilot.GUIDED: guided}
        self.rover.drive = drives.get(self.mode, MotorDrive.HOLD)
