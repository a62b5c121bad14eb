import logging
import os
import pickle
import random
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.wire import signing
from companion.wire.signing import (
    AHEAD,
    BLOCK,
    DAY,
    FARTHEST_AHEAD,
    MAX_STREAMS,
    MINUTE,
    REPLAY,
    SIGNATURE,
    UNSIGNED,
    SignedStream,
    SigningKey,
    Timestamps,
    refusal,
    ticks,
)
from companion.wire.signing_store import SigningKeyError, read_key

SECRET = bytes(range(32))
KEY = SigningKey(SECRET)
NOW = ticks(1_790_000_000)
GROUND = SignedStream(255, 190, 0)


def heartbeat(state: int = 0, *, system: int = 255, component: int = 190) -> tuple[bytes, int]:
    message = mavlink.MAVLink_heartbeat_message(6, 8, 0, state, 4, 3)
    return bytes(message.pack(mavlink.MAVLink(None, system, component))), int(message.crc_extra)


def signed(timestamp: int, *, key: SigningKey = KEY, link: int = 0, system: int = 255) -> bytes:
    return key.sign(*heartbeat(system=system), link, timestamp)


def pymavlink_end(secret: bytes = SECRET, timestamp: int = NOW) -> mavlink.MAVLink:
    end = mavlink.MAVLink(None, 255, 190)
    end.signing.secret_key = secret
    end.signing.sign_outgoing = True
    end.signing.timestamp = timestamp
    return end


def test_what_we_sign_pymavlink_accepts_and_the_other_way_round() -> None:
    theirs, timestamps = pymavlink_end(), Timestamps()
    for count in range(300):
        frame = signed(NOW + count, link=count % 3)
        assert theirs.decode(bytearray(frame)).get_type() == "HEARTBEAT"
    for count in range(300):
        message = mavlink.MAVLink_command_long_message(1, 191, 31010, 0, count, 1, 0, 0, 0, 0, 0)
        assert refusal(message.pack(theirs), KEY, timestamps, NOW) == ""


@given(
    payload=st.binary(min_size=1, max_size=128),
    system=st.integers(1, 255),
    component=st.integers(1, 255),
    link=st.integers(0, 255),
    timestamp=st.integers(1, signing.LAST),
    flipped=st.integers(0, 10_000),
)
@settings(max_examples=60)
def test_any_frame_is_signed_as_pymavlink_signs_it_and_no_bit_of_it_can_be_changed(
    payload: bytes, system: int, component: int, link: int, timestamp: int, flipped: int
) -> None:
    message = mavlink.MAVLink_tunnel_message(1, 191, 45003, len(payload), payload.ljust(128, b"\0"))
    frame = bytes(message.pack(mavlink.MAVLink(None, system, component)))
    ours = KEY.sign(frame, message.crc_extra, link, timestamp)
    theirs = pymavlink_end(timestamp=timestamp)
    theirs.srcSystem, theirs.srcComponent, theirs.signing.link_id = system, component, link
    assert ours == message.pack(theirs)
    assert len(ours) == len(frame) + BLOCK
    assert signing.stream_of(ours) == (system, component, link)
    assert refusal(ours, KEY, Timestamps(), None) == ""
    changed = bytearray(ours)
    bit = flipped % (8 * len(changed))
    changed[bit // 8] ^= 1 << bit % 8
    assert refusal(bytes(changed), KEY, Timestamps(), None) in (UNSIGNED, SIGNATURE)


@given(st.binary(max_size=60))
def test_rubbish_is_refused_and_never_raises(rubbish: bytes) -> None:
    assert refusal(rubbish, KEY, Timestamps(), NOW) in (UNSIGNED, SIGNATURE)
    assert refusal(b"\xfd\x09\x01" + rubbish, KEY, Timestamps(), NOW) in (UNSIGNED, SIGNATURE)


@pytest.mark.parametrize(
    "frame",
    [
        pytest.param(b"\xfe" + heartbeat()[0][1:], id="of MAVLink 1"),
        pytest.param(signed(NOW), id="signed already"),
        pytest.param(b"\xfd\0\0", id="too short"),
    ],
)
def test_only_an_unsigned_frame_of_mavlink_2_can_be_signed(frame: bytes) -> None:
    with pytest.raises(ValueError, match="MAVLink 2"):
        KEY.sign(frame, 50, 0, NOW)


def test_of_10000_forged_frames_none_is_believed_and_no_genuine_one_is_refused_after() -> None:
    chance, timestamps = random.Random(7), Timestamps()
    assert refusal(signed(NOW), KEY, timestamps, NOW) == ""
    wrong = SigningKey(bytes(32 * [9]))
    believed = 0
    for count in range(2_500):
        far = signing.LAST - count
        genuine = signed(far)
        for forged in (
            genuine[:-6] + chance.randbytes(6),
            signed(far, key=wrong),
            genuine[:-BLOCK] + bytes([count % 255 + 1]) + genuine[1 - BLOCK :],
            genuine[: 1 - BLOCK] + chance.randbytes(6) + genuine[-6:],
        ):
            believed += refusal(forged, KEY, timestamps, NOW) != SIGNATURE
    assert believed == 0
    assert timestamps.last == NOW
    assert all(refusal(signed(NOW + 1 + count), KEY, timestamps, NOW) == "" for count in range(999))


def test_of_10000_replayed_frames_none_is_believed() -> None:
    timestamps = Timestamps()
    heard = [signed(NOW + count, link=count % 4) for count in range(10_000)]
    assert all(refusal(frame, KEY, timestamps, NOW) == "" for frame in heard)
    random.Random(3).shuffle(heard)
    assert {refusal(frame, KEY, timestamps, NOW) for frame in heard} == {REPLAY}


def test_a_new_stream_may_be_a_minute_behind_and_no_more() -> None:
    assert Timestamps().check(GROUND, NOW - MINUTE, NOW) == ""
    assert Timestamps().check(GROUND, NOW - MINUTE - 1, NOW) == REPLAY
    assert Timestamps(last=NOW).check(GROUND, NOW - MINUTE - 1, None) == REPLAY


def test_a_verified_time_ahead_of_ours_moves_ours_but_not_by_over_a_year() -> None:
    timestamps = Timestamps()
    assert timestamps.check(GROUND, NOW + FARTHEST_AHEAD, NOW) == ""
    assert timestamps.next(SignedStream(1, 191, 0), NOW) == NOW + FARTHEST_AHEAD + 1
    assert Timestamps().check(GROUND, NOW + FARTHEST_AHEAD + 1, NOW) == AHEAD


def test_one_sender_whose_clock_is_ahead_does_not_make_others_old_where_the_network_set_our_clock() -> None:
    timestamps, other = Timestamps(), SignedStream(254, 190, 0)
    assert timestamps.check(GROUND, NOW + 365 * DAY, NOW) == "", "the network had not set our clock yet"
    assert timestamps.check(other, NOW, NOW) == REPLAY
    assert timestamps.check(other, NOW - MINUTE - 1, NOW, synchronised=True) == REPLAY
    assert timestamps.check(other, NOW + DAY + 1, NOW, synchronised=True) == AHEAD
    assert timestamps.check(other, NOW, NOW, synchronised=True) == ""
    assert timestamps.check(other, NOW, NOW, synchronised=True) == REPLAY
    assert timestamps.check(GROUND, NOW + 365 * DAY + 1, NOW, synchronised=True) == "", (
        "it is heard as before"
    )


def test_a_forgotten_stream_that_was_ahead_does_not_make_others_old_where_the_network_set_our_clock() -> None:
    timestamps = Timestamps(floor=NOW + 365 * DAY)
    assert timestamps.check(GROUND, NOW, NOW, synchronised=True) == REPLAY
    assert timestamps.check(GROUND, NOW + 1, NOW, synchronised=True) == ""


def test_a_sender_that_is_ahead_is_not_forgotten_for_others_so_that_its_frames_could_be_replayed() -> None:
    timestamps, ahead = Timestamps(), NOW + DAY // 2
    assert timestamps.check(GROUND, ahead, NOW, synchronised=True) == ""
    for count in range(2 * MAX_STREAMS):
        assert timestamps.check(SignedStream(1, 1 + count, 0), NOW + count, NOW, synchronised=True) == ""
    assert timestamps.check(GROUND, ahead, NOW + count, synchronised=True) == REPLAY
    assert timestamps.check(GROUND, ahead + 1, NOW + count, synchronised=True) == ""


def test_a_sender_is_heard_though_all_that_are_remembered_are_ahead_where_the_network_set_our_clock() -> None:
    timestamps = Timestamps(
        streams={SignedStream(1, 1 + count, 0): NOW + DAY for count in range(MAX_STREAMS)}
    )
    for count in range(3):
        assert timestamps.check(GROUND, NOW + count, NOW, synchronised=True) == ""
        assert timestamps.check(GROUND, NOW + count, NOW, synchronised=True) == REPLAY
    assert len(timestamps.streams) == MAX_STREAMS


def test_our_timestamps_rise_though_the_clock_goes_back_and_our_own_frames_do_not_come_back_in() -> None:
    timestamps, own = Timestamps(), SignedStream(1, 191, 0)
    sent = [timestamps.next(own, clock) for clock in (NOW, NOW, NOW - 9_000, NOW + 5)]
    assert sent == [NOW, NOW + 1, NOW + 2, NOW + 5]
    assert {timestamps.check(own, timestamp, NOW) for timestamp in sent} == {REPLAY}
    assert timestamps.check(own, NOW + 6, NOW) == ""


def test_the_table_of_streams_is_bounded_and_forgets_none_that_could_be_replayed() -> None:
    timestamps = Timestamps()
    heard = [(SignedStream(1 + count // 200, 1 + count % 200, 0), NOW + count) for count in range(300)]
    assert all(timestamps.check(stream, at, NOW) == "" for stream, at in heard)
    assert len(timestamps.streams) == MAX_STREAMS
    assert {timestamps.check(stream, at, NOW) for stream, at in heard} == {REPLAY}


def key_file(folder: Path, content: bytes, mode: int = 0o600) -> Path:
    path = folder / "signing.key"
    path.write_bytes(content)
    path.chmod(mode)
    return path


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(SECRET, id="bytes"),
        pytest.param(SECRET.hex().encode(), id="hex digits"),
        pytest.param(SECRET.hex().upper().encode() + b"\r\n", id="with the end of the line"),
    ],
)
def test_a_key_is_read_from_a_file(content: bytes, tmp_path: Path) -> None:
    key = read_key(key_file(tmp_path, content))
    assert refusal(signed(NOW, key=key), KEY, Timestamps(), NOW) == ""


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o644, 0o660, 0o777, 0o601])
def test_a_key_that_others_may_open_is_refused(mode: int, tmp_path: Path) -> None:
    path = key_file(tmp_path, SECRET, mode)
    with pytest.raises(SigningKeyError, match=f"chmod 600 {path}"):
        read_key(path)


def test_somebody_elses_key_is_refused_unless_root_asks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = key_file(tmp_path, SECRET)
    owner = path.stat().st_uid or 12_345
    if os.geteuid() == 0:
        os.chown(path, owner, -1)
    monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    with pytest.raises(SigningKeyError, match="chown"):
        read_key(path)
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    assert read_key(path)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        SECRET[:31],
        SECRET.hex().encode()[:-1],
        b"open sesame",
        b"\xff" * 64,
        bytes(32),
        b"0" * 64,
        b"a" * 999,
    ],
)
def test_what_is_no_key_is_refused_and_not_told(content: bytes, tmp_path: Path) -> None:
    with pytest.raises(SigningKeyError, match="make") as caught:
        read_key(key_file(tmp_path, content))
    told = str(caught.value)
    assert not content or content.decode("latin-1") not in told
    assert caught.value.__cause__ is None


def test_a_key_that_is_absent_or_a_folder_is_said(tmp_path: Path) -> None:
    with pytest.raises(SigningKeyError, match="there is no signing key"):
        read_key(tmp_path / "none")
    with pytest.raises(SigningKeyError, match="is no file"):
        read_key(tmp_path)


def test_a_key_never_comes_out_again(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG)
    logging.getLogger("test").debug("%s %r", KEY, [KEY])
    assert SECRET.hex() not in caplog.text
    assert repr(SECRET) not in caplog.text
    assert not hasattr(KEY, "__dict__")
    with pytest.raises(TypeError):
        pickle.dumps(KEY)
