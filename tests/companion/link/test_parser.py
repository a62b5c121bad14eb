import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.link.parser import MAX_BROKEN, PATIENCE, Parser

MAV = mavlink.MAVLink(None, 255, 190)
HEARTBEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 253254, 4, 3).pack(MAV)
TEXT = mavlink.MAVLink_statustext_message(6, b"a text of some length").pack(MAV)
OLD = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(MAV, force_mavlink1=True)


def types(parser: Parser, data: bytes, now: float = 0.0, *, whole: bool = False) -> list[str]:
    return [message.get_type() for message in parser.feed(data, now, whole=whole)]


def test_frames_of_both_versions_are_found() -> None:
    assert types(Parser(), HEARTBEAT + OLD + TEXT) == ["HEARTBEAT", "HEARTBEAT", "STATUSTEXT"]


@given(st.integers(1, 20))
def test_a_stream_may_come_in_pieces(size: int) -> None:
    parser = Parser()
    stream = HEARTBEAT + TEXT + OLD
    found = [name for at in range(0, len(stream), size) for name in types(parser, stream[at : at + size])]
    assert found == ["HEARTBEAT", "STATUSTEXT", "HEARTBEAT"]


@settings(max_examples=200)
@given(st.binary(max_size=300))
def test_noise_never_raises_and_costs_no_frame_of_the_next_datagram(noise: bytes) -> None:
    parser = Parser()
    types(parser, noise, whole=True)
    assert types(parser, HEARTBEAT, whole=True) == ["HEARTBEAT"]


@settings(max_examples=100)
@given(st.integers(0, len(TEXT) - 1), st.integers(1, 255))
def test_a_broken_frame_costs_only_itself(place: int, flip: int) -> None:
    broken = bytearray(TEXT)
    broken[place] ^= flip
    parser = Parser()
    found = types(parser, HEARTBEAT + bytes(broken) + HEARTBEAT * 24)
    assert found.count("HEARTBEAT") >= 24
    assert "STATUSTEXT" not in found


@pytest.mark.parametrize("noise", [b"\xfd", b"\xfd\xff\x00", b"\xfe\xff\x00", TEXT[:-1], b"\xfd\xff\x01" * 3])
def test_what_looks_like_the_head_of_a_frame_keeps_nothing_back_for_long(noise: bytes) -> None:
    parser = Parser()
    types(parser, noise)
    heard = [second for second in range(1, 6) for _ in types(parser, HEARTBEAT, float(second))]
    assert heard[-4:] == [2, 3, 4, 5]


def test_noise_given_up_costs_no_frame_that_is_just_coming_in() -> None:
    parser = Parser()
    types(parser, b"\xfd\xff\x00")
    types(parser, TEXT[:20], PATIENCE - 0.1)
    found = types(parser, TEXT[20:30], PATIENCE + 0.1) + types(parser, TEXT[30:], PATIENCE + 0.2)
    assert found == ["STATUSTEXT"]


def test_a_frame_that_comes_slowly_is_read() -> None:
    parser = Parser()
    step = PATIENCE / len(TEXT)
    found = [name for place, byte in enumerate(TEXT) for name in types(parser, bytes([byte]), place * step)]
    assert found == ["STATUSTEXT"]


def test_a_signed_frame_is_read_whole() -> None:
    signing = mavlink.MAVLink(None, 255, 190)
    signing.signing.secret_key = bytes(32)
    signing.signing.sign_outgoing = True
    signed = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(signing)
    assert types(Parser(), signed + TEXT) == ["HEARTBEAT", "STATUSTEXT"]


def test_unknown_messages_are_passed_over() -> None:
    unknown = bytearray(HEARTBEAT)
    unknown[7:10] = (54321).to_bytes(3, "little")
    assert types(Parser(), bytes(unknown) + TEXT) == ["STATUSTEXT"]


@pytest.mark.parametrize("size", [1, 7, 1000])
@pytest.mark.parametrize("noise", [b"\xfd\x61\x00", b"\xfe\x64", b"\xfd\x61\x01"])
def test_noise_that_looks_like_the_head_of_an_unknown_message_costs_no_frame(noise: bytes, size: int) -> None:
    parser = Parser()
    stream = noise + HEARTBEAT * 9
    found = [name for at in range(0, len(stream), size) for name in types(parser, stream[at : at + size])]
    assert found == ["HEARTBEAT"] * 9


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_frames_between_unknown_messages_are_found(size: int) -> None:
    parser = Parser()
    unknown = bytearray(TEXT)
    unknown[7:10] = (54321).to_bytes(3, "little")
    unknown[20] = 0xFD
    stream = (bytes(unknown) * 2 + HEARTBEAT) * 4
    found = [name for at in range(0, len(stream), size) for name in types(parser, stream[at : at + size])]
    assert found == ["HEARTBEAT"] * 4
    assert parser.bad == 0


def test_the_buffer_never_grows_beyond_one_frame() -> None:
    parser = Parser()
    for _ in range(1000):
        types(parser, HEARTBEAT[:-1])
    assert len(parser._buffer) < 300


def test_of_a_datagram_full_of_false_heads_only_a_part_is_looked_into() -> None:
    parser = Parser()
    assert parser.feed(b"\xfe" * 60_000 + HEARTBEAT, 0.0, whole=True) == []
    assert parser.bad == MAX_BROKEN
    assert not parser.behind
    assert len(parser.feed(HEARTBEAT, 0.0, whole=True)) == 1


pieces = st.lists(
    st.sampled_from([HEARTBEAT, TEXT, b"\xfe" * 30, b"\xfd" * 30, b"\xfe\x08\0\x01\x01\0" * 5, b"noise"]),
    max_size=12,
)


@given(pieces, st.integers(1, 300))
def test_a_stream_of_noise_is_looked_into_bit_by_bit_and_no_frame_is_lost_by_it(
    content: list[bytes], size: int
) -> None:
    stream = b"".join(content)

    def heard(limit: int) -> tuple[list[str], int]:
        parser, found = Parser(), list[str]()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("companion.link.parser.MAX_BROKEN", limit)
            for at in range(0, len(stream), size):
                data = stream[at : at + size]
                while data or parser.behind:
                    before = parser.bad
                    found += types(parser, data)
                    assert parser.bad - before <= limit
                    data = b""
        return found, parser.bad

    assert heard(3) == heard(10**6)
