"""Stands in for autopilot, script and wire: a request for a mode takes its time, and is compared first."""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

from companion.calls.decisions import SetMode
from companion.calls.mode_monitor import ModeAnswer, ModeReport
from companion.sim.field.rover import STANDSTILL, MotorDrive, Rover
from companion.vehicle import ardupilot

QUICKEST, SLOWEST = 0.05, 0.15
"""s from a request until the script has set the mode."""
_DRIVES = {ardupilot.AUTO: MotorDrive.FOLLOW, ardupilot.GUIDED: MotorDrive.STOP}


class ScriptedAutopilot:
    """An armed ArduPilot Rover in AUTO. changes: each mode that it entered, by whom.

    overrides: how often a mode that a human had set was replaced by a request that did not mean it.
    """

    def __init__(self, rover: Rover, random: Random) -> None:
        self.rover, self.mode, self.overrides = rover, ardupilot.AUTO, 0
        self.changes: list[tuple[float, int, str]] = []
        self._random = random
        self._asked: list[tuple[float, SetMode]] = []
        self._by_human = False
        rover.drive = _DRIVES[self.mode]

    def request(self, asked: SetMode) -> None:
        """Take in a request; requests are carried out in their order."""
        due = self.rover.time + self._random.uniform(QUICKEST, SLOWEST)
        self._asked.append((max([due, *(at for at, _ in self._asked)]), asked))

    def by_hand(self, mode: int) -> None:
        """Let a human set a mode."""
        self._enter(mode, "human")
        self._by_human = True

    def step(self) -> Iterator[ModeAnswer]:
        """Carry out what is due, and yield its answers."""
        while self._asked and self._asked[0][0] <= self.rover.time:
            _, asked = self._asked.pop(0)
            if asked.expected not in (None, self.mode, asked.mode):
                yield ModeAnswer(asked.mode, accepted=False, by_hand=True)
                continue
            if self._by_human and asked.expected is None and self.mode != asked.mode:
                self.overrides += 1
            self._enter(asked.mode, "companion")
            yield ModeAnswer(asked.mode, accepted=True)

    def report(self, now: float) -> ModeReport:
        """Return what the companion knows of it."""
        return ModeReport(
            self.mode,
            armed=True,
            travelled=self.rover.distance,
            reported_at=now,
            autopilot=ardupilot.ROVER,
            round_trip=SLOWEST,
            compares=True,
            takes_resume=True,
            stands=self.rover.speed < STANDSTILL,
        )

    def _enter(self, mode: int, by: str) -> None:
        if mode == self.mode:
            return
        self.mode, self._by_human = mode, False
        self.changes.append((self.rover.time, mode, by))
        self.rover.drive = _DRIVES.get(mode, MotorDrive.HOLD)
