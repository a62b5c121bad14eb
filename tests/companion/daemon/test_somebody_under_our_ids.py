"""Another component 1/191 silences the companion, but does not keep it from stopping the rover."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.wire.ids import Motion
from tests.companion.daemon.rig import AUTO, HOLD, Rig

FOREIGN = mavlink.MAVLink_heartbeat_message(18, 8, 0, 1, 4, 3)


def beside(rig: Rig, seconds: int, thing: str = "") -> None:
    """Somebody else speaks under our ids ten times a second."""
    for _ in range(10 * seconds):
        rig.stage.send(FOREIGN, (1, 191))
        rig.see(0.1, thing)


@pytest.mark.slow
def test_the_rover_is_held_all_the_same_and_nothing_else_is_said(rig: Rig) -> None:
    beside(rig, 1)
    before = len(rig.stage.frames)
    beside(rig, 4, "drum")
    assert rig.stage.mode == HOLD
    said = {frame.message.get_type() for frame in rig.stage.frames[before:]}
    assert said == {"COMMAND_LONG"}
    beside(rig, 30)
    assert rig.stage.mode == HOLD


@pytest.mark.slow
def test_it_is_not_driven_on_before_nobody_else_speaks(held: Rig) -> None:
    held.word(1, "drum", 1.0, Motion.GO)
    held.see(0.3, "drum")
    assert held.calls.go_at is not None
    beside(held, 3)
    assert held.stage.mode == HOLD
    held.see(12)
    held.answer(held.calls.current_id, Motion.GO, transaction=8)
    held.see(2)
    assert held.stage.mode == AUTO
