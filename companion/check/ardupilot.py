"""ArduPilot Rover's parameters that make a hold unsafe or useless."""

from __future__ import annotations

from companion.check.rules import (
    DIES,
    FAIL,
    HOME,
    WARN,
    Bad,
    Facts,
    Needed,
    Rule,
    Table,
    above,
    below,
    one_of,
    other_than,
    with_bit,
    without_bit,
)

SERIAL_APART, MAV_APART = 1 << 10, 1 << 1
"""Bits of SERIALn_OPTIONS (4.6 and older) and MAVn_OPTIONS (4.7) that keep a port's MAVLink to itself."""
_SCRIPT = "copy config/ardupilot/anytraverse.lua to APM/scripts on the autopilot's card, and reboot it"
_OURS = "is the vehicle's own id, so that the companion passes for the ground station: set 255"
_FOREIGN = "that ground station may not answer calls: add it to [link] allowed_senders"
_APART = "is passed between this port and the others: where companion or radio are on it, subtract"


def _ours(value: float, facts: Facts) -> bool:
    return value == facts.system_id


def _foreign(value: float, facts: Facts) -> bool:
    first, last = facts.allowed
    return value != facts.system_id and not first <= value <= last


def _backs_up(value: float, facts: Facts) -> bool:
    return value > 0 and int(facts.values.get("AVOID_ENABLE", 0)) & 2 != 0


def _needed_in_vain(value: float, facts: Facts) -> bool:
    return value == 0 and facts.values.get("ATS_NEED", 0) >= 0.5


def _on_unless(*policies: str) -> Bad:
    return lambda value, facts: value >= 0.5 and facts.policy not in policies


RULES = (
    Rule("MIS_RESTART", other_than(0), FAIL, "after every hold the mission starts over: set 0"),
    Rule("SCR_ENABLE", one_of(0), FAIL, f"{DIES}: set 1, {_SCRIPT}"),
    Rule("SCR_HEAP_SIZE", below(44032), WARN, "may be too little for anytraverse.lua: set 44032 or more"),
    Rule("SCR_VM_I_COUNT", below(10000), WARN, "may cut anytraverse.lua short: set 10000"),
    Rule("ATS_ENABLE", one_of(0), FAIL, f"anytraverse.lua is switched off: {DIES}: set 1"),
    Rule("ATS_MODES", without_bit(1 << 10), FAIL, "anytraverse.lua does not guard AUTO: set 33792"),
    Rule("ATS_TIMEOUT", above(3), WARN, "so many seconds it drives on without a companion: set 1.5"),
    Rule("ATS_FAULT", one_of(0), WARN, "a companion that says fault stops nothing: set 1"),
    Rule(
        "ATS_NEED",
        _on_unless("hold"),
        WARN,
        "a lost companion stops the vehicle and forbids arming in every policy, and [call] policy is not "
        '"hold": set 0, or that policy',
    ),
    Rule(
        "ATS_POLICY",
        _on_unless("hold", "off"),
        WARN,
        "a lost companion stops the vehicle in policy report and shadow too: set 0, or [call] policy "
        '= "hold"',
    ),
    Rule("ARMING_CHECK", _needed_in_vain, WARN, "no checks before arming, so ATS_NEED forbids none: set 1"),
    Rule("FS_ACTION", one_of(0), WARN, "a failsafe does nothing: set 2 (hold)"),
    Rule("FS_ACTION", one_of(1, 3, 4), WARN, f"a failsafe {HOME}: set 2 (hold)"),
    Rule("FS_THR_ENABLE", one_of(0), WARN, "the loss of the pilot's transmitter is not noticed: set 1"),
    Rule("SYSID_MYGCS", _ours, FAIL, _OURS),
    Rule("SYSID_MYGCS", _foreign, WARN, _FOREIGN),
    Rule("MAV_GCS_SYSID", _ours, FAIL, _OURS),
    Rule("MAV_GCS_SYSID", _foreign, WARN, _FOREIGN),
    Rule("AVOID_BACKUP_SPD", _backs_up, WARN, "near an obstacle it backs up, where no camera looks: set 0"),
    *(
        Rule(f"{port}_OPTIONS", with_bit(bit), WARN, f"nothing {_APART} {bit}")
        for bit, ports in (
            (SERIAL_APART, [f"SERIAL{number}" for number in range(1, 7)]),
            (MAV_APART, [f"MAV{number}" for number in range(1, 7)]),
        )
        for port in ports
    ),
)
TABLE = Table(
    RULES,
    needed=(
        Needed(
            "SCR_ENABLE",
            "",
            f"this firmware runs no scripts, unless the answer was lost: {DIES}: take one that does",
        ),
        Needed("ATS_ENABLE", "SCR_ENABLE", f"anytraverse.lua does not run: {DIES}: {_SCRIPT}"),
    ),
    always=(
        ("MIS_RESTART",),
        ("FS_ACTION",),
        ("FS_THR_ENABLE",),
        ("SYSID_MYGCS", "MAV_GCS_SYSID"),
    ),
    speeds=("WP_SPEED", "CRUISE_SPEED"),
    also=("AVOID_ENABLE",),
)
