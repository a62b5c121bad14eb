"""What supervisor and recording process say to each other survives the way, and rubbish is refused."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.observers.recording.messages import (
    LARGEST,
    LARGEST_PART,
    LONGEST_REPORT,
    Joiner,
    RecordedMessage,
    RecordingReport,
    datagrams,
)
from companion.observers.recording.topics import TOPICS, Topic

MESSAGES = st.builds(
    RecordedMessage,
    st.sampled_from(Topic),
    st.integers(0, 2**63),
    st.binary(max_size=100) | st.integers(1, 3 * LARGEST_PART).map(lambda size: b"\xd8" * size),
    st.integers(0, 2**32 - 1),
    st.booleans(),
)


@given(st.lists(MESSAGES, max_size=4))
def test_messages_come_out_as_they_went_in(messages: list[RecordedMessage]) -> None:
    joiner, found = Joiner(), []
    for message in messages:
        parts = datagrams(message)
        assert max(map(len, parts)) <= LARGEST_PART
        *before, last = [joiner.feed(part) for part in parts]
        assert not any(before)
        found.append(last)
    assert found == messages


@given(st.lists(st.binary(max_size=40) | st.binary(max_size=40).map(lambda tail: b"." + tail), max_size=5))
def test_any_bytes_are_a_message_or_a_value_error(parts: list[bytes]) -> None:
    joiner = Joiner()
    for part in parts:
        with contextlib.suppress(ValueError):
            found = joiner.feed(part)
            assert found is None or found.topic in TOPICS


def test_what_never_ends_is_refused_and_forgotten() -> None:
    joiner = Joiner()
    for _ in range(LARGEST // LARGEST_PART + 1):
        assert joiner.feed(b"+" * LARGEST_PART) is None
    with pytest.raises(ValueError, match="no part"):
        joiner.feed(b"+" * LARGEST_PART)
    message = RecordedMessage(Topic.STATUS, 1, b"{}")
    assert joiner.feed(datagrams(message)[0]) == message


def test_what_is_too_long_is_not_sent() -> None:
    with pytest.raises(ValueError, match="at most"):
        datagrams(RecordedMessage(Topic.CAMERA, 0, bytes(LARGEST + 1)))


@given(
    st.integers(0, 2**32 - 1),
    st.integers(0, 2**64 - 1),
    st.integers(0, 2**64 - 1),
    st.text("abc ü7%", max_size=300),
)
def test_a_report_survives_and_a_long_trouble_is_cut(files: int, size: int, lost: int, trouble: str) -> None:
    packed = RecordingReport(files, size, 3, lost, trouble).encoded()
    assert len(packed) <= LONGEST_REPORT
    found = RecordingReport.decoded(packed)
    assert found[:4] == (files, size, 3, lost)
    assert trouble.startswith(found.trouble.rstrip("\N{REPLACEMENT CHARACTER}"))


@given(st.binary(max_size=LONGEST_REPORT + 5))
def test_any_bytes_are_a_report_or_a_value_error(packed: bytes) -> None:
    with contextlib.suppress(ValueError):
        assert RecordingReport.decoded(packed).trouble.isprintable()
