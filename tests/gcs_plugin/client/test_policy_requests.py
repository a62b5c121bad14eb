"""A policy asked for at the ground: until the rover says that it is so, or that it will not be."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from companion.wire.ids import Policy
from gcs_plugin.client import events as ev
from gcs_plugin.client.policy_request import PolicyStatus


@pytest.fixture
def sky(sky: Any) -> Any:
    """Without a call."""
    sky.rover.call = None
    sky.client.ids = 255, 190
    sky.run(1.0)
    return sky


def wish(sky: Any, policy: Policy) -> None:
    sky.client.set_policy(1, policy, sky.now)


def told(sky: Any) -> list[PolicyStatus]:
    return [one.status for one in sky.of(ev.PolicyStatusChanged)]


def lost(_: int) -> bool:
    return True


def carried(_: int) -> bool:
    return False


def test_it_is_asked_for_once_and_is_in_force(sky: Any) -> None:
    wish(sky, Policy.SHADOW)
    sky.run(20.0)
    assert sky.rover.policies_asked == [Policy.SHADOW]
    assert told(sky) == [PolicyStatus.SENT, PolicyStatus.GRANTED]
    assert sky.client.rovers[1].policy is Policy.SHADOW
    assert not sky.client.busy


def test_one_that_is_refused_is_not_asked_for_again(sky: Any) -> None:
    sky.rover.grants = False
    wish(sky, Policy.HOLD)
    sky.run(20.0)
    assert sky.rover.policies_asked == [Policy.HOLD]
    assert told(sky) == [PolicyStatus.SENT, PolicyStatus.REFUSED]


def test_what_is_lost_is_sent_again(sky: Any) -> None:
    sky.lose_down = lost
    wish(sky, Policy.OFF)
    sky.run(2.0)
    assert sky.client.busy
    sky.lose_down = carried
    sky.run(5.0)
    assert sky.rover.policies_asked == [Policy.OFF]
    assert told(sky) == [PolicyStatus.SENT, PolicyStatus.GRANTED]


def test_after_a_minute_without_a_word_it_is_given_up_and_said(sky: Any) -> None:
    sky.lose_down = lost
    wish(sky, Policy.OFF)
    sky.run(61.0)
    assert told(sky) == [PolicyStatus.SENT, PolicyStatus.EXPIRED]
    assert not sky.client.busy


def test_a_rover_that_is_not_heard_is_asked_when_it_is(sky: Any) -> None:
    sky.rover_speaks = False
    sky.run(4.0)
    wish(sky, Policy.REPORT)
    sky.run(2.0)
    assert sky.rover.policies_asked == []
    sky.rover_speaks = True
    sky.run(2.0)
    assert sky.rover.policies_asked == [Policy.REPORT]
    assert told(sky) == [PolicyStatus.WAITING, PolicyStatus.SENT, PolicyStatus.GRANTED]


def test_a_newer_wish_takes_the_place_of_an_older(sky: Any) -> None:
    sky.lose_down = lost
    wish(sky, Policy.HOLD)
    sky.run(2.0)
    wish(sky, Policy.OFF)
    sky.lose_down = carried
    sky.run(20.0)
    assert sky.rover.policies_asked == [Policy.OFF]


@pytest.mark.parametrize("other", [(254, 190), (255, 230)])
def test_what_another_ground_station_is_told_settles_nothing(sky: Any, other: tuple[int, int]) -> None:
    sky.lose_down = lost
    wish(sky, Policy.OFF)
    sky.run(1.0)
    ack = mavlink.MAVLink_command_ack_message(31010, 0, 0, 0, *other)
    sky.hear(sky.rover.companion.frame(ack))
    sky.run(0.2)
    assert told(sky) == [PolicyStatus.SENT]
    assert sky.client.busy
