import itertools
import math
import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import LinkSettings
from companion.link.inbound import ParameterRequest
from companion.sim.loopback_link import LoopbackLink
from companion.wire.answers import Answer
from companion.wire.messages import MESSAGES
from companion.wire.parameters import Parameter, ParameterError, build

GROUND = (255, 190)
FULL = build([f"word {number}" for number in range(24)], {}, {})


def values(stage: LoopbackLink) -> list[tuple[str, float]]:
    return [(m.param_id, round(m.param_value, 4)) for m in stage.sent("PARAM_VALUE")]


def setting(name: str, value: float, *, target: tuple[int, int] = (1, 191), kind: int = 9) -> Any:
    return mavlink.MAVLink_param_set_message(*target, name.encode(), value, kind)


def read(name: str = "", index: int = -1, *, target: tuple[int, int] = (1, 191)) -> Any:
    return mavlink.MAVLink_param_request_read_message(*target, name.encode(), index)


def ask(stage: LoopbackLink, *messages: Any, sender: tuple[int, int] = GROUND) -> list[ParameterRequest]:
    before = len(stage.reported(ParameterRequest))
    for message in messages:
        stage.send(message, sender)
    stage.run(0.5)
    return stage.reported(ParameterRequest)[before:]


@pytest.fixture
def stage() -> LoopbackLink:
    stage = LoopbackLink()
    stage.run(0.1)
    return stage


@pytest.mark.parametrize("target", [(1, 191), (1, 0), (0, 0)])
def test_the_list_is_told_whole_and_in_order(target: tuple[int, int]) -> None:
    stage = LoopbackLink(parameters=FULL)
    stage.run(0.1)
    stage.send(mavlink.MAVLink_param_request_list_message(*target), (42, 1))
    stage.run(5)
    told = stage.sent("PARAM_VALUE")
    assert [m.param_index for m in told] == list(range(44))
    assert {m.param_count for m in told} == {44}
    assert {m.param_type for m in told} == {9}
    assert [m.param_id for m in told] == [entry.name for entry in FULL]


def test_the_list_is_paced_and_keeps_to_its_own_budget() -> None:
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", asked_budget=300.0, burst=300.0), FULL)
    stage.run(0.1)
    stage.send(mavlink.MAVLink_param_request_list_message(1, 191))
    stage.run(10)
    times = [frame.at for frame in stage.frames]
    assert min(b - a for a, b in itertools.pairwise(times)) >= 0.0299
    assert len(stage.sent("PARAM_VALUE")) == 44
    assert stage.times("PARAM_VALUE")[-1] > 2.0


def test_two_askers_at_a_time_cost_one_list_and_a_bit() -> None:
    stage = LoopbackLink(parameters=FULL)
    stage.run(0.1)
    stage.send(mavlink.MAVLink_param_request_list_message(1, 191))
    stage.run(0.3)
    before = len(stage.sent("PARAM_VALUE"))
    stage.send(mavlink.MAVLink_param_request_list_message(1, 191), (254, 1))
    stage.run(5)
    after = [m.param_index for m in stage.sent("PARAM_VALUE")][before:]
    assert sorted(set(after)) == list(range(44))
    assert len(after) <= 46


def test_one_value_is_read_by_name_and_by_index_by_anybody(stage: LoopbackLink) -> None:
    ask(stage, read("AT_W_GRASS"), sender=(42, 1))
    ask(stage, read(index=4, target=(1, 0)), sender=(42, 1))
    assert values(stage) == [("AT_W_GRASS", 1.0), ("AT_POLICY", 0.0)]


def test_an_unknown_name_or_index_is_counted_and_its_asker_told(stage: LoopbackLink) -> None:
    ask(stage, read("WP_RADIUS"), read(index=99), setting("AT_W_GRAVEL_ROADS", 1), sender=(42, 1))
    assert values(stage) == []
    assert stage.link.counters.rejected == {"unknown parameter": 3}
    told = stage.sent("PARAM_ERROR")
    assert [(m.param_id, m.param_index) for m in told] == [
        ("WP_RADIUS", -1),
        ("", 99),
        ("AT_W_GRAVEL_ROAD", -1),
    ]
    assert {(m.target_system, m.target_component, m.error) for m in told} == {(42, 1, 1)}
    assert stage.link.counters.sent["asked"] <= 3 * MESSAGES["no parameter"].bytes


def test_an_unknown_one_asked_of_everybody_or_by_mavlink_1_is_only_counted(stage: LoopbackLink) -> None:
    ask(stage, read("WP_RADIUS", target=(1, 0)), read(index=99, target=(0, 0)))
    stage.mavlink1 = True
    stage.run(12.0, step=0.05)
    ask(stage, read("WP_RADIUS"))
    assert stage.sent("PARAM_ERROR") == []
    assert stage.link.counters.rejected == {"unknown parameter": 3}


def test_whoever_asks_for_the_same_unknown_one_again_and_again_is_told_within_the_budget() -> None:
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", asked_budget=50.0, burst=300.0))
    for _ in range(100):
        stage.send(read("WP_RADIUS"))
        stage.run(0.1)
    assert 5 <= len(stage.sent("PARAM_ERROR")) <= 2 + (300 + 50 * 10) / 33


def test_a_set_is_reported_and_echoed_when_the_daemon_has_applied_it(stage: LoopbackLink) -> None:
    assert ask(stage, setting("AT_W_DRY_BUSH", -0.8)) == [ParameterRequest(GROUND, "AT_W_DRY_BUSH", -0.8)]
    assert values(stage) == []
    stage.link.parameters.set_value("AT_W_DRY_BUSH", -0.8, stage.now)
    stage.run(0.1)
    assert values(stage) == [("AT_W_DRY_BUSH", -0.8)]
    assert stage.link.counters.sent["asked"] == 37


def test_a_value_that_was_not_taken_is_echoed_as_it_stands(stage: LoopbackLink) -> None:
    ask(stage, setting("AT_POLICY", 2))
    stage.link.parameters.set_value("AT_POLICY", 0.0, stage.now)
    stage.run(0.1)
    assert values(stage) == [("AT_POLICY", 0.0)]


def test_a_value_that_changed_by_itself_is_told_to_all_once(stage: LoopbackLink) -> None:
    stage.link.parameters.set_value("AT_W_GRASS", -2.0, stage.now)
    stage.link.parameters.set_value("AT_W_GRASS", -2.0, stage.now)
    stage.run(0.2)
    stage.link.parameters.set_value("AT_W_GRASS", -2.0, stage.now)
    stage.run(0.2)
    assert values(stage) == [("AT_W_GRASS", -2.0)]
    assert stage.link.counters.sent["asked"] == 0


@pytest.mark.parametrize("kind", [1, 6, 9, 10])
def test_a_set_is_taken_whatever_type_it_names(stage: LoopbackLink, kind: int) -> None:
    assert ask(stage, setting("AT_POLICY", 1, kind=kind))[0].value == 1.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("AT_W_GRASS", 1.01),
        ("AT_W_GRASS", -1.5),
        ("AT_W_GRASS", math.nan),
        ("AT_W_GRASS", math.inf),
        ("AT_THR_ROI", -2),
        ("AT_POLICY", 5),
        ("AT_POLICY", 0.5),
        ("AT_THR_ROI", struct.unpack("<f", struct.pack("<i", 1))[0]),
    ],
)
def test_a_value_out_of_range_gets_the_old_value_and_a_text(
    stage: LoopbackLink, name: str, value: float
) -> None:
    assert ask(stage, setting(name, value)) == []
    assert [name for name, _ in values(stage)] == [name]
    assert values(stage)[0][1] in {1.0, 0.3, 0.0}
    assert stage.sent("STATUSTEXT")[0].text.startswith(f"{name} takes ")
    assert stage.link.counters.rejected == {"range": 1}


def test_a_sender_that_may_not_gets_the_old_value_and_is_counted(stage: LoopbackLink) -> None:
    assert ask(stage, setting("AT_W_GRASS", -1.0), sender=(42, 1)) == []
    assert values(stage) == [("AT_W_GRASS", 1.0)]
    assert stage.link.counters.rejected == {"sender": 1}


def test_a_read_only_value_is_kept() -> None:
    stage = LoopbackLink(parameters=[Parameter("AT_VERSION", 1.0, 0.0, 9.0, read_only=True)])
    stage.run(0.1)
    assert ask(stage, setting("AT_VERSION", 2.0)) == []
    assert values(stage) == [("AT_VERSION", 1.0)]
    assert stage.sent("STATUSTEXT")[0].text == "AT_VERSION is read-only: kept"


@pytest.mark.parametrize("target", [(1, 0), (0, 0), (0, 191)])
def test_a_set_for_everyone_is_for_nobody(stage: LoopbackLink, target: tuple[int, int]) -> None:
    assert ask(stage, setting("AT_W_GRASS", 0.5, target=target)) == []
    assert values(stage) == []
    assert stage.link.counters.rejected == {"target": 1}


def test_a_set_meant_for_the_autopilot_passes_by(stage: LoopbackLink) -> None:
    assert ask(stage, setting("AT_W_GRASS", 0.5, target=(1, 1))) == []
    assert stage.link.counters.rejected == {}


def test_the_daemon_cannot_tell_what_is_not_listed(stage: LoopbackLink) -> None:
    with pytest.raises(ParameterError, match="AT_W_MUD"):
        stage.link.parameters.set_value("AT_W_MUD", 1.0, stage.now)
    with pytest.raises(ParameterError, match="out of range"):
        stage.link.parameters.set_value("AT_W_GRASS", math.nan, stage.now)


def test_too_many_parameters_are_refused_at_the_start() -> None:
    with pytest.raises(ParameterError, match="49 parameters, at most 48"):
        LoopbackLink(parameters=[Parameter(f"AT_{number}", 0.0, 0.0, 1.0) for number in range(49)])


def test_an_empty_list_answers_nothing() -> None:
    stage = LoopbackLink(parameters=[])
    stage.run(0.1)
    stage.send(mavlink.MAVLink_param_request_list_message(1, 191))
    stage.run(1)
    assert stage.sent("PARAM_VALUE") == []


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=16), st.floats(width=32), st.integers(0, 255), st.integers(-32768, 32767))
def test_no_parameter_message_ever_raises(name: bytes, value: float, kind: int, index: int) -> None:
    stage = LoopbackLink()
    stage.run(0.02)
    stage.send(mavlink.MAVLink_param_set_message(1, 191, name, value, kind))
    stage.send(mavlink.MAVLink_param_request_read_message(1, 191, name, index))
    stage.run(0.05)


BIT_PATTERNS = st.integers(0, 2**32 - 1).map(lambda bits: struct.unpack("<f", struct.pack("<I", bits))[0])


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(st.sampled_from(FULL), st.floats(width=32) | BIT_PATTERNS | st.integers(-3, 9).map(float))
def test_every_parameter_takes_what_it_may_be_and_echoes_the_old_value_otherwise(
    entry: Parameter, value: float
) -> None:
    stage = LoopbackLink(parameters=FULL)
    stage.run(0.02)
    taken = [*ask(stage, setting(entry.name, value)), *stage.reported(Answer)]
    if not taken:
        assert values(stage) == [(entry.name, round(entry.value, 4))]
    elif isinstance(taken[0], ParameterRequest):
        assert entry.accepts(taken[0].value)
        assert taken[0].value == pytest.approx(value, abs=1e-6)
    else:
        assert 10 * taken[0].target + taken[0].motion == value
