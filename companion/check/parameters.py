"""Which of the autopilot's parameters make a hold unsafe or useless: one table for each autopilot. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from companion.check.finding import Finding, Verdict

ARDUPILOT, PX4 = 3, 12
"""HEARTBEAT.autopilot."""
FAIL, WARN = Verdict.FAIL, Verdict.WARN


@dataclass(frozen=True)
class Facts:
    """values: of the parameters that are there. system_id: the vehicle's. allowed: first and last sender.

    offboard: whether a PX4 is held by OFFBOARD.
    """

    values: Mapping[str, float]
    system_id: int = 1
    allowed: tuple[int, int] = (245, 255)
    offboard: bool = False


Bad = Callable[[float, Facts], bool]


class Rule(NamedTuple):
    """A parameter, when it is bad where it is there, how bad, and what to do."""

    name: str
    bad: Bad
    verdict: Verdict
    text: str


class Needed(NamedTuple):
    """A parameter that must be there where `other` is not 0, and what its absence means."""

    name: str
    other: str
    text: str


def _one_of(*bad: float) -> Bad:
    return lambda value, _: value in bad


def _not(*good: float) -> Bad:
    return lambda value, _: value not in good


def _below(least: float) -> Bad:
    return lambda value, _: value < least


def _above(most: float) -> Bad:
    return lambda value, _: value > most


def _without(bits: int) -> Bad:
    return lambda value, _: int(value) & bits != bits


def _ours(value: float, facts: Facts) -> bool:
    return value == facts.system_id


def _foreign(value: float, facts: Facts) -> bool:
    first, last = facts.allowed
    return value != facts.system_id and not first <= value <= last


def _backs_up(value: float, facts: Facts) -> bool:
    return value > 0 and int(facts.values.get("AVOID_ENABLE", 0)) & 2 != 0


def _shut(config: str) -> Bad:
    return lambda value, facts: value == 0 and facts.values.get(config, 1) != 0


def _holding(bad: Bad, *, offboard: bool) -> Bad:
    return lambda value, facts: facts.offboard is offboard and bad(value, facts)


_DIES = "nothing stops the vehicle when the companion dies"
_SCRIPT = "copy config/ardupilot/anytraverse.lua to APM/scripts on the autopilot's card, and reboot it"
_HOME = "drives the vehicle home, and over that the companion never holds"
_OURS = "is the vehicle's own id, so that the companion passes for the ground station: set 255"
_FOREIGN = "that ground station may not answer calls: add it to [link] allowed_senders"
_SHUT = "ground and companion do not hear each other through this port: set 1"

ARDUPILOT_RULES = (
    Rule("MIS_RESTART", _not(0), FAIL, "after every hold the mission starts over: set 0"),
    Rule("SCR_ENABLE", _one_of(0), FAIL, f"{_DIES}: set 1, {_SCRIPT}"),
    Rule("SCR_HEAP_SIZE", _below(44032), WARN, "may be too little for anytraverse.lua: set 44032 or more"),
    Rule("SCR_VM_I_COUNT", _below(10000), WARN, "may cut anytraverse.lua short: set 10000"),
    Rule("ATS_ENABLE", _one_of(0), FAIL, f"anytraverse.lua is switched off: {_DIES}: set 1"),
    Rule("ATS_MODES", _without(1 << 10), FAIL, "anytraverse.lua does not guard AUTO: set 33792"),
    Rule("FS_ACTION", _one_of(0), WARN, "a failsafe does nothing: set 2 (hold)"),
    Rule("FS_ACTION", _one_of(1, 3, 4), WARN, f"a failsafe {_HOME}: set 2 (hold)"),
    Rule("FS_THR_ENABLE", _one_of(0), WARN, "the loss of the pilot's transmitter is not noticed: set 1"),
    Rule("SYSID_MYGCS", _ours, FAIL, _OURS),
    Rule("SYSID_MYGCS", _foreign, WARN, _FOREIGN),
    Rule("MAV_GCS_SYSID", _ours, FAIL, _OURS),
    Rule("MAV_GCS_SYSID", _foreign, WARN, _FOREIGN),
    Rule("AVOID_BACKUP_SPD", _backs_up, WARN, "near an obstacle it backs up, where no camera looks: set 0"),
)
PX4_RULES = (
    Rule("MAV_0_FORWARD", _shut("MAV_0_CONFIG"), WARN, _SHUT),
    Rule("MAV_1_FORWARD", _shut("MAV_1_CONFIG"), WARN, _SHUT),
    Rule(
        "COM_OBL_RC_ACT",
        _holding(_not(5, 6, 7), offboard=True),
        FAIL,
        "a vehicle held by OFFBOARD may drive on when the companion dies: set 5 (hold)",
    ),
    Rule(
        "COM_OBL_RC_ACT",
        _holding(_one_of(3), offboard=False),
        WARN,
        f"the loss of setpoints {_HOME}: set 5 (hold)",
    ),
    Rule("COM_OF_LOSS_T", _above(1), WARN, "lost setpoints are noticed late: set 1 s or less"),
    Rule("NAV_RCL_ACT", _one_of(2), WARN, f"the loss of the transmitter {_HOME}: set 1 (hold)"),
    Rule("NAV_DLL_ACT", _one_of(2), WARN, f"the loss of the ground station {_HOME}: set 1 (hold)"),
)
ARDUPILOT_NEEDED = (
    Needed("SCR_ENABLE", "", f"this firmware runs no scripts: {_DIES}: take a build with scripting"),
    Needed("ATS_ENABLE", "SCR_ENABLE", f"anytraverse.lua does not run: {_DIES}: {_SCRIPT}"),
)
_RULES: Mapping[int, tuple[Rule, ...]] = {ARDUPILOT: ARDUPILOT_RULES, PX4: PX4_RULES}
_NEEDED: Mapping[int, tuple[Needed, ...]] = {ARDUPILOT: ARDUPILOT_NEEDED, PX4: ()}
_ALSO: Mapping[int, tuple[str, ...]] = {
    ARDUPILOT: ("WP_SPEED", "CRUISE_SPEED", "AVOID_ENABLE"),
    PX4: ("RO_SPEED_LIM", "RO_MAX_THR_SPEED", "MAV_0_CONFIG", "MAV_1_CONFIG"),
}
NAMES = {0: "", ARDUPILOT: "ArduPilot", PX4: "PX4"}


def names(autopilot: int) -> tuple[str, ...]:
    """What to ask for."""
    judged = [rule.name for rule in _RULES.get(autopilot, ())]
    needed = [one.name for one in _NEEDED.get(autopilot, ())]
    return tuple(dict.fromkeys((*judged, *needed, *_ALSO.get(autopilot, ()))))


def judge(autopilot: int, facts: Facts, *, holds: bool) -> list[Finding]:
    """What is wrong. holds: whether the policy is hold; where not, nothing is worse than worth knowing."""
    worst = FAIL if holds else WARN
    wrong = [
        Finding(f"{rule.name} {facts.values[rule.name]:g}", min(rule.verdict, worst), rule.text)
        for rule in _RULES.get(autopilot, ())
        if rule.name in facts.values and rule.bad(facts.values[rule.name], facts)
    ]
    absent = [
        Finding(f"{needed.name} absent", worst, needed.text)
        for needed in _NEEDED.get(autopilot, ())
        if needed.name not in facts.values and (not needed.other or facts.values.get(needed.other, 0.0))
    ]
    return wrong + absent


def speed(autopilot: int, values: Mapping[str, float]) -> tuple[str, float] | None:
    """Which parameter says how fast the vehicle drives by itself, and its m/s; None where none does."""
    order = {ARDUPILOT: ("WP_SPEED", "CRUISE_SPEED"), PX4: ("RO_SPEED_LIM", "RO_MAX_THR_SPEED")}
    found = ((name, values.get(name, 0.0)) for name in order.get(autopilot, ()))
    return next(((name, value) for name, value in found if value > 0), None)
