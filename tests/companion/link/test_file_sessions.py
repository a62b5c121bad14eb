"""Sessions of MAVLink FTP: repeated requests, copies that come late, limits, silence."""

from collections.abc import Iterator
from itertools import count

import pytest

from companion.link.ftp.sessions import IDLE
from companion.sim.loopback_link import FileClient, LoopbackLink
from companion.storage.served_tree import Document, Documents, Tree
from companion.wire.ftp import FtpError, FtpPayload, Opcode

BYTES = bytes(number * 7 % 251 for number in range(20_000))
FILES = {f"{size}.bin": BYTES[:size] for size in (80, 400, 20_000)}
SIZES = {name: len(content) for name, content in FILES.items()}


@pytest.fixture
def versions() -> Iterator[int]:
    return count(1)


@pytest.fixture
def stage(versions: Iterator[int]) -> LoopbackLink:
    def state() -> bytes:
        return f"version {next(versions)}".encode()

    files = Documents(lambda: SIZES, FILES.__getitem__)
    return LoopbackLink(tree=Tree({"state.json": Document(state), "files": files}))


@pytest.fixture
def client(stage: LoopbackLink) -> FileClient:
    return FileClient(stage)


def error(reply: FtpPayload) -> FtpError:
    assert reply.opcode == Opcode.NAK
    return FtpError(reply.data[0])


def test_a_repeated_request_gets_the_same_reply_and_opens_nothing_new(
    client: FileClient, versions: Iterator[int]
) -> None:
    request = client.request(Opcode.OPEN_FILE_RO, b"/state.json")
    assert client.ask(request) == client.ask(request)
    assert next(versions) == 2
    read = client.request(Opcode.READ_FILE, size=80)
    assert client.ask(read) == client.ask(read)
    end = client.request(Opcode.TERMINATE_SESSION)
    assert client.ask(end) == client.ask(end) == end.ack()
    assert error(client.read()) is FtpError.INVALID_SESSION


def test_a_copy_of_an_old_end_does_not_close_a_newer_session(client: FileClient) -> None:
    end, reset = client.request(Opcode.TERMINATE_SESSION), client.request(Opcode.RESET_SESSIONS)
    client.ask(end)
    client.open("/files/400.bin")
    client.ask(end)
    client.ask(reset)
    assert client.read().data == BYTES[:80]


def test_a_copy_of_an_old_opening_does_not_put_the_old_file_in_the_place_of_a_newer_one(
    client: FileClient,
) -> None:
    old = client.request(Opcode.OPEN_FILE_RO, b"/state.json")
    client.ask(old)
    client.ask(client.request(Opcode.TERMINATE_SESSION))
    client.open("/files/400.bin")
    client.send(old)
    assert client.replies() == []
    assert client.read().data == BYTES[:80]


def test_a_client_that_was_started_again_opens_what_it_wants_at_once(stage: LoopbackLink) -> None:
    before = FileClient(stage)
    before.sequence = 40
    before.open("/files/20000.bin")
    before.read()
    after = FileClient(stage)
    assert after.open("/files/400.bin").opcode == Opcode.ACK
    assert after.read(offset=320).data == BYTES[320:400]


def test_a_copy_of_a_burst_request_costs_nothing_and_a_late_one_begins_again(client: FileClient) -> None:
    client.open("/files/20000.bin")
    burst = client.request(Opcode.BURST_READ_FILE, size=80)
    client.send(burst)
    client.send(burst)
    first = client.replies(0.5)
    assert [reply.offset for reply in first] == [80 * count for count in range(len(first))]
    client.send(burst)
    assert client.replies(0.5)[0].offset == 0


def test_opening_again_in_the_same_session_reads_the_newest(client: FileClient) -> None:
    client.open("/state.json")
    client.open("/state.json")
    assert client.read().data == b"version 2"


def test_a_reset_ends_the_senders_own_sessions_only(stage: LoopbackLink) -> None:
    one = FileClient(stage)
    other = FileClient(stage, (254, 190))
    one.open("/files/400.bin")
    one.open("/files/80.bin", session=1)
    other.open("/files/400.bin")
    one.replies()
    assert one.ask(one.request(Opcode.RESET_SESSIONS)).opcode == Opcode.ACK
    for session in (0, 1):
        reply = one.read(session=session)
        assert error(reply) is FtpError.INVALID_SESSION
    other.replies()
    assert other.read().data == BYTES[:80]


def test_a_sender_has_two_sessions_and_the_longest_idle_makes_room(client: FileClient) -> None:
    for session in (0, 1, 2):
        assert client.open("/files/400.bin", session=session).opcode == Opcode.ACK
    reply = client.read(session=0)
    assert error(reply) is FtpError.INVALID_SESSION
    for session in (1, 2):
        assert client.read(session=session).data == BYTES[:80]


def test_four_sessions_in_all_and_the_fifth_waits_until_one_is_idle(stage: LoopbackLink) -> None:
    clients = [FileClient(stage, (250 + number, 190)) for number in range(3)]
    for client in clients[:2]:
        for session in (0, 1):
            client.replies()
            client.open("/files/400.bin", session=session)
    late = clients[2]
    late.replies()
    assert error(late.open("/files/400.bin")) is FtpError.NO_SESSIONS_AVAILABLE
    late.replies(IDLE + 1.0)
    assert late.open("/files/400.bin").opcode == Opcode.ACK


def test_an_operator_reads_however_many_who_may_only_read_came_before(stage: LoopbackLink) -> None:
    strangers = [FileClient(stage, (system, 1)) for system in (7, 8)]
    for client in strangers:
        for session in (0, 1):
            client.replies()
            assert client.open("/files/400.bin", session=session).opcode == Opcode.ACK
    third = FileClient(stage, (9, 1))
    assert error(third.open("/files/400.bin")) is FtpError.NO_SESSIONS_AVAILABLE
    operator = FileClient(stage)
    assert operator.open("/files/400.bin").opcode == Opcode.ACK
    assert operator.read().data == BYTES[:80]
    strangers[0].replies()
    assert error(strangers[0].read(session=0)) is FtpError.INVALID_SESSION
    assert strangers[0].read(session=1).opcode == Opcode.ACK


def test_a_session_in_use_outlives_the_idle_time_and_then_ends(client: FileClient) -> None:
    client.open("/files/400.bin")
    for _ in range(3):
        client.replies(IDLE - 5.0)
        assert client.read().opcode == Opcode.ACK
    client.replies(IDLE + 1.0)
    assert error(client.read()) is FtpError.INVALID_SESSION


def test_two_bursts_take_turns(stage: LoopbackLink) -> None:
    one = FileClient(stage)
    other = FileClient(stage, (254, 190))
    for client in (one, other):
        client.replies()
        client.open("/files/20000.bin")
        client.send(client.request(Opcode.BURST_READ_FILE, size=80))
    one.replies(), other.replies(0.0)
    shares = len(other.replies(1.0)), len(one.replies(0.0))
    assert abs(shares[0] - shares[1]) <= 1
    assert sum(shares) > 10
