"""Lists the values of ArduPilot Rover's parameters that make a hold unsafe or useless."""

from __future__ import annotations

from companion.desk.check.rules import (
    DIES,
    FAIL,
    HOME,
    WARN,
    Bad,
    Facts,
    Needed,
    ParameterRule,
    Table,
    above,
    below,
    one_of,
    other_than,
    with_bit,
    without_bits,
)
from companion.vehicle.ardupilot import AUTO, GUIDED

SERIAL_APART, MAV_APART = 1 << 10, 1 << 1
"""Bits of SERIALn_OPTIONS (4.6 and older) and MAVn_OPTIONS (4.7) that keep a port's MAVLink to itself."""
HEAP = 122880
"""Bytes for scripts. In ArduPilot's simulation our script fails with 100352, and works with 101376."""
_SCRIPT = (
    f"set SCR_HEAP_SIZE {HEAP} or more, copy config/ardupilot/anytraverse.lua to APM/scripts on the "
    "autopilot's card, and reboot it"
)
_AUTO, _GUIDED = 1 << AUTO, 1 << GUIDED
_ARMS_ITSELF = (0, 3, 4)
"""Values of ARMING_REQUIRE. With 0 it is always armed, with 3 and 4 (4.7) once its arming checks pass."""
_BOOTS = "after each boot it arms itself and drives off in INITIAL_MODE"
_ALL_CHECKS, _AUX_AUTH = 1 << 0, 1 << 17
"""Bits of ARMING_CHECK (4.6 and older). The second one, with which arming needs the consent of scripts, is
also in ARMING_SKIPCHK (4.7)."""
_BLOCKS_AUTO, _AVOIDS_SENSED = 1 << 7, 1 << 1
"""Bits of FLTMODE_GCSBLOCK and of AVOID_ENABLE."""
_SWITCHES = tuple(f"RC{channel}_OPTION" for channel in range(1, 17))
_SENSORS = tuple(f"PRX{number}_TYPE" for number in range(1, 5))
_OURS = "is the vehicle's own id, so that the companion passes for the ground station: set 255"
_FOREIGN = "that ground station may not answer calls: add it to [link] allowed_senders"
_NOT_ASKED = "scripts are not asked before arming, so that ATS_NEED 1 lets it arm without a companion"
_NOT_FORWARDED = "is passed between this port and the others: where companion or radio are on it, subtract"


def _is_own(value: float, facts: Facts) -> bool:
    return value == facts.system_id


def _is_not_allowed(value: float, facts: Facts) -> bool:
    first, last = facts.allowed
    return value != facts.system_id and not first <= value <= last


def _backs_up(value: float, facts: Facts) -> bool:
    """Whether the vehicle backs up by itself: only with a proximity sensor that is used for avoidance."""
    sensed = any(facts.values.get(name, 0) > 0 for name in _SENSORS)
    return value > 0 and sensed and int(facts.values.get("AVOID_ENABLE", 0)) & 2 != 0


def _is_needed(facts: Facts) -> bool:
    return facts.values.get("ATS_NEED", 0) >= 0.5


def _unchecked(value: float, facts: Facts) -> bool:
    return _is_needed(facts) and int(value) & (_ALL_CHECKS | _AUX_AUTH) == 0


def _skipped(value: float, facts: Facts) -> bool:
    return _is_needed(facts) and int(value) & _AUX_AUTH != 0


def _boots_into_driving(value: float, facts: Facts) -> bool:
    """Whether it arms itself after a boot, in a mode in which it drives by itself."""
    return value in _ARMS_ITSELF and facts.values.get("INITIAL_MODE", 0) in (AUTO, GUIDED)


def _drives_off(value: float, facts: Facts) -> bool:
    return _boots_into_driving(value, facts) and not _is_needed(facts)


def _waits_for_us(value: float, facts: Facts) -> bool:
    return _boots_into_driving(value, facts) and _is_needed(facts)


def _no_switch(value: float, facts: Facts) -> bool:
    return value != 0 and not any(facts.values.get(name) == value for name in _SWITCHES)


def _on_unless(*policies: str) -> Bad:
    return lambda value, facts: value >= 0.5 and facts.policy not in policies


def _in_guide(bad: Bad) -> Bad:
    return lambda value, facts: facts.policy == "guide" and bad(value, facts)


RULES = (
    ParameterRule("MIS_RESTART", other_than(0), FAIL, "after every hold the mission starts over: set 0"),
    ParameterRule("SCR_ENABLE", one_of(0), FAIL, f"{DIES}: set 1, {_SCRIPT}"),
    ParameterRule(
        "SCR_HEAP_SIZE", below(HEAP), WARN, f"may be too little for anytraverse.lua: set {HEAP} or more"
    ),
    ParameterRule("SCR_VM_I_COUNT", below(10000), WARN, "may cut anytraverse.lua short: set 10000"),
    ParameterRule("ATS_ENABLE", one_of(0), FAIL, f"anytraverse.lua is switched off: {DIES}: set 1"),
    ParameterRule(
        "ATS_MODES",
        without_bits(_AUTO | _GUIDED),
        FAIL,
        f"anytraverse.lua does not guard all modes that drive (AUTO {_AUTO}, GUIDED {_GUIDED}): set "
        f"{_AUTO | _GUIDED}",
    ),
    ParameterRule(
        "ATS_RC",
        _no_switch,
        WARN,
        "no RCn_OPTION is that number, so that no switch turns anytraverse.lua off: give one channel this "
        "option (300 to 307), or set 0",
    ),
    ParameterRule("ATS_TIMEOUT", above(3), WARN, "so many seconds it drives on without a companion: set 1.5"),
    ParameterRule("ATS_FAULT", one_of(0), WARN, "a companion that says fault stops nothing: set 1"),
    ParameterRule(
        "ATS_NEED",
        _on_unless("hold", "guide"),
        WARN,
        "a lost companion stops the vehicle and forbids arming in every policy, and [call] policy is not "
        '"hold" or "guide": set 0, or one of these',
    ),
    ParameterRule(
        "ATS_POLICY",
        _on_unless("hold", "guide", "off"),
        WARN,
        "a lost companion stops the vehicle in policy report and shadow too: set 0, or [call] policy "
        '= "hold"',
    ),
    ParameterRule(
        "FLTMODE_GCSBLOCK",
        with_bit(_BLOCKS_AUTO),
        WARN,
        "no ground station can set AUTO again after a hold by anytraverse.lua: subtract 128",
    ),
    ParameterRule(
        "OA_TYPE",
        _in_guide(other_than(0)),
        WARN,
        "the autopilot plans round obstacles, too, in AUTO, where policy guide takes over from it: set 0",
    ),
    ParameterRule(
        "AVOID_ENABLE",
        _in_guide(with_bit(_AVOIDS_SENSED)),
        WARN,
        "the autopilot stops for what its own sensor sees while policy guide drives past it: subtract 2",
    ),
    ParameterRule("ARMING_CHECK", _unchecked, FAIL, f"{_NOT_ASKED}: set 1, or add {_AUX_AUTH}"),
    ParameterRule("ARMING_SKIPCHK", _skipped, FAIL, f"{_NOT_ASKED}: set 0, or leave out {_AUX_AUTH}"),
    ParameterRule(
        "ARMING_REQUIRE",
        _drives_off,
        WARN,
        f"{_BOOTS}, with a companion or without: set 1, or INITIAL_MODE 4, or ATS_NEED 1",
    ),
    ParameterRule(
        "ARMING_REQUIRE",
        _waits_for_us,
        WARN,
        f"{_BOOTS} once a companion runs, which holds it until a go in policy hold alone: set 1 where a "
        "person can arm it",
    ),
    ParameterRule("FS_ACTION", one_of(0), WARN, "a failsafe does nothing: set 2 (hold)"),
    ParameterRule("FS_ACTION", one_of(1, 3, 4), WARN, f"a failsafe {HOME}: set 2 (hold)"),
    ParameterRule(
        "FS_THR_ENABLE", one_of(0), WARN, "the loss of the pilot's transmitter is not noticed: set 1"
    ),
    ParameterRule(
        "FS_THR_ENABLE",
        one_of(2),
        WARN,
        "in AUTO it drives on without the pilot's transmitter, so that nobody there can take over: set 1",
    ),
    ParameterRule("SYSID_MYGCS", _is_own, FAIL, _OURS),
    ParameterRule("SYSID_MYGCS", _is_not_allowed, WARN, _FOREIGN),
    ParameterRule("MAV_GCS_SYSID", _is_own, FAIL, _OURS),
    ParameterRule("MAV_GCS_SYSID", _is_not_allowed, WARN, _FOREIGN),
    ParameterRule(
        "AVOID_BACKUP_SPD", _backs_up, WARN, "near an obstacle it backs up, where no camera looks: set 0"
    ),
    *(
        ParameterRule(f"{port}_OPTIONS", with_bit(bit), WARN, f"nothing {_NOT_FORWARDED} {bit}")
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
    always=(("MIS_RESTART",), ("FS_ACTION",), ("FS_THR_ENABLE",), ("SYSID_MYGCS", "MAV_GCS_SYSID")),
    speeds=("WP_SPEED", "CRUISE_SPEED"),
    also=("AVOID_ENABLE", "INITIAL_MODE", *_SENSORS, *_SWITCHES),
)
