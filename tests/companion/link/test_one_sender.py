from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import LinkSettings
from companion.link.connection import Connection
from companion.link.sender import MAX_WAITING, Sender
from companion.sim.loopback_link import FileClient, LoopbackLink, SentFrame, pair
from companion.storage.served_tree import InMemoryFile, Tree
from companion.wire.ftp import Opcode
from companion.wire.ids import Policy, Stage, State
from companion.wire.messages import MESSAGES
from companion.wire.parameters import build
from tests.companion.link.payloads import LONG_CALL, SUMMARY

UNSOLICITED = {"HEARTBEAT", "STATUSTEXT", "TUNNEL", "NAMED_VALUE_FLOAT"}


def carried(frames: list[SentFrame], kinds: set[str], rate: float, burst: float) -> bool:
    """Whether every stretch of time carried at most rate x t + burst bytes of these kinds."""
    passed = [(frame.at, frame.size) for frame in frames if frame.message.get_type() in kinds]
    for first, (start, _) in enumerate(passed):
        total = 0
        for at, size in passed[first:]:
            total += size
            if total > rate * (at - start) + burst + 1e-6:
                return False
    return True


ACTIONS = st.lists(
    st.tuples(st.sampled_from(["say", "call", "close", "summary", "state", "list", "wait"]), st.floats(0, 3)),
    max_size=40,
)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(ACTIONS, st.sampled_from([50.0, 100.0, 300.0]), st.sampled_from([300.0, 600.0]))
def test_whatever_the_daemon_does_the_wire_keeps_to_both_budgets(
    actions: list[tuple[str, float]], budget: float, burst: float
) -> None:
    stage = LoopbackLink(
        LinkSettings("udpout:127.0.0.1:14550", budget=budget, burst=burst, asked_budget=200.0),
        build([f"word {number}" for number in range(20)], {}, {}),
    )
    for number, (action, pause) in enumerate(actions):
        match action:
            case "say":
                stage.link.texts.send(f"a text that is quite long, number {number}", 6, stage.now)
            case "call":
                stage.link.alerts.announce(
                    replace(LONG_CALL, frame_id=number), f"C1 text {number}", stage.now
                )
            case "close":
                stage.link.alerts.announce(
                    replace(LONG_CALL, id=number, stage=Stage.CLOSED), f"closed {number}", stage.now
                )
            case "summary":
                stage.link.summary(SUMMARY, stage.now)
                stage.link.numbers({"AT_TRAV": 0.5, "AT_UNC": 0.5}, stage.now)
            case "state":
                stage.link.set_state(State(number % 7), number, Policy.REPORT)
            case "list":
                stage.send(mavlink.MAVLink_param_request_list_message(1, 191))
        stage.run(pause, step=0.03)
    assert carried(stage.frames, UNSOLICITED, budget, burst)
    assert carried(stage.frames, {"PARAM_VALUE"}, 200.0, burst)


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(ACTIONS)
def test_frames_keep_their_distance_and_their_numbers_never_repeat(actions: list[tuple[str, float]]) -> None:
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", budget=0.0, asked_budget=0.0))
    for number, (action, pause) in enumerate(actions):
        stage.link.texts.send(f"{action} {number}", 6, stage.now)
        stage.send(mavlink.MAVLink_param_request_list_message(1, 191))
        stage.run(pause, step=0.01)
    assert all(after.at - before.at >= 0.0299 for before, after in pairwise(stage.frames))
    numbers = [frame.message.get_seq() for frame in stage.frames]
    assert numbers == [number % 256 for number in range(len(numbers))]


def test_the_heartbeat_keeps_its_beat_under_a_budget_that_is_spent() -> None:
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", budget=60.0, burst=300.0))
    for number in range(600):
        stage.link.texts.send(f"a text that is quite long, number {number}", 6, stage.now)
        stage.link.alerts.announce(
            replace(LONG_CALL, frame_id=number), f"C1 unknown thing {number}", stage.now
        )
        stage.run(0.1, step=0.05)
    beats = stage.times("HEARTBEAT")
    assert max(after - before for before, after in pairwise(beats)) < 1.5


def test_no_frame_is_longer_than_its_row_says() -> None:
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", budget=0.0))
    stage.link.alerts.announce(LONG_CALL, "x" * 60, stage.now)
    stage.link.texts.send("y" * 60, 6, stage.now)
    stage.link.set_state(State.FAULT, 0xFFFF, Policy.HOLD)
    stage.link.numbers({"AT_TRAV": 0.123, "AT_CALL": 1e9}, stage.now)
    stage.run(5)
    limits = {"HEARTBEAT": 21, "STATUSTEXT": 63, "TUNNEL": 145, "NAMED_VALUE_FLOAT": 27, "COMMAND_LONG": 45}
    assert {row.bytes for row in MESSAGES.values()} >= set(limits.values())
    for frame in stage.frames:
        assert frame.size <= limits[frame.message.get_type()]


def test_a_full_queue_loses_the_least_urgent_frame_and_counts_it() -> None:
    near, _ = pair()
    near.full = True
    connection = Connection(lambda: near, 0.0)
    connection.read(0.0)
    sender = Sender(connection, LinkSettings("udpout:127.0.0.1:1"), 0.0)
    for number in range(MAX_WAITING):
        sender.push("list", mavlink.MAVLink_param_value_message(b"AT_X", 0, 9, 1, number), 0.0)
    sender.push("heartbeat", mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3), 0.0)
    assert sender.lost == 0, "another budget's"
    sender.push("command ack", mavlink.MAVLink_command_ack_message(31010, 0), 0.0)
    assert sender.lost == 1
    assert sender.waiting("heartbeat") == sender.waiting("command ack") == 1
    assert sender.waiting("list") == MAX_WAITING - 1


def test_only_what_the_table_lets_the_companion_send_can_be_sent() -> None:
    near, _ = pair()
    sender = Sender(Connection(lambda: near, 0.0), LinkSettings("udpout:127.0.0.1:1"), 0.0)
    with pytest.raises(AssertionError, match="does not send"):
        sender.push("answer", mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3), 0.0)


def test_what_waited_too_long_is_not_sent() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.run(0.1)
    stage.near.full = True
    stage.link.texts.send("old news", 6, stage.now)
    stage.run(10, step=0.1)
    stage.near.full = False
    stage.run(1)
    assert stage.sent("STATUSTEXT") == []
    assert stage.link.counters.lost >= 1


def test_somebody_else_under_our_ids_silences_us_and_is_named() -> None:
    stage = LoopbackLink()
    stage.run(2)
    stage.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 77, 4, 3), (1, 191))
    stage.send(mavlink.MAVLink_param_request_list_message(1, 191))
    stage.run(0.01)
    before = len(stage.frames)
    stage.run(5)
    assert len(stage.frames) == before
    assert "another component 1/191" in str(stage.link.trouble)
    stage.run(6)
    assert stage.link.trouble is None
    assert len(stage.frames) > before


def test_our_own_frames_coming_back_are_no_clash() -> None:
    stage = LoopbackLink()
    stage.run(1)
    for frame in list(stage.frames):
        stage.far.write(bytes(frame.message.get_msgbuf()))
    stage.run(1)
    assert stage.link.trouble is None
    assert stage.link.counters.rejected["echo"] >= 1


def test_a_fast_connection_knows_its_own_frames_that_come_back_late() -> None:
    fast = LinkSettings("udpout:127.0.0.1:14550", budget=0.0, asked_budget=0.0, pace=0.0)
    stage = LoopbackLink(fast, build([f"word {number}" for number in range(20)], {}, {}))
    for _ in range(4):
        stage.send(mavlink.MAVLink_param_request_list_message(1, 191))
        stage.run(0.5)
    assert len(stage.frames) > 128
    for frame in stage.frames[-200:]:
        stage.far.write(bytes(frame.message.get_msgbuf()))
    stage.run(0.1)
    assert stage.link.trouble is None


def test_a_hold_that_is_urgent_leaves_alone_and_at_once_and_the_rest_waits_for_its_turn() -> None:
    stage = LoopbackLink()
    stage.run(0.5)
    stage.link.texts.send("a text", 1, stage.now)
    stage.link.modes.command(10, stage.now)
    before = len(stage.frames)
    stage.link.modes.send_hold_now(stage.now)
    stage.collect(stage.now)
    assert stage.frames[before:] == [], "driving on is not urgent"
    stage.link.modes.command(4, stage.now)
    stage.link.modes.send_hold_now(stage.now)
    stage.collect(stage.now)
    (hold,) = stage.frames[before:]
    assert (hold.message.command, hold.message.param2) == (176, 4)
    stage.run(0.2)
    after = stage.frames[before + 1]
    assert after.message.text == "a text"
    assert after.at - hold.at >= 0.0299


def test_an_error_over_one_message_costs_that_message_only_and_is_said() -> None:
    class Torn(InMemoryFile):
        def read(self, offset: int, count: int) -> bytes:
            raise RuntimeError(offset, count)

    class ServedFolder:
        def sizes(self) -> dict[str, int]:
            return {}

        def open(self, name: str) -> InMemoryFile:
            return Torn(name.encode())

    stage = LoopbackLink(tree=Tree({"logs": ServedFolder()}))
    client = FileClient(stage)
    client.open("/logs/torn")
    for opcode in (Opcode.READ_FILE, Opcode.BURST_READ_FILE):
        client.send(client.request(opcode, size=80))
    stage.send(mavlink.MAVLink_param_request_read_message(1, 191, b"AT_POLICY", -1))
    stage.run(3.0)
    assert len(stage.sent("PARAM_VALUE")) == 1
    assert len(stage.sent("HEARTBEAT")) == 4
    assert [message.text for message in stage.sent("STATUSTEXT")] == ["Companion error: see its log"]


def test_after_a_reconnect_a_heartbeat_leaves_at_once() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.run(1.2)
    stage.near.broken = True
    stage.run(0.1)
    assert stage.link.trouble == "link lost: unplugged"
    stage.near.broken = False
    before = len(stage.frames)
    stage.run(0.6)
    assert stage.frames[before].message.get_type() == "HEARTBEAT"
    assert stage.frames[before].at == pytest.approx(1.7, abs=0.05)


def test_a_device_that_never_comes_disturbs_nothing() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.near.broken = True
    stage.link.alerts.announce(LONG_CALL, "C1 unknown", 0.0)
    for _ in range(200):
        stage.link.summary(SUMMARY, stage.now)
        stage.run(0.1, step=0.1)
    assert stage.frames == []
    assert stage.link.trouble is not None
    assert 0 <= stage.link.wait(stage.now) <= 0.1
