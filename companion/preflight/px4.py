"""Lists the values of PX4's parameters that make a hold unsafe or useless."""

from __future__ import annotations

from companion.preflight.rules import FAIL, HOME, WARN, Bad, Rule, Table, above, one_of, other_than

INSTANCES = 3
"""Number of PX4's MAVLink instances; radio and companion use two of them."""


def _not_forwarding(config: str) -> Bad:
    return lambda value, facts: value == 0 and facts.values.get(config, 1) != 0


def _holding(bad: Bad, *, offboard: bool) -> Bad:
    return lambda value, facts: facts.offboard is offboard and bad(value, facts)


RULES = (
    *(
        Rule(
            f"MAV_{number}_FORWARD",
            _not_forwarding(f"MAV_{number}_CONFIG"),
            WARN,
            "ground and companion do not hear each other through this port: set 1",
        )
        for number in range(INSTANCES)
    ),
    Rule(
        "COM_OBL_RC_ACT",
        _holding(other_than(5, 6, 7), offboard=True),
        FAIL,
        "a vehicle held by OFFBOARD may drive on when the companion dies: set 5 (hold)",
    ),
    Rule(
        "COM_OBL_RC_ACT",
        _holding(one_of(3), offboard=False),
        WARN,
        f"the loss of setpoints {HOME}: set 5 (hold)",
    ),
    Rule("COM_OF_LOSS_T", above(1), WARN, "lost setpoints are noticed late: set 1 s or less"),
    Rule("NAV_RCL_ACT", one_of(2), WARN, f"the loss of the transmitter {HOME}: set 1 (hold)"),
    Rule("NAV_DLL_ACT", one_of(2), WARN, f"the loss of the ground station {HOME}: set 1 (hold)"),
)
TABLE = Table(
    RULES,
    needed=(),
    always=(("MAV_0_FORWARD",), ("COM_OBL_RC_ACT",), ("COM_OF_LOSS_T",), ("NAV_RCL_ACT",), ("NAV_DLL_ACT",)),
    speeds=("RO_SPEED_LIM", "RO_MAX_THR_SPEED"),
    also=tuple(f"MAV_{number}_CONFIG" for number in range(INSTANCES)),
)
