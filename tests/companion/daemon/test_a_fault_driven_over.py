"""A human drives on over a hold for a fault: what the ground and the script on the autopilot are told."""

from __future__ import annotations

import pytest

from companion.wire.ids import State, read_heartbeat_mode
from tests.companion.daemon.rig import AUTO, HOLD, Rig


def told(rig: Rig) -> tuple[State, bool]:
    """State and acceptance in the newest heartbeat."""
    newest = read_heartbeat_mode(rig.stage.sent("HEARTBEAT")[-1].custom_mode)
    return newest.state, newest.fault_accepted


def blind(rig: Rig) -> None:
    """Held for two seconds since no picture comes."""
    rig.see(2.0)
    rig.wait(4.0)
    assert rig.stage.mode == HOLD
    assert told(rig) == (State.FAULT, False)


def test_it_is_told_what_is_accepted_for_how_long_and_when_it_ends(rig: Rig) -> None:
    blind(rig)
    rig.stage.mode = AUTO
    rig.stage.heartbeat(1)
    rig.wait(1.0)
    assert "H1 driven on for 20 s: camera silent" in rig.texts
    assert told(rig) == (State.FAULT, True)
    assert rig.stage.mode == AUTO
    rig.wait(15.0)
    assert "Holds again in 5 s: camera silent" in rig.texts
    assert rig.stage.mode == AUTO
    rig.wait(5.0)
    assert rig.stage.mode == HOLD
    assert told(rig) == (State.FAULT, False)


@pytest.mark.slow
def test_after_three_times_it_is_told_that_only_manual_drives_on(rig: Rig) -> None:
    blind(rig)
    for _ in range(3):
        rig.stage.mode = AUTO
        rig.stage.heartbeat(1)
        rig.wait(24.0)
        assert rig.stage.mode == HOLD
    rig.stage.mode = AUTO
    rig.stage.heartbeat(1)
    rig.wait(1.0)
    assert rig.stage.mode == HOLD
    assert any(text.endswith("accepted too often: drive in MANUAL") for text in rig.texts)


def test_the_ground_reads_the_acceptance_in_the_heartbeat(rig: Rig) -> None:
    from gcs_plugin.client.rovers import TrackedRover

    blind(rig)
    rig.stage.mode = AUTO
    rig.stage.heartbeat(1)
    rig.wait(1.0)
    heard = TrackedRover(1)
    heard.handle_state(rig.stage.sent("HEARTBEAT")[-1].custom_mode, 0.0)
    assert heard.fault_accepted


def test_the_ground_reads_that_the_script_brakes_for_the_hold(rig: Rig) -> None:
    blind(rig)
    assert rig.calls.hold is not None
    for braking, held_by in ((True, "companion brakes"), (False, "companion")):
        rig.calls.hold.braking = braking
        rig.wait(0.5)
        assert read_heartbeat_mode(rig.stage.sent("HEARTBEAT")[-1].custom_mode).braking is braking
        assert rig.daemon.status.figures()["held_by"] == held_by
        assert told(rig) == (State.FAULT, False)
