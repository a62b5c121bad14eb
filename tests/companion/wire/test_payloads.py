import contextlib
import struct
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.operations import ForgetCall, ForgetWord, NewEpisode, OtherPlace, SetWord, Tap
from companion.wire.answers import (
    Acknowledgement,
    Answer,
    AnyOperation,
    CancelIncident,
    PackIncident,
    RecordingWish,
    Wish,
)
from companion.wire.call_report import CallReport
from companion.wire.ids import (
    HeartbeatMode,
    Kind,
    Motion,
    Outcome,
    Policy,
    Reasons,
    Result,
    Stage,
    State,
    heartbeat_mode,
    read_heartbeat_mode,
    words_hash,
)
from companion.wire.packing import Fractions, PayloadError, shortened
from companion.wire.payloads import Summary

U16 = st.integers(0, 0xFFFF)
U32 = st.integers(0, 0xFFFFFFFF)
SHARE = st.none() | st.integers(0, 10_000).map(lambda raw: raw / 10_000)
SIGNED = st.integers(-10_000, 10_000).map(lambda raw: raw / 10_000)
WORD = st.text(max_size=8)


@st.composite
def boxes(draw: st.DrawFn) -> Fractions:
    left, right = sorted(draw(st.lists(st.integers(0, 10_000), min_size=2, max_size=2, unique=True)))
    top, bottom = sorted(draw(st.lists(st.integers(0, 10_000), min_size=2, max_size=2, unique=True)))
    return left / 10_000, top / 10_000, right / 10_000, bottom / 10_000


REASONS = st.integers(0, 15).map(Reasons)
SUMMARIES = st.builds(
    Summary,
    state=st.sampled_from(State),
    policy=st.sampled_from(Policy),
    reasons=REASONS,
    sequence=U16,
    current_id=U16,
    frame_id=U32,
    frame_age_ms=U16,
    latency_ms=U16,
    roi_traversability=SHARE,
    roi_uncertainty=SHARE,
    worst_tile=SHARE,
    similarity=st.none() | SIGNED,
    field_of_view=st.integers(0, 255),
    words=U32,
    dropped=U16,
    sectors=st.tuples(*[st.none() | st.integers(0, 200).map(lambda raw: raw / 200)] * 16),
)
CALLS = st.builds(
    CallReport,
    id=U16,
    kind=st.sampled_from(Kind),
    stage=st.sampled_from(Stage),
    outcome=st.sampled_from(Outcome),
    reasons=REASONS,
    holding=st.booleans(),
    test=st.booleans(),
    frame_id=U32,
    age_s=U16,
    roi=st.none() | boxes(),
    worst_tile_box=st.none() | boxes(),
    roi_uncertainty=SHARE,
    worst_tile=SHARE,
    drivable_share=SHARE,
    similarity=st.none() | SIGNED,
    latitude=st.none() | st.integers(-900_000_000, 900_000_000).map(lambda raw: raw / 1e7),
    longitude=st.none() | st.integers(-1_800_000_000, 1_800_000_000).map(lambda raw: raw / 1e7),
    heading=st.none() | st.integers(0, 35_999).map(lambda raw: raw / 100),
    word_count=st.integers(0, 255),
    words=U32,
    picture=st.text(max_size=15),
)
OPERATIONS: st.SearchStrategy[AnyOperation] = st.one_of(
    st.builds(SetWord, WORD, SIGNED),
    st.builds(Tap, U32, boxes(), WORD, SIGNED),
    st.builds(ForgetWord, WORD),
    st.builds(ForgetCall, U16),
    st.just(NewEpisode()),
    st.builds(OtherPlace, U16),
    st.builds(PackIncident, U16),
    st.builds(CancelIncident, U16),
    st.builds(RecordingWish, U32, st.sampled_from(Wish)),
)
ANSWERS = st.builds(
    Answer,
    transaction=st.integers(1, 0xFFFFFFFF),
    target=U16,
    motion=st.sampled_from(Motion),
    operations=st.lists(OPERATIONS, max_size=2).map(tuple),
)
ACKNOWLEDGEMENTS = st.builds(
    Acknowledgement,
    transaction=U32,
    target=U16,
    result=st.sampled_from(Result),
    stage=st.sampled_from(Stage),
    outcome=st.sampled_from(Outcome),
    roi_uncertainty=SHARE,
    worst_tile=SHARE,
    reasons=REASONS,
    words=U32,
    text=st.text(max_size=22),
)
Message = Summary | CallReport | Answer | Acknowledgement
KINDS: list[type[Message]] = [Summary, CallReport, Answer, Acknowledgement]


def unpacked(kind: type[Message], payload: bytes) -> object:
    """What was packed; an answer alone, and not as a part of one."""
    made = kind.unpack(payload)
    if isinstance(made, tuple):
        answer, *part = made
        assert part == [0, 1]
        return answer
    return made


@settings(max_examples=60)
@given(st.one_of(SUMMARIES, CALLS, ANSWERS, ACKNOWLEDGEMENTS))
def test_what_is_packed_comes_back_and_fits_a_tunnel(message: Message) -> None:
    payload = message.pack()
    assert len(payload) <= 128
    assert unpacked(type(message), payload) == message


@pytest.mark.parametrize(
    "operation",
    [
        SetWord("grass", -0.5),
        Tap(9, (0.1, 0.2, 0.3, 0.4), "grass", 1.0),
        ForgetWord("grass"),
        ForgetCall(4),
        NewEpisode(),
        OtherPlace(5),
        PackIncident(6),
        RecordingWish(7, Wish.CANCEL),
    ],
)
def test_each_operation_comes_back_as_itself(operation: AnyOperation) -> None:
    answer = Answer(2, Motion.NONE, (operation, SetWord("moss", 0.5)), 1)
    assert Answer.unpack(answer.pack()) == (answer, 0, 1)


@settings(max_examples=200)
@given(st.sampled_from(KINDS), st.binary(max_size=140))
def test_any_bytes_are_read_or_refused(kind: type[Message], noise: bytes) -> None:
    with contextlib.suppress(PayloadError):
        kind.unpack(noise)
    with contextlib.suppress(PayloadError):
        kind.unpack(b"\x01" + noise)


@settings(max_examples=60)
@given(st.one_of(SUMMARIES, CALLS, ANSWERS, ACKNOWLEDGEMENTS), st.data())
def test_a_torn_or_altered_payload_is_read_or_refused(message: Message, data: st.DataObject) -> None:
    payload = bytearray(message.pack())
    cut = data.draw(st.integers(0, len(payload) - 1))
    with pytest.raises(PayloadError):
        type(message).unpack(bytes(payload[:cut]))
    payload[cut] ^= data.draw(st.integers(1, 255))
    with contextlib.suppress(PayloadError):
        type(message).unpack(bytes(payload))


@settings(max_examples=30)
@given(st.one_of(SUMMARIES, CALLS, ANSWERS, ACKNOWLEDGEMENTS))
def test_another_version_is_refused_by_its_number(message: Message) -> None:
    payload = b"\x02" + message.pack()[1:]
    with pytest.raises(PayloadError, match="version 2"):
        type(message).unpack(payload)


def test_a_summary_has_47_bytes() -> None:
    assert len(SUMMARY.pack()) == 47


SUMMARY = Summary(
    State.OK, Policy.REPORT, Reasons.NONE, 0, 0, 1, 0, 0, 0.5, None, None, None, 60, 0, 0, (None,) * 16
)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_a_number_that_is_not_finite_travels_as_unknown(value: float) -> None:
    summary = replace(SUMMARY, roi_uncertainty=value, similarity=value)
    back = Summary.unpack(summary.pack())
    assert (back.roi_uncertainty, back.similarity) == (None, None)


def test_numbers_out_of_range_are_clipped_not_wrapped() -> None:
    back = Summary.unpack(replace(SUMMARY, roi_uncertainty=1.7, similarity=-3.0, frame_age_ms=99_999).pack())
    assert (back.roi_uncertainty, back.similarity, back.frame_age_ms) == (1.0, -1.0, 0xFFFF)


def test_an_answer_too_long_for_one_frame_says_what_to_do() -> None:
    words = tuple(SetWord("w" * 40, 1.0) for _ in range(4))
    with pytest.raises(PayloadError, match="several parts"):
        Answer(1, Motion.NONE, words, 1).pack()


def test_an_answer_with_transaction_0_is_refused() -> None:
    payload = bytearray(Answer(1, Motion.GO, transaction=1).pack())
    struct.pack_into("<I", payload, 1, 0)
    with pytest.raises(PayloadError, match="transaction 0"):
        Answer.unpack(bytes(payload))


@given(
    st.sampled_from(State),
    U16,
    st.sampled_from(Policy),
    st.tuples(st.booleans(), st.booleans(), st.booleans()),
    st.integers(0, 3),
)
def test_the_heartbeat_carries_state_id_policy_and_three_flags_and_leaves_bits_for_later(
    state: State, current: int, policy: Policy, flags: tuple[bool, bool, bool], later: int
) -> None:
    mode = heartbeat_mode(state, current, policy, *flags)
    assert mode < 1 << 30
    told = read_heartbeat_mode(mode | later << 30)
    assert told == HeartbeatMode(state, current, policy, *flags)
    assert (told.fault_accepted, told.braking, told.guiding) == flags


def test_each_flag_of_the_heartbeat_has_a_bit_of_its_own() -> None:
    none = heartbeat_mode(State.OK, 7, Policy.HOLD)
    for bit, flag in enumerate(("fault_accepted", "braking", "guiding"), 26):
        assert heartbeat_mode(State.OK, 7, Policy.HOLD, **{flag: True}) == none | 1 << bit
    assert heartbeat_mode(State.OK, 7, Policy.GUIDE) == none | 1 << 29


@pytest.mark.parametrize("policy", [Policy.REPORT, Policy.SHADOW, Policy.OFF])
def test_a_heartbeat_that_guides_without_a_hold_is_refused(policy: Policy) -> None:
    with pytest.raises(ValueError, match=f"says {policy.name.lower()}"):
        read_heartbeat_mode(heartbeat_mode(State.OK, 7, policy) | 1 << 29)


def test_the_hash_of_the_words_knows_no_order_but_every_weight() -> None:
    assert words_hash({"a": 1.0, "b": -1.0}) == words_hash({"b": -1.0, "a": 1.0})
    assert words_hash({"a": 1.0}) != words_hash({"a": 0.9})


def test_a_long_text_of_an_acknowledgement_ends_behind_a_whole_word() -> None:
    text = '"moss" is not a word it knows: ' + ", ".join(["grass", "long grass", "water"] * 9)
    ack = Acknowledgement(5, 7, Result.REFUSED, Stage.OPEN, Outcome.NONE, None, None, Reasons.NONE, 1, text)
    told = Acknowledgement.unpack(ack.pack()).text
    assert told.endswith(("grass...", "water..."))
    assert len(told) <= 90


@pytest.mark.parametrize("text", ["x" * 200, "ü" * 60 + " ü", " " * 99])
def test_a_text_without_a_place_to_cut_still_fits(text: str) -> None:
    assert len(shortened(text, 90).encode()) <= 90
