"""Which of the autopilot's parameters make a hold unsafe or useless. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from companion.check import ardupilot, px4
from companion.check.finding import Finding, Verdict
from companion.check.rules import FAIL, WARN, Facts, Table

__all__ = ["ARDUPILOT", "NAMES", "PX4", "Facts", "judge", "names", "speed"]

ARDUPILOT, PX4 = 3, 12
"""HEARTBEAT.autopilot."""
NAMES = {0: "", ARDUPILOT: "ArduPilot", PX4: "PX4"}
_TABLES: Mapping[int, Table] = {ARDUPILOT: ardupilot.TABLE, PX4: px4.TABLE}
_NOTHING = Table((), (), (), (), ())


def names(autopilot: int) -> tuple[str, ...]:
    """What to ask for."""
    return _TABLES.get(autopilot, _NOTHING).names


def judge(autopilot: int, facts: Facts, *, holds: bool) -> list[Finding]:
    """What is wrong. holds: whether the policy is hold; where not, nothing is worse than worth knowing."""
    worst = FAIL if holds else WARN
    table = _TABLES.get(autopilot, _NOTHING)
    wrong = [
        Finding(f"{rule.name} {facts.values[rule.name]:g}", min(rule.verdict, worst), rule.text)
        for rule in table.rules
        if rule.name in facts.values and rule.bad(facts.values[rule.name], facts)
    ]
    absent = [
        Finding(f"{needed.name} absent", worst, needed.text)
        for needed in table.needed
        if needed.name not in facts.values and (not needed.other or facts.values.get(needed.other, 0.0))
    ]
    return wrong + absent + _untold(table, facts, worst)


def _untold(table: Table, facts: Facts, worst: Verdict) -> list[Finding]:
    """What every autopilot of this kind has, and this one did not tell: nothing is known of it."""
    return [
        Finding(
            f"{choice[0]} untold",
            min(max(rule.verdict for rule in table.rules if rule.name in choice), worst),
            "no good answer in three tries: check the link, then check again, or read it at the ground",
        )
        for choice in table.always
        if not any(name in facts.values for name in choice)
    ]


def speed(autopilot: int, values: Mapping[str, float]) -> tuple[str, float] | None:
    """Which parameter says how fast the vehicle drives by itself, and its m/s; None where none does."""
    found = ((name, values.get(name, 0.0)) for name in _TABLES.get(autopilot, _NOTHING).speeds)
    return next(((name, value) for name, value in found if value > 0), None)
