"""A policy asked for at the ground: until the rover says that it is so, or that it will not be."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from companion.wire.ids import Policy
from gcs_plugin.client import events as ev
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.client.delivery import PolicyStatus


class Sky:
    """A client and a tiny rover; what is down is lost on its way there, or back."""

    def __init__(self, rover: Any, ground: Any) -> None:
        self.rover, self.ground = rover, ground
        self.client = OperatorClient()
        self.client.ids = 255, 190
        self.now = 0.0
        self.down = self.up = True
        self.told: list[PolicyStatus] = []

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 10)):
            self.now += 0.1
            frames = list(self.rover.speak()) if self.up else []
            for message in self.client.outgoing(self.now):
                replies = self.rover.hear(self.ground.frame(message)) if self.down else []
                frames += replies if self.up else []
            for message in self.ground.parse(b"".join(frames)):
                self.client.receive(message, self.now)
            self.told += [
                one.status for one in self.client.events() if isinstance(one, ev.PolicyStatusChanged)
            ]

    def wish(self, policy: Policy) -> None:
        self.client.set_policy(1, policy, self.now)


@pytest.fixture
def sky(tiny_rover: Callable[..., Any], speaker: Callable[..., Any]) -> Sky:
    made = Sky(tiny_rover(1, None), speaker(255, 190))
    made.run(1.0)
    return made


def test_it_is_asked_for_once_and_is_in_force(sky: Sky) -> None:
    sky.wish(Policy.SHADOW)
    sky.run(20.0)
    assert sky.rover.policies_asked == [Policy.SHADOW]
    assert sky.told == [PolicyStatus.SENT, PolicyStatus.GRANTED]
    assert sky.client.rovers[1].policy is Policy.SHADOW
    assert not sky.client.busy


def test_one_that_is_refused_is_not_asked_for_again(sky: Sky) -> None:
    sky.rover.grants = False
    sky.wish(Policy.HOLD)
    sky.run(20.0)
    assert sky.rover.policies_asked == [Policy.HOLD]
    assert sky.told == [PolicyStatus.SENT, PolicyStatus.REFUSED]


def test_what_is_lost_is_sent_again(sky: Sky) -> None:
    sky.down = False
    sky.wish(Policy.OFF)
    sky.run(2.0)
    assert sky.client.busy
    sky.down = True
    sky.run(5.0)
    assert sky.rover.policies_asked == [Policy.OFF]
    assert sky.told == [PolicyStatus.SENT, PolicyStatus.GRANTED]


def test_after_a_minute_without_a_word_it_is_given_up_and_said(sky: Sky) -> None:
    sky.down = False
    sky.wish(Policy.OFF)
    sky.run(61.0)
    assert sky.told == [PolicyStatus.SENT, PolicyStatus.EXPIRED]
    assert not sky.client.busy


def test_a_rover_that_is_not_heard_is_asked_when_it_is(sky: Sky) -> None:
    sky.up = False
    sky.run(4.0)
    sky.wish(Policy.REPORT)
    sky.run(2.0)
    assert sky.rover.policies_asked == []
    sky.up = True
    sky.run(2.0)
    assert sky.rover.policies_asked == [Policy.REPORT]
    assert sky.told == [PolicyStatus.WAITING, PolicyStatus.SENT, PolicyStatus.GRANTED]


def test_a_newer_wish_takes_the_place_of_an_older(sky: Sky) -> None:
    sky.down = False
    sky.wish(Policy.HOLD)
    sky.run(2.0)
    sky.wish(Policy.OFF)
    sky.down = True
    sky.run(20.0)
    assert sky.rover.policies_asked == [Policy.OFF]


@pytest.mark.parametrize("other", [(254, 190), (255, 230)])
def test_what_another_ground_station_is_told_settles_nothing(sky: Sky, other: tuple[int, int]) -> None:
    sky.down = False
    sky.wish(Policy.OFF)
    sky.run(1.0)
    ack = mavlink.MAVLink_command_ack_message(31010, 0, 0, 0, *other)
    for message in sky.ground.parse(sky.rover.companion.frame(ack)):
        sky.client.receive(message, sky.now)
    sky.run(0.2)
    assert sky.told == [PolicyStatus.SENT]
    assert sky.client.busy
