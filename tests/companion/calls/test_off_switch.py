"""Off by the remote control and by command: two switches in a row, and what is not known changes nothing."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.calls.policy import OffSwitch, PolicyState, Side
from companion.wire.ids import Policy

ON, MIDDLE, OFF = 1100, 1600, 1900
PULSES = st.one_of(st.none(), st.integers(800, 2200))


def positions(switch: OffSwitch, *pulses: int | None, start: float = 0.0, period: float = 0.2) -> list[bool]:
    """The position after each of these pulses."""
    found = []
    for number, pulse in enumerate(pulses):
        switch.pulse_received(pulse, start + period * number)
        found.append(switch.off)
    return found


@pytest.fixture
def switch() -> OffSwitch:
    return OffSwitch(7, Side.HIGH, 0.0)


def test_three_frames_in_a_row_turn_it_off_and_three_on(switch: OffSwitch) -> None:
    assert positions(switch, OFF, OFF, OFF, ON, ON, ON) == [False, False, True, True, True, False]


def test_one_bad_frame_does_nothing(switch: OffSwitch) -> None:
    assert not any(positions(switch, ON, ON, OFF, ON, OFF, OFF, ON, OFF, None, OFF, OFF, ON))


def test_between_the_two_ends_it_stays_as_it_was(switch: OffSwitch) -> None:
    assert positions(switch, *[OFF] * 3, *[MIDDLE] * 5) == [False, False, *[True] * 6]
    assert positions(OffSwitch(7, Side.HIGH, 0.0), *[MIDDLE] * 5) == [False] * 5


def test_the_low_end_may_be_the_off_one() -> None:
    assert positions(OffSwitch(7, Side.LOW, 0.0), ON, ON, ON, 1400, OFF, OFF, OFF) == [
        False,
        False,
        *[True] * 4,
        False,
    ]


def test_frames_far_apart_are_not_in_a_row(switch: OffSwitch) -> None:
    assert not any(positions(switch, *[OFF] * 6, period=1.5))


def test_a_lost_remote_control_changes_nothing_either_way(switch: OffSwitch) -> None:
    assert not any(positions(switch, ON, ON, ON, *[None] * 50))
    assert all(positions(switch, *[OFF] * 3, *[None] * 50, start=20.0)[2:])


def test_it_counts_as_lost_after_three_seconds_without_a_pulse_that_makes_sense(
    switch: OffSwitch,
) -> None:
    assert (switch.check(3.0), switch.lost) == (False, False)
    assert (switch.check(3.1), switch.lost) == (True, True)
    assert (switch.check(3.2), switch.lost) == (False, True)
    positions(switch, ON, start=5.0)
    assert (switch.check(8.0), switch.lost) == (True, False)
    positions(switch, *[None] * 30, start=5.2)
    assert (switch.check(8.1), switch.lost) == (True, True)


@given(st.lists(PULSES, max_size=40))
def test_it_never_moves_without_three_pulses_in_a_row_on_the_other_side(pulses: list[int | None]) -> None:
    switch = OffSwitch(7, Side.HIGH, 0.0)
    for number, pulse in enumerate(pulses):
        before = switch.off
        if switch.pulse_received(pulse, 0.2 * number):
            newest = pulses[number - 2 : number + 1]
            assert len(newest) == 3
            assert all(one is not None and (one > 1700 if switch.off else one < 1500) for one in newest)
        else:
            assert switch.off is before


def off(switch: OffSwitch) -> OffSwitch:
    positions(switch, OFF, OFF, OFF)
    return switch


def test_the_remote_control_is_stronger_than_a_command(switch: OffSwitch) -> None:
    policy_state = PolicyState(Policy.HOLD, off(switch))
    assert policy_state.in_force is Policy.OFF
    assert policy_state.off_by == "RC7"
    assert not policy_state.request(Policy.HOLD, "255/190")
    assert not policy_state.request(Policy.REPORT, "255/190")
    assert policy_state.in_force is Policy.OFF


def test_switched_on_at_the_remote_control_the_policy_asked_for_counts_again(switch: OffSwitch) -> None:
    policy_state = PolicyState(Policy.HOLD, off(switch))
    positions(switch, ON, ON, ON, start=5.0)
    assert (policy_state.in_force, policy_state.off_by) == (Policy.HOLD, "")


def test_off_by_both_needs_both_to_be_on_again(switch: OffSwitch) -> None:
    policy_state = PolicyState(Policy.HOLD, off(switch))
    assert policy_state.request(Policy.OFF, "255/190")
    positions(switch, ON, ON, ON, start=5.0)
    assert (policy_state.in_force, policy_state.off_by) == (Policy.OFF, "255/190")
    assert policy_state.request(Policy.SHADOW, "255/190")
    assert policy_state.in_force is Policy.SHADOW


def restarted(policy_state: PolicyState, configured: Policy, channel: int | None = 7) -> PolicyState:
    again = PolicyState(configured, None if channel is None else OffSwitch(channel, Side.HIGH, 100.0))
    again.restore(policy_state.saved())
    return again


def test_off_by_command_outlives_a_restart_and_still_says_who(switch: OffSwitch) -> None:
    policy_state = PolicyState(Policy.HOLD, switch)
    policy_state.request(Policy.OFF, "255/190")
    again = restarted(policy_state, Policy.HOLD)
    assert (again.in_force, again.off_by) == (Policy.OFF, "255/190")


def test_off_by_the_remote_control_outlives_a_restart_until_it_is_positions(switch: OffSwitch) -> None:
    again = restarted(PolicyState(Policy.HOLD, off(switch)), Policy.HOLD)
    assert again.off_by == "RC7"
    assert again.switch is not None
    positions(again.switch, ON, ON, ON, start=100.0)
    assert again.in_force is Policy.HOLD


@pytest.mark.parametrize("channel", [None, 8])
def test_a_switch_that_is_configured_no_more_keeps_nothing_off(
    switch: OffSwitch, channel: int | None
) -> None:
    assert restarted(PolicyState(Policy.HOLD, off(switch)), Policy.HOLD, channel).in_force is Policy.HOLD


def test_another_policy_by_command_ends_with_the_restart(switch: OffSwitch) -> None:
    policy_state = PolicyState(Policy.REPORT, switch)
    policy_state.request(Policy.HOLD, "255/190")
    assert restarted(policy_state, Policy.REPORT).in_force is Policy.REPORT


@pytest.mark.parametrize("saved", [None, 3, [], "off", {"off_by": 7, "channel": "x"}, {"off_by": ""}])
def test_nonsense_in_the_journal_switches_nothing(saved: object) -> None:
    policy_state = PolicyState(Policy.REPORT, OffSwitch(7, Side.HIGH, 0.0))
    policy_state.restore(saved)
    assert policy_state.in_force is Policy.REPORT
