"""Filler behind a frame that was cut: the next frame is found, and the cut one is not."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.link.parser import Parser
from companion.link.streams import FILLER, completes

_HOLD = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 4, 0, 0, 0, 0, 0)


def _pymavlink(data: bytes) -> list[Any]:
    mav = mavlink.MAVLink(None)
    mav.robust_parsing = True
    return [one for one in mav.parse_buffer(data) or [] if one.get_type() != "BAD_DATA"]


def _ours(data: bytes) -> list[Any]:
    parser = Parser()
    found = parser.feed(data, 0.0, whole=False)
    while parser.behind:
        found += parser.feed(b"", 0.0, whole=False)
    return found


def _packed(message: Any, sequence: int, *, signed: bool = False, version_1: bool = False) -> bytes:
    mav = mavlink.MAVLink(None, 1, 191)
    mav.seq = sequence
    if signed:
        mav.signing.secret_key, mav.signing.sign_outgoing = bytes(range(32)), True
        mav.signing.timestamp = sequence
    return bytes(message.pack(mav, force_mavlink1=version_1))


_MESSAGES = st.one_of(
    st.binary(max_size=50).map(lambda text: mavlink.MAVLink_statustext_message(6, text)),
    st.binary(max_size=251).map(
        lambda data: mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, list(data.ljust(251, b"\xfd")))
    ),
    st.integers(0, 255).map(
        lambda mode: mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, mode, 0, 0, 0, 0, 0)
    ),
    st.just(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)),
)


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(_MESSAGES, st.integers(0, 255), st.sampled_from(["2", "signed", "1"]))
def test_behind_a_frame_that_was_cut_anywhere_the_next_one_is_found(
    message: Any, sequence: int, kind: str
) -> None:
    frame = _packed(message, sequence, signed=kind == "signed", version_1=kind == "1")
    hold = _packed(_HOLD, 7)
    for cut in range(len(frame)):
        for parse in (_pymavlink, _ours):
            found = parse(frame[:cut] + FILLER + hold)
            assert bytes(found[-1].get_msgbuf()) == hold, (parse, cut)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 255), st.floats(0, 0x00FFFFFF, width=32), st.sampled_from(["2", "1"]))
def test_a_resume_that_filler_cannot_complete_is_never_found_where_it_was_cut(
    sequence: int, mode: float, kind: str
) -> None:
    resume = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, mode, 0, 0, 0, 0, 0)
    frame = _packed(resume, sequence, version_1=kind == "1")
    held = [cut for cut in range(len(frame)) for parse in (_pymavlink, _ours) if parse(frame[:cut] + FILLER)]
    assert bool(held) == completes(frame)


def test_of_all_sequence_numbers_filler_completes_only_a_few() -> None:
    resume = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 10, 0, 0, 0, 0, 0)
    completed = [number for number in range(256) if completes(_packed(resume, number))]
    assert len(completed) < 8
    assert not any((one + 1) % 256 in completed for one in completed), "the next number never fits, too"
