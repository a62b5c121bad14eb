"""Lists the values of PX4's parameters that make a hold unsafe or useless."""

from __future__ import annotations

from companion.desk.check.rules import (
    FAIL,
    HOME,
    WARN,
    Bad,
    ParameterRule,
    Table,
    above,
    below,
    one_of,
    other_than,
    with_bit,
)

INSTANCES = 3
"""Number of PX4's MAVLink instances; radio and companion use two of them."""
_MISSION, _AUTO = 1 << 0, 1 << 1
"""Bits of COM_RCL_EXCEPT."""
_DRIVES_ON = "px4_deadman does not stop a mission when the companion dies"


def _not_forwarding(config: str) -> Bad:
    return lambda value, facts: value == 0 and facts.values.get(config, 1) != 0


def _holding(bad: Bad, *, offboard: bool) -> Bad:
    return lambda value, facts: facts.offboard is offboard and bad(value, facts)


def _guarded(bad: Bad) -> Bad:
    return lambda value, facts: facts.deadman and bad(value, facts)


def _unguarded(bad: Bad) -> Bad:
    return lambda value, facts: not facts.deadman and bad(value, facts)


RULES = (
    *(
        ParameterRule(
            f"MAV_{number}_FORWARD",
            _not_forwarding(f"MAV_{number}_CONFIG"),
            WARN,
            "ground and companion do not hear each other through this port: set 1",
        )
        for number in range(INSTANCES)
    ),
    ParameterRule(
        "COM_OBL_RC_ACT",
        _holding(other_than(5, 6, 7), offboard=True),
        FAIL,
        "a vehicle held by OFFBOARD may drive on when the companion dies: set 5 (hold)",
    ),
    ParameterRule(
        "COM_OBL_RC_ACT",
        _holding(one_of(3), offboard=False),
        WARN,
        f"the loss of setpoints {HOME}: set 5 (hold)",
    ),
    ParameterRule("COM_OF_LOSS_T", above(1), WARN, "lost setpoints are noticed late: set 1 s or less"),
    ParameterRule(
        "NAV_RCL_ACT", _unguarded(one_of(2)), WARN, f"the loss of the transmitter {HOME}: set 1 (hold)"
    ),
    ParameterRule("NAV_RCL_ACT", _guarded(other_than(1)), FAIL, f"{_DRIVES_ON}: set 1 (hold)"),
    ParameterRule(
        "COM_RC_IN_MODE",
        _guarded(other_than(1)),
        FAIL,
        f"{_DRIVES_ON}: set 1 (MAVLink only), with which PX4 ignores the transmitter",
    ),
    ParameterRule(
        "COM_RC_IN_MODE", _unguarded(one_of(1)), WARN, "PX4 ignores the transmitter: set 0 to stop it by that"
    ),
    ParameterRule("COM_RC_LOSS_T", _guarded(above(0.5)), FAIL, "a dead companion is noticed late: set 0.5 s"),
    ParameterRule("COM_RC_LOSS_T", _guarded(below(0.3)), WARN, "two lost messages stop a mission: set 0.5 s"),
    ParameterRule(
        "COM_FAIL_ACT_T", _guarded(other_than(0)), WARN, "px4_deadman was measured without a delay: set 0"
    ),
    ParameterRule("COM_RCL_EXCEPT", _guarded(with_bit(_MISSION)), FAIL, f"{_DRIVES_ON}: subtract 1"),
    ParameterRule(
        "COM_RCL_EXCEPT",
        _guarded(with_bit(_AUTO)),
        WARN,
        "after LOITER or RTL by hand a mission is held once more when it is set: subtract 2",
    ),
    ParameterRule("NAV_DLL_ACT", one_of(2), WARN, f"the loss of the ground station {HOME}: set 1 (hold)"),
)
TABLE = Table(
    RULES,
    needed=(),
    always=(("MAV_0_FORWARD",), ("COM_OBL_RC_ACT",), ("COM_OF_LOSS_T",), ("NAV_RCL_ACT",), ("NAV_DLL_ACT",)),
    speeds=("RO_SPEED_LIM", "RO_MAX_THR_SPEED"),
    for_deadman=(("COM_RC_IN_MODE",), ("COM_RC_LOSS_T",), ("COM_FAIL_ACT_T",), ("COM_RCL_EXCEPT",)),
    also=tuple(f"MAV_{number}_CONFIG" for number in range(INSTANCES)),
)
