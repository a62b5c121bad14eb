"""What the script for ArduPilot hears: whose frames count, in which layout, and that damaged ones do not."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.sim.field import scripting
from companion.sim.field.rawframes import raw_frames
from companion.wire.ids import Policy, State, heartbeat_mode
from tests.companion.sim.field.stubs import AUTO, CYCLE, HOLD, MANUAL, SOURCE, Board, driving

pytest.importorskip("lupa.lua53", reason="the script runs in Lua 5.3")

CALL = b"C7 unknown thing ahead 38%: go/stay/word"
DEAF = "anytraverse.lua: no registrations free"
MODE = heartbeat_mode(State.OK, 7, Policy.HOLD)


def beat(
    system: int = 1, component: int = 191, kind: int = 18, *, v1: bool = False, key: bytes = b""
) -> bytes:
    mav = mavlink.MAVLink(None, system, component)
    if key:
        mav.signing.secret_key, mav.signing.sign_outgoing = key, True
    message = mavlink.MAVLink_heartbeat_message(kind, 8, 0, MODE, 4, 3)
    return bytes(message.pack(mav, force_mavlink1=v1))


def counts(datagram: bytes) -> bool:
    """Whether heartbeats like this one, once a second, keep the rover driving."""
    board = driving()
    for _ in range(4):
        board.hear(datagram)
        board.pass_time(1.0)
    assert not [text for text in board.texts() if "anytraverse.lua" in text]
    return board.mode_now == AUTO


@pytest.mark.parametrize(
    ("datagram", "heard"),
    [
        (beat(), True),
        (beat(v1=True), True),
        (beat(key=bytes(range(32))), True),
        (beat(system=2), False),
        (beat(component=190), False),
        (beat(component=1), False),
        (beat(kind=6), False),
        (b"\xfd" + beat(), True),
        (b"some rubbish " + beat() + b"\xfe\x09", True),
    ],
    ids=[
        "MAVLink 2",
        "MAVLink 1",
        "signed",
        "another vehicle's companion",
        "another component",
        "the autopilot",
        "a ground station as 191",
        "after a lone marker",
        "between rubbish",
    ],
)
def test_only_the_own_companion_s_heartbeat_counts(datagram: bytes, heard: bool) -> None:
    assert counts(datagram) is heard


@pytest.mark.parametrize("v1", [False, True])
def test_a_heartbeat_with_any_damaged_byte_does_not_count(v1: bool) -> None:
    whole = beat(v1=v1)
    for place in range(1, len(whole)):
        damaged = bytearray(whole)
        damaged[place] ^= 0x24
        assert not counts(bytes(damaged)), f"byte {place}"


def wide(datagram: bytes) -> Iterator[tuple[int, bytes]]:
    """The layout since system ids may have 32 bits: 299 bytes."""
    for number, raw in raw_frames(datagram):
        yield number, raw[:7] + struct.pack("<I", raw[7]) + raw[8:] + bytes(5)


def test_the_layout_with_wide_system_ids_is_read_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scripting, "raw_frames", wide)
    assert counts(beat())
    assert counts(beat(v1=True))
    assert not counts(beat(system=2))


def test_a_structure_is_laid_out_as_in_the_c_library() -> None:
    ((number, raw),) = raw_frames(beat())
    assert (number, len(raw)) == (0, 291)
    checksum, magic, length = struct.unpack_from("<HBB", raw)
    assert (magic, length, raw[7], raw[8]) == (0xFD, 9, 1, 191)
    assert checksum.to_bytes(2, "little") == beat()[-2:] == raw[276:278]
    assert struct.unpack_from("<I", raw, 12)[0] == MODE
    assert (raw[16], raw[17]) == (18, 8)


@settings(max_examples=60)
@given(
    datagrams=st.lists(st.binary(max_size=300), max_size=8), cut=st.integers(0, 21), at=st.integers(0, 255)
)
def test_any_bytes_are_survived_and_hold_nothing_up(datagrams: list[bytes], cut: int, at: int) -> None:
    board = Board()
    board.mode_now = MANUAL
    noise = [*datagrams, beat()[:cut], b"\xfd" + bytes([at]) * 40, b"\xfe" + bytes([at]) * 40]
    for datagram in noise:
        board.hear(datagram)
    board.pass_time(0.5)
    board.pass_time(1.0, state=State.OK)
    assert board.scripting.ended == ""
    assert board.texts()[-1] == "Policy hold: loss of companion will be held"


class TestEcho:
    def test_calls_are_said_again_as_the_autopilot_s_own(self) -> None:
        board = driving()
        board.tell(CALL, 3)
        board.pass_time(1.0)
        board.tell(CALL, 1)
        board.pass_time(CYCLE)
        assert [(said.severity, said.text) for said in board.said[1:]] == [(3, CALL.decode())]
        board.pass_time(2.0, state=State.CALLING)
        board.tell(CALL, 1)
        board.pass_time(CYCLE)
        assert (board.said[-1].severity, board.said[-1].text) == (1, CALL.decode())

    def test_news_are_not(self) -> None:
        board = driving()
        for severity in (4, 5, 6, 7):
            board.tell(b"Known place again", severity)
        board.pass_time(1.0)
        assert len(board.said) == 1

    def test_nor_what_somebody_else_says_or_what_was_damaged(self) -> None:
        board = driving()
        for system, component in ((1, 1), (2, 191), (255, 190)):
            board.tell(CALL, 3, mav=mavlink.MAVLink(None, system, component))
        message = mavlink.MAVLink_statustext_message(3, CALL)
        damaged = bytearray(message.pack(board.companion))
        damaged[20] ^= 1
        board.hear(damaged)
        board.pass_time(1.0)
        assert len(board.said) == 1

    def test_nor_anything_when_the_owner_wants_none(self) -> None:
        board = driving(ATS_ECHO=0)
        board.tell(CALL, 3)
        board.pass_time(1.0)
        assert len(board.said) == 1

    @settings(max_examples=40)
    @given(text=st.binary(max_size=50), severity=st.integers(0, 3))
    def test_any_text_comes_out_as_one_line_of_at_most_50_bytes(self, text: bytes, severity: int) -> None:
        board = driving()
        board.tell(text, severity)
        board.pass_time(CYCLE)
        said = [one.raw for one in board.said[1:]]
        assert all(len(line) <= 50 and min(line) >= 32 for line in said)
        assert [len(line) for line in said] == [len(line) for line in text.split(b"\0")[:1] if line]

    def test_a_flood_is_thinned_out(self) -> None:
        board = driving()
        for number in range(100):
            board.tell(b"C%d look" % number)
            board.pass_time(CYCLE)
        assert len(board.said) - 1 <= 25


def flooded(vm_steps: int) -> Board:
    """Two seconds with a full queue of the costliest frames each cycle, of the companion and of others."""
    board = driving(ATS_NEED=1)
    board.scripting = scripting.Scripting(SOURCE, "anytraverse.lua", board, vm_steps=vm_steps)
    board.sensors, board.status, board.mode_now = 1, 1, AUTO
    other: Any = mavlink.MAVLink(None, 2, 191)
    for cycle in range(20):
        for number in range(25):
            board.tell(b"%048d" % (cycle * 25 + number), mav=other if number % 5 == 4 else None)
        board.pass_time(CYCLE)
    return board


def test_a_flood_of_frames_stays_within_the_instructions_that_scripts_are_given() -> None:
    board = flooded(10_000)
    assert board.scripting.ended == ""
    assert board.mode_now == HOLD


def test_what_takes_too_long_is_ended_and_nothing_in_it_can_prevent_that() -> None:
    board = flooded(1000)
    assert "exceeded time limit" in board.scripting.ended


class TestAnotherScript:
    """All scripts share one queue and one list of message ids."""

    def test_that_opens_the_queue_again_makes_it_deaf_for_one_cycle_at_most(self) -> None:
        board = driving()
        board.scripting.open_queue(10, 5)
        board.pass_time(5.0, state=State.OK)
        board.tell(CALL, 3)
        board.pass_time(CYCLE)
        assert board.mode_now == AUTO
        assert board.said[-1].text == CALL.decode()

    def test_that_leaves_it_no_place_makes_it_hold_and_say_why(self) -> None:
        board = driving()
        board.scripting.open_queue(10, 1)
        board.scripting.register(33)
        board.pass_time(30.0, state=State.OK)
        assert board.mode_now == HOLD
        assert board.texts()[1:] == [DEAF, "HOLD: companion silent. AUTO again = go blind"]

    def test_that_leaves_a_place_for_heartbeats_alone_makes_it_say_every_5_s_what_it_does_not_hear(
        self,
    ) -> None:
        board = driving()
        board.scripting.open_queue(10, 1)
        board.pass_time(10.0, state=State.OK)
        assert board.mode_now == AUTO
        assert board.texts()[1:] == [DEAF] * 2
        board.pass_time(3.0)
        assert board.mode_now == HOLD

    @pytest.mark.parametrize("taken", [[33], []], ids=["all places", "all but the heartbeat's"])
    @pytest.mark.parametrize("need", [0, 1])
    def test_that_leaves_it_no_place_makes_it_refuse_arming_until_it_hears_again(
        self, taken: list[int], need: int
    ) -> None:
        board = driving(ATS_NEED=need)
        board.armed = False
        board.scripting.open_queue(10, 1)
        for number in taken:
            board.scripting.register(number)
        board.pass_time(5.0, state=State.OK)
        assert board.scripting.forbids_arming() == "anytraverse.lua cannot hear: see messages"
        assert DEAF in board.texts(1)
        board.scripting.open_queue(10, 5)
        board.pass_time(2.0, state=State.OK)
        assert board.scripting.forbids_arming() == ""

    def test_that_leaves_it_no_place_forbids_nothing_where_the_script_is_switched_off(self) -> None:
        board = driving()
        board.scripting.open_queue(10, 1)
        board.pass_time(CYCLE)
        assert board.scripting.forbids_arming()
        board.parameters["ATS_ENABLE"] = 0.0
        board.pass_time(CYCLE)
        assert board.scripting.forbids_arming() == ""

    def test_that_opens_the_queue_with_room_for_all_forbids_no_arming(self) -> None:
        board = driving()
        for _ in range(20):
            board.scripting.open_queue(10, 5)
            board.pass_time(CYCLE, state=State.OK)
            assert board.scripting.forbids_arming() == ""

    def test_that_opened_the_queue_first_keeps_its_registrations_and_its_memory(self) -> None:
        board = driving()
        board.scripting.boot()
        board.scripting.open_queue(10, 3)
        board.scripting.register(33)
        board.pass_time(3.0, state=State.OK)
        assert board.scripting.register(33) is False
        board.pass_time(3.0)
        assert board.mode_now == HOLD

    def test_that_left_no_place_before_makes_it_refuse_arming(self) -> None:
        board = driving()
        board.scripting.boot()
        board.scripting.open_queue(10, 1)
        board.scripting.register(33)
        board.pass_time(1.0, state=State.OK)
        assert "anytraverse.lua failed" in board.scripting.forbids_arming()

    def test_may_have_as_many_ids_as_any_can(self) -> None:
        driving().scripting.open_queue(10, 25)
