"""Whatever bytes or texts come: the error that is meant for it, or a value that means what it packs to."""

from __future__ import annotations

from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.errors import PreferencesError
from companion.wire.ftp import FtpPayload
from companion.wire.ids import heartbeat_mode, read_heartbeat_mode
from companion.wire.packing import PayloadError
from companion.wire.words_text import read_weight, read_words
from tests.companion.wire.test_payloads import ACKNOWLEDGEMENTS, ANSWERS, CALLS, SUMMARIES

BENT = st.lists(st.tuples(st.integers(0, 250), st.integers(0, 255)), max_size=3)


@settings(max_examples=100)
@given(st.one_of(SUMMARIES, CALLS, ANSWERS, ACKNOWLEDGEMENTS), BENT, st.integers(-3, 3))
def test_a_bent_payload_is_refused_or_means_what_it_packs_to(
    message: Any, bent: list[tuple[int, int]], longer: int
) -> None:
    payload = bytearray(message.pack())
    for place, value in bent:
        payload[place % len(payload)] = value
    noise = bytes(payload[: len(payload) + longer]) + bytes(max(0, longer))
    try:
        read = type(message).unpack(noise)
    except PayloadError:
        return
    packed = read[0].pack(*read[1:]) if isinstance(read, tuple) else read.pack()
    assert type(message).unpack(packed) == read


@settings(max_examples=100)
@given(st.binary(max_size=260))
def test_file_requests_are_refused_or_mean_what_they_pack_to(noise: bytes) -> None:
    try:
        read = FtpPayload.unpack(noise)
    except PayloadError:
        return
    assert FtpPayload.unpack(read.pack()) == read


@settings(max_examples=100)
@given(st.builds(lambda high, state: high << 8 | state, st.integers(0, 0xFFFFFF), st.integers(0, 8)))
def test_any_heartbeat_mode_is_refused_or_read_as_what_it_says(mode: int) -> None:
    try:
        told = read_heartbeat_mode(mode)
    except ValueError:
        return
    assert heartbeat_mode(*told) == mode & 0x3FFFFFFF


TEXTS = st.text(max_size=130) | st.lists(
    st.sampled_from(["grass", ":", ";", " ", "0.5", "-1", "-2", "nan", "1e999", "old wall", "\0", "é"]),
    max_size=14,
).map("".join)


@settings(max_examples=100)
@given(TEXTS)
def test_any_words_as_text_are_refused_with_the_reason_or_in_range(text: str) -> None:
    try:
        operations = read_words(text)
    except PreferencesError:
        return
    assert len(operations) <= 16
    for operation in operations:
        assert -1.0 <= getattr(operation, "weight", 0.0) <= 1.0


@settings(max_examples=100)
@given(TEXTS)
def test_any_weight_as_text_is_refused_with_the_reason_or_in_range(text: str) -> None:
    try:
        operation = read_weight("grass", text)
    except PreferencesError:
        return
    assert -1.0 <= getattr(operation, "weight", 0.0) <= 1.0
