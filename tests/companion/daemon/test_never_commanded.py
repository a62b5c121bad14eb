"""In report, shadow and off policy nothing that moves or stops the vehicle leaves, whatever comes in.

On real frames: everything that the companion sends is decoded, and what is meant for the autopilot may only
ask for messages.
"""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import SetWord
from companion.wire.ids import MODE_REQUEST_COMMAND, Motion, Policy
from tests.companion.daemon.rig import AUTO, HOLD, MANUAL, MakeRig, Rig

GUIDED, RTL = 15, 11
MAY_BE_SENT = {
    "HEARTBEAT",
    "STATUSTEXT",
    "TUNNEL",
    "PARAM_VALUE",
    "NAMED_VALUE_FLOAT",
    "COMMAND_ACK",
    "ONBOARD_COMPUTER_STATUS",
}
MAY_BE_ASKED = {mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_CMD_REQUEST_MESSAGE}
"""Every other command, and every other message, is a command to the vehicle."""

STEPS = st.one_of(
    st.tuples(st.just("see"), st.sampled_from(["", "drum", "rock"]), st.sampled_from([0, 60])),
    st.tuples(st.just("blind"), st.sampled_from([0.5, 2.5, 6.0])),
    st.tuples(st.just("mode"), st.sampled_from([AUTO, AUTO, GUIDED, HOLD, MANUAL, RTL]), st.booleans()),
    st.tuples(st.just("answer"), st.sampled_from(list(Motion)), st.sampled_from([-1.0, 1.0, None])),
    st.tuples(st.just("switch"), st.sampled_from([1100, 1900, 0])),
    st.tuples(st.just("policy"), st.sampled_from([Policy.REPORT, Policy.SHADOW, Policy.OFF])),
    st.tuples(
        st.just("kill"),
    ),
)


def take(rig: Rig, step: tuple[Any, ...]) -> None:
    match step:
        case ("see", thing, scene):
            rig.see(0.8, thing, scene=scene)
        case ("blind", seconds):
            rig.wait(seconds)
        case ("mode", mode, armed):
            rig.stage.mode, rig.stage.armed = mode, armed
            rig.stage.heartbeat(1)
            rig.see(0.2)
        case ("answer", motion, weight):
            words = () if weight is None else (SetWord("drum", weight),)
            rig.answer(rig.calls.current_id, motion, *words, transaction=1 + rig.frame_id)
            rig.see(0.3, "drum")
        case ("switch", pulse):
            rig.switch = pulse
            rig.see(1.0, "drum")
        case ("policy", policy):
            rig.set("AT_POLICY", float(policy))
            rig.see(0.3, "drum")
        case ("kill",):
            assert_never_commanded(rig)
            rig.restart()


def assert_never_commanded(rig: Rig) -> None:
    for frame in rig.stage.frames:
        kind = frame.message.get_type()
        if kind in ("COMMAND_LONG", "COMMAND_INT"):
            question = frame.message.command == MODE_REQUEST_COMMAND and frame.message.param1 == 0
            assert question or frame.message.command in MAY_BE_ASKED, frame.message
        else:
            assert kind in MAY_BE_SENT, frame.message


@pytest.mark.slow
@pytest.mark.parametrize("policy", [Policy.REPORT, Policy.SHADOW])
@settings(
    max_examples=12,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(steps=st.lists(STEPS, min_size=3, max_size=8))
def test_a_rover_that_is_not_to_be_held_is_never_commanded(
    make_rig: MakeRig, policy: Policy, steps: list[tuple[Any, ...]]
) -> None:
    rig = make_rig(policy, switch=1100)
    for step in steps:
        take(rig, step)
    assert_never_commanded(rig)
    rig.kill()
    for file in rig.folder.iterdir():
        if file.is_file():
            file.unlink()


def test_what_is_looked_for_is_found_where_holding_is_allowed(rig: Rig) -> None:
    rig.see(2.0, "drum")
    with pytest.raises(AssertionError):
        assert_never_commanded(rig)
