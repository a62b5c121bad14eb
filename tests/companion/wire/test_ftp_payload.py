import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.wire.ftp import MAX_DATA, PAYLOAD, WRITES, FtpError, FtpPayload, Opcode
from companion.wire.packing import PayloadError

PAYLOADS = st.builds(
    lambda data, **fields: FtpPayload(size=len(data), data=data, **fields),
    data=st.binary(max_size=MAX_DATA),
    sequence=st.integers(0, 0xFFFF),
    session=st.integers(0, 0xFF),
    opcode=st.integers(0, 0xFF),
    request=st.integers(0, 0xFF),
    burst_complete=st.booleans(),
    offset=st.integers(0, 0xFFFFFFFF),
)


@given(PAYLOADS)
def test_a_payload_comes_back_as_it_was(payload: FtpPayload) -> None:
    packed = payload.pack()
    assert len(packed) == PAYLOAD
    assert FtpPayload.unpack(packed) == payload


@given(PAYLOADS)
def test_zeros_that_mavlink_cuts_off_are_made_good(payload: FtpPayload) -> None:
    head, rest = payload.pack()[:12], payload.pack()[12:].rstrip(b"\0")
    assert FtpPayload.unpack(head + rest) == payload


@given(st.binary(max_size=300))
def test_rubbish_is_refused_or_read_as_what_it_says(payload: bytes) -> None:
    try:
        read = FtpPayload.unpack(payload)
    except PayloadError:
        assert not 12 <= len(payload) <= PAYLOAD or payload[4] > MAX_DATA
    else:
        assert len(read.data) == read.size == payload[4]
        assert read.pack()[:6] == payload[:6]


def test_a_size_beyond_the_payload_is_refused() -> None:
    with pytest.raises(PayloadError, match="240 is above 239"):
        FtpPayload.unpack(struct.pack("<HBBBBBBI", 1, 0, 5, 240, 0, 0, 0, 0).ljust(PAYLOAD, b"\0"))


@pytest.mark.parametrize(
    "payload",
    [
        FtpPayload(0x10000, 0, 4, 0),
        FtpPayload(0, 256, 4, 0),
        FtpPayload(0, 0, 4, 0, offset=-1),
        FtpPayload(0, 0, 4, 1, data=b"ab"),
        FtpPayload(0, 0, 4, 240),
    ],
)
def test_what_does_not_fit_its_field_is_not_packed(payload: FtpPayload) -> None:
    with pytest.raises(PayloadError):
        payload.pack()


def test_a_read_asks_for_bytes_without_sending_any() -> None:
    asked = FtpPayload.unpack(FtpPayload(1, 0, Opcode.READ_FILE, 80, offset=160).pack())
    assert (asked.size, asked.offset) == (80, 160)


def test_a_path_ends_at_its_nul_and_must_be_utf_8() -> None:
    assert FtpPayload(0, 0, 4, 5, data=b"/a\0bc").path() == "/a"
    with pytest.raises(PayloadError, match="UTF-8"):
        FtpPayload(0, 0, 4, 2, data=b"/\xff").path()


def test_replies_keep_the_session_and_count_on() -> None:
    request = FtpPayload(0xFFFF, 7, Opcode.READ_FILE, 80, offset=160)
    assert request.ack(b"xy") == FtpPayload(0, 7, Opcode.ACK, 2, Opcode.READ_FILE, offset=160, data=b"xy")
    refused = FtpPayload(0, 7, Opcode.NAK, 1, Opcode.READ_FILE, offset=160, data=b"\x06")
    assert request.nak(FtpError.END_OF_FILE) == refused


def test_all_requests_that_change_something_are_known_as_such() -> None:
    reads = {"NONE", "TERMINATE_SESSION", "RESET_SESSIONS", "LIST_DIRECTORY", "OPEN_FILE_RO", "READ_FILE"}
    reads |= {"CALC_FILE_CRC32", "BURST_READ_FILE", "ACK", "NAK"}
    assert {one.name for one in Opcode if one not in WRITES} == reads
