"""What an operator reads of shadow policy's counts."""

from __future__ import annotations

from companion.wire.ids import Policy, State, heartbeat_mode
from gcs_plugin.client.rovers import TrackedRover
from gcs_plugin.terminal.wording import shadow, status_lines


def test_the_status_sums_up_what_shadow_policy_would_have_held() -> None:
    rover = TrackedRover(1)
    told = {
        "AT_SHD_HOLDS": 7,
        "AT_SHD_HOURS": 3.2,
        "AT_SHD_OBJECT": 5,
        "AT_SHD_BLOCKED": 2,
        "AT_SHD_FAULT": 0,
    }
    for name, value in told.items():
        rover.handle_parameter(name, value)
    assert shadow(rover) == "7 would-be holds in 3.2 h, 2.2 an hour (unknown object 5, blocked 2)"
    assert f"  shadow   {shadow(rover)}" in status_lines(rover, 0.0)


def test_nothing_counted_yet_has_no_rate_and_no_line() -> None:
    rover = TrackedRover(1)
    rover.handle_parameter("AT_SHD_HOLDS", 0.0)
    rover.handle_parameter("AT_SHD_HOURS", 0.0)
    assert shadow(rover) == "0 would-be holds in 0.0 h"
    assert not any("shadow" in line for line in status_lines(rover, 0.0))


def test_the_policy_is_known_from_the_heartbeat_alone() -> None:
    rover = TrackedRover(1)
    assert not any("policy" in line for line in status_lines(rover, 0.0))
    rover.handle_state(heartbeat_mode(State.OK, 0, Policy.SHADOW), 0.0)
    assert "  policy   shadow" in status_lines(rover, 0.0)


def test_the_status_says_that_the_script_brakes_for_the_hold() -> None:
    rover = TrackedRover(1)
    rover.handle_state(heartbeat_mode(State.FAULT, 7, Policy.HOLD, braking=True), 0.0)
    assert any("brakes first" in line for line in status_lines(rover, 0.0))
    rover.handle_state(heartbeat_mode(State.FAULT, 7, Policy.HOLD), 0.0)
    assert not any("brakes first" in line for line in status_lines(rover, 0.0))


def test_the_status_says_that_the_companion_drives_round_something() -> None:
    rover = TrackedRover(1)
    rover.handle_state(heartbeat_mode(State.OK, 0, Policy.GUIDE, guiding=True), 0.0)
    lines = status_lines(rover, 0.0)
    assert "  policy   guide" in lines
    assert any(line.startswith("  guiding  ") for line in lines)
    rover.handle_state(heartbeat_mode(State.OK, 0, Policy.GUIDE), 0.0)
    assert not any("guiding" in line for line in status_lines(rover, 0.0))


def test_the_status_says_that_a_human_drives_on_in_spite_of_the_fault() -> None:
    rover = TrackedRover(1)
    rover.handle_state(heartbeat_mode(State.FAULT, 0, Policy.HOLD), 0.0)
    assert not any("driven on by hand" in line for line in status_lines(rover, 0.0))
    rover.handle_state(heartbeat_mode(State.FAULT, 0, Policy.HOLD, fault_accepted=True), 0.0)
    assert any("driven on by hand" in line for line in status_lines(rover, 0.0))
