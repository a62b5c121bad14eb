"""The attacks send what they say, and their figures tell a broken promise."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import development as mavlink

from bench.attack.__main__ import KINDS, figures
from bench.attack.files import _climbing
from bench.attack.floods import RATES, _datagrams
from bench.attack.identities import _forged
from bench.attack.outcome import MOST_BLIND, MOST_GAP, AttackOutcome
from bench.attack.secrets import FORMS, PASSWORD
from companion.wire.answers import Answer


@pytest.mark.parametrize(
    "broken",
    [
        AttackOutcome(gap=MOST_GAP + 0.01),
        AttackOutcome(blind=MOST_BLIND + 0.01),
        AttackOutcome(gap=math.inf),
        AttackOutcome(reached=["a file"]),
        AttackOutcome(secrets=["a password"]),
    ],
)
def test_a_broken_promise_is_told(broken: AttackOutcome) -> None:
    assert AttackOutcome(gap=MOST_GAP, blind=MOST_BLIND).good
    assert not broken.good
    told = figures({"kept": AttackOutcome(gap=1.0, blind=1.0), "broken": broken})
    assert [told["kinds"][name]["good"] for name in ("kept", "broken")] == [True, False]
    assert told["reached"] == len(broken.reached)
    assert told["secrets"] == len(broken.secrets)
    assert told["worst_heartbeat_gap_s"] == max(1.0, broken.gap)
    assert told["longest_without_judging_s"] == max(1.0, broken.blind)


def test_floods_of_answers_set_words_in_many_names() -> None:
    assert set(RATES) < set(KINDS)
    for name in ("answers", "torrent"):
        messages = [mavlink.MAVLink(None).decode(bytearray(frame)) for frame in _datagrams(name)]
        assert len({(one.get_srcSystem(), one.get_srcComponent()) for one in messages}) > 2000
        answer = Answer.unpack(bytes(messages[7].payload[: messages[7].payload_length]))[0]
        assert len(answer.operations) == 1
    assert len(set(_datagrams("heartbeats"))) > 2000


def test_forged_frames_are_whole_and_bear_no_signature() -> None:
    for frame in _forged(7):
        message = mavlink.MAVLink(None).decode(bytearray(frame))
        assert message.get_type() in ("HEARTBEAT", "COMMAND_LONG", "PARAM_SET")
        assert frame[2] & 1 == 0


def test_paths_climb_and_each_form_has_the_password() -> None:
    assert len(set(_climbing())) > 200
    assert len(FORMS) == len(set(FORMS)) == 25
    assert all(PASSWORD in form for form in FORMS)
