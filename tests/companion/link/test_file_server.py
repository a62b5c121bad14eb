"""MAVLink FTP, request by request, in virtual time."""

import threading
import time
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink
from pymavlink.mavftp import MAVFTP

from companion.config.link_settings import ConnectionSettings, LinkSettings
from companion.link import encode
from companion.link.ftp.server import BURST_FRAMES, MAX_LATER
from companion.sim.loopback_link import FileClient, LoopbackLink
from companion.storage.file_reader import FileReader
from companion.storage.served_files import MatchingFiles
from companion.storage.served_tree import Document, Documents, Tree
from companion.wire.answers import Answer
from companion.wire.ftp import FtpError, FtpPayload, Opcode
from companion.wire.ids import COMPONENT_ID

BYTES = bytes(number * 7 % 251 for number in range(20_000))
SIZES = (0, 1, 80, 400, 20_000)


class Files:
    """What is served here."""

    def __init__(self) -> None:
        self.many = {f"{number:03}.a-name-that-takes-its-room": number for number in range(20)}

    def tree(self) -> Tree:
        files = {f"{size}.bin": BYTES[:size] for size in SIZES}
        sizes = {name: len(content) for name, content in files.items()}
        return Tree(
            {
                "state.json": Document(lambda: b"the state"),
                "files": Documents(lambda: sizes, files.__getitem__),
                "many": Documents(lambda: self.many, lambda _: b""),
                "empty": Documents(dict, lambda _: b""),
            }
        )


def whole(client: FileClient, path: str) -> bytes:
    size = int.from_bytes(client.open(path).data, "little")
    return b"".join(client.read(offset=offset, size=239).data for offset in range(0, size, 239))


def error(reply: FtpPayload) -> FtpError:
    assert reply.opcode == Opcode.NAK
    assert reply.size == 1
    return FtpError(reply.data[0])


@pytest.fixture
def files() -> Files:
    return Files()


@pytest.fixture
def client(files: Files) -> FileClient:
    return FileClient(LoopbackLink(tree=files.tree()))


def test_a_file_is_opened_with_its_size_in_the_session_that_the_client_chose(client: FileClient) -> None:
    reply = client.open("/files/400.bin", session=9)
    assert (reply.opcode, reply.request, reply.session) == (Opcode.ACK, Opcode.OPEN_FILE_RO, 9)
    assert int.from_bytes(reply.data, "little") == 400
    assert reply.sequence == client.sequence + 1


def test_a_read_brings_as_many_bytes_as_it_asked_for(client: FileClient) -> None:
    client.open("/files/400.bin")
    reply = client.read(size=239, offset=100)
    assert (reply.offset, reply.data) == (100, BYTES[100:339])
    assert client.read(size=239, offset=399).data == BYTES[399:400]
    assert error(client.read(size=80, offset=400)) is FtpError.END_OF_FILE


def test_a_burst_counts_on_and_says_where_it_ends(client: FileClient) -> None:
    client.open("/files/400.bin")
    client.send(client.request(Opcode.BURST_READ_FILE, size=80))
    replies = client.replies(1.0)
    assert b"".join(reply.data for reply in replies) == BYTES[:400]
    assert [reply.offset for reply in replies] == [0, 80, 160, 240, 320]
    assert [reply.sequence for reply in replies] == [client.sequence + 1 + count for count in range(5)]
    assert [reply.burst_complete for reply in replies] == [False] * 4 + [True]
    client.send(client.request(Opcode.BURST_READ_FILE, size=80, offset=400))
    assert error(client.replies()[0]) is FtpError.END_OF_FILE


def test_a_long_file_takes_several_bursts_and_only_its_end_is_short(client: FileClient) -> None:
    """Clients take a burst's last frame for the file's end when it is shorter than they asked for."""
    client.open("/files/20000.bin")
    client.send(client.request(Opcode.BURST_READ_FILE, size=239))
    replies = client.replies(10.0)
    assert 20 < len(replies) <= BURST_FRAMES
    assert {reply.size for reply in replies[:-1]} == {80}
    assert (replies[-1].size, replies[-1].burst_complete) == (239, True)


def test_a_link_without_a_budget_carries_long_frames() -> None:
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", asked_budget=0.0), tree=Files().tree())
    client = FileClient(stage)
    client.open("/files/400.bin")
    client.send(client.request(Opcode.BURST_READ_FILE, size=239))
    assert [reply.size for reply in client.replies()] == [239, 161]


def test_a_link_of_mavlink_1_carries_files_in_frames_that_are_long_anyway(client: FileClient) -> None:
    client.stage.mavlink1 = True
    client.replies(12.0)
    client.open("/files/400.bin")
    client.send(client.request(Opcode.BURST_READ_FILE, size=239))
    assert b"".join(reply.data for reply in client.replies(1.0)) == BYTES[:400]
    frames = [frame for frame in client.stage.frames if frame.message.get_type() == "FILE_TRANSFER_PROTOCOL"]
    assert [frame.message.get_msgbuf()[0] for frame in frames] == [mavlink.PROTOCOL_MARKER_V1] * 3
    assert {frame.size for frame in frames} == {262}


def test_a_file_leaves_by_the_connection_where_it_was_asked_for() -> None:
    more = {"wide": ConnectionSettings("udpout:127.0.0.1:14551", asked_budget=0.0)}
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", more=more), tree=Files().tree())
    client = FileClient(stage)
    request = client.request(Opcode.OPEN_FILE_RO, b"/files/400.bin")
    burst = client.request(Opcode.BURST_READ_FILE, size=239)
    for one in (request, burst):
        stage.more["wide"].send(encode.file_transfer(one.pack(), (1, COMPONENT_ID)), client.sender)
    stage.run(0.5)
    assert stage.sent("FILE_TRANSFER_PROTOCOL") == []
    told = [
        FtpPayload.unpack(bytes(one.payload)) for one in stage.more["wide"].sent("FILE_TRANSFER_PROTOCOL")
    ]
    assert [reply.size for reply in told] == [4, 239, 161]


def test_a_program_that_is_heard_on_two_connections_goes_on_reading_on_either() -> None:
    more = {"wifi": ConnectionSettings("udpout:127.0.0.1:14551")}
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", more=more), tree=Files().tree())
    client = FileClient(stage)
    client.open("/files/400.bin")
    read = client.request(Opcode.READ_FILE, size=80, offset=160)
    stage.more["wifi"].send(encode.file_transfer(read.pack(), (1, COMPONENT_ID)), client.sender)
    stage.run(0.5)
    (told,) = stage.more["wifi"].sent("FILE_TRANSFER_PROTOCOL")
    assert FtpPayload.unpack(bytes(told.payload)).data == BYTES[160:240]


def test_a_list_is_told_page_by_page_with_entries_whole(client: FileClient) -> None:
    found: list[bytes] = []
    for _ in range(30):
        reply = client.ask(client.request(Opcode.LIST_DIRECTORY, b"/many\0", offset=len(found)))
        if reply.opcode == Opcode.NAK:
            break
        assert reply.data.endswith(b"\0")
        assert reply.size <= 80
        found += reply.data.rstrip(b"\0").split(b"\0")
    assert error(reply) is FtpError.END_OF_FILE
    assert found == [f"F{number:03}.a-name-that-takes-its-room\t{number}".encode() for number in range(20)]


def test_a_list_does_not_change_between_its_pages(client: FileClient, files: Files) -> None:
    first = client.ask(client.request(Opcode.LIST_DIRECTORY, b"/many"))
    files.many = {"000.new": 0, **files.many}
    second = client.ask(client.request(Opcode.LIST_DIRECTORY, b"/many", offset=first.data.count(b"\0")))
    assert second.data.startswith(b"F002.a-name-that-takes-its-room\t2\0")
    again = client.ask(client.request(Opcode.LIST_DIRECTORY, b"/many"))
    assert again.data.startswith(b"F000.a-name-that-takes-its-room\t0\0F000.new\t0\0")


def test_folders_are_told_apart_and_an_empty_one_ends_at_once(client: FileClient) -> None:
    reply = client.ask(client.request(Opcode.LIST_DIRECTORY, b"/"))
    assert reply.data == b"D@PARAM\0Dempty\0Dfiles\0Dmany\0Fstate.json\t9\0"
    assert error(client.ask(client.request(Opcode.LIST_DIRECTORY, b"/empty"))) is FtpError.END_OF_FILE


@pytest.mark.parametrize(
    ("opcode", "expected"),
    [
        *[(opcode, FtpError.FILE_PROTECTED) for opcode in range(Opcode.CREATE_FILE, Opcode.RENAME + 1)],
        *[(opcode, FtpError.UNKNOWN_COMMAND) for opcode in (16, 50, 127, 130, 255)],
        *[(opcode, FtpError.INVALID_SESSION) for opcode in (Opcode.READ_FILE, Opcode.BURST_READ_FILE)],
        (Opcode.OPEN_FILE_RO, FtpError.FILE_NOT_FOUND),
        (Opcode.LIST_DIRECTORY, FtpError.FILE_NOT_FOUND),
        (Opcode.CALC_FILE_CRC32, FtpError.FILE_NOT_FOUND),
    ],
)
def test_what_cannot_be_done_is_refused_with_its_reason(
    client: FileClient, opcode: int, expected: FtpError
) -> None:
    reply = client.ask(client.request(opcode, b"/nothing", session=3, offset=5))
    assert error(reply) is expected
    assert (reply.request, reply.session, reply.offset) == (opcode, 3, 5)


def test_a_path_that_is_not_utf_8_is_not_found(client: FileClient) -> None:
    assert error(client.ask(client.request(Opcode.OPEN_FILE_RO, b"/\xff"))) is FtpError.FILE_NOT_FOUND


@pytest.mark.parametrize("options", ["", "?withdefaults=1", "?start=0&count=99"])
def test_all_parameters_are_read_from_the_file_that_ground_stations_try_first(
    client: FileClient, options: str
) -> None:
    link = client.stage.link
    link.parameters.set_configured({"AT_W_GRASS": 0.5})
    link.parameters.set_value("AT_THR_ROI", 0.25, client.stage.now)
    found = MAVFTP.ftp_param_decode(whole(client, f"@PARAM/param.pck{options}"))
    values = {name.decode(): value for name, value, _ in found.params}
    client.stage.send(mavlink.MAVLink_param_request_list_message(1, COMPONENT_ID))
    client.replies(5.0)
    assert values == {one.param_id: one.param_value for one in client.stage.sent("PARAM_VALUE")}
    assert values["AT_THR_ROI"] == 0.25
    defaults = {name.decode(): value for name, value, _ in found.defaults or ()}
    if "defaults" in options:
        assert defaults == values | {"AT_W_GRASS": 0.5}


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("@PARAM/param.pck?start=99", FtpError.FAIL),
        ("@PARAM/param.pck?count=many", FtpError.FAIL),
        ("@PARAM/param.pck?withdefaults=2", FtpError.FAIL),
        ("@PARAM/param.pckx", FtpError.FILE_NOT_FOUND),
        ("@PARAM/", FtpError.FILE_NOT_FOUND),
        ("param.pck", FtpError.FILE_NOT_FOUND),
    ],
)
def test_parameters_that_are_not_there_are_not_made_up(
    client: FileClient, path: str, expected: FtpError
) -> None:
    assert error(client.open(path)) is expected


def test_replies_are_never_answered(client: FileClient) -> None:
    for opcode in (Opcode.ACK, Opcode.NAK):
        client.send(client.request(opcode, b"\x07"))
    assert client.replies() == []


@pytest.mark.parametrize("target", [(1, 0), (0, COMPONENT_ID), (1, 1), (2, COMPONENT_ID)])
def test_only_requests_to_this_component_are_answered(client: FileClient, target: tuple[int, int]) -> None:
    client.send(client.request(Opcode.LIST_DIRECTORY, b"/"), target=target)
    assert client.replies() == []


def test_anybody_may_read() -> None:
    client = FileClient(LoopbackLink(tree=Files().tree()), (7, 1))
    assert client.open("/state.json").opcode == Opcode.ACK


def test_the_checksum_is_mavlinks_own(client: FileClient) -> None:
    reply = client.ask(client.request(Opcode.CALC_FILE_CRC32, b"/files/400.bin"))
    expected = zlib.crc32(BYTES[:400], 0xFFFFFFFF) ^ 0xFFFFFFFF
    assert int.from_bytes(reply.data, "little") == expected


def test_requests_beyond_the_rate_are_dropped_and_keep_no_answer_out(client: FileClient) -> None:
    for _ in range(200):
        client.send(client.request(Opcode.LIST_DIRECTORY, b"/"))
    go = mavlink.MAVLink_command_long_message(1, COMPONENT_ID, 31010, 0, 7, 1, 0, 0, 0, 0, 0)
    client.stage.send(go, client.sender)
    client.replies(1.0)
    rejected = client.stage.link.counters.rejected
    assert rejected["rate"] > 100
    assert rejected["file queue"] > 20
    assert client.stage.reported(Answer)


def test_a_burst_ends_before_a_client_takes_the_silence_of_its_own_for_a_broken_link(
    client: FileClient,
) -> None:
    client.open("/files/20000.bin")
    client.send(client.request(Opcode.BURST_READ_FILE, size=80))
    at = client.stage.now
    assert client.replies(10.0)[-1].burst_complete
    assert client.stage.times("FILE_TRANSFER_PROTOCOL")[-1] - at < 3.0


def test_frames_cost_at_most_what_the_table_says(client: FileClient) -> None:
    client.open("/files/20000.bin")
    client.send(client.request(Opcode.BURST_READ_FILE, size=239))
    client.replies(10.0)
    client.read(size=239)
    sizes = {
        frame.size for frame in client.stage.frames if frame.message.get_type() == "FILE_TRANSFER_PROTOCOL"
    }
    assert max(sizes) == 266
    assert 107 in sizes


class HangingFolder(MatchingFiles):
    """Its disk hangs until it is `released`."""

    def __init__(self, path: Path, reader: FileReader) -> None:
        super().__init__(path, "*", reader)
        self.released = threading.Event()

    def _directory(self) -> Any:
        assert self.released.wait(10.0)
        return super()._directory()


@pytest.fixture
def hanging(tmp_path: Path) -> Iterator[HangingFolder]:
    (tmp_path / "a.log").write_bytes(b"first")
    with FileReader() as reader:
        folder = HangingFolder(tmp_path, reader)
        yield folder
        folder.released.set()


def by_and_by(client: FileClient) -> FtpPayload:
    """The next reply, within ten real seconds."""
    for _ in range(1000):
        if found := client.replies(0.1):
            assert len(found) == 1
            return found[0]
        time.sleep(0.01)
    raise AssertionError("no reply came")


def test_a_disk_that_hangs_keeps_nothing_else_from_being_said_and_is_answered_later(
    hanging: HangingFolder,
) -> None:
    client = FileClient(LoopbackLink(tree=Tree({"logs": hanging, "state.json": Document(lambda: b"{}")})))
    other = FileClient(client.stage, (254, 190))
    request = client.request(Opcode.OPEN_FILE_RO, b"/logs/a.log")
    began = time.perf_counter()
    client.send(request)
    client.send(request)
    assert client.replies(1.0) == []
    assert other.open("/state.json").opcode == Opcode.ACK
    assert client.stage.sent("HEARTBEAT")
    assert time.perf_counter() - began < 2.0
    hanging.released.set()
    reply = by_and_by(client)
    assert (reply.opcode, reply.sequence, reply.data) == (Opcode.ACK, request.sequence + 1, b"\5\0\0\0")
    assert client.replies(1.0) == [], "asked twice, answered once"
    assert client.read().data == b"first"
    client.send(client.request(Opcode.LIST_DIRECTORY, b"/logs"))
    assert by_and_by(client).data == b"Fa.log\t5\0"
    client.send(client.request(Opcode.CALC_FILE_CRC32, b"/logs/a.log"))
    assert by_and_by(client).opcode == Opcode.ACK


def test_a_disk_that_goes_on_hanging_is_told(hanging: HangingFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.storage.file_reader.PATIENCE", 0.05)
    client = FileClient(LoopbackLink(tree=Tree({"logs": hanging})))
    client.send(client.request(Opcode.LIST_DIRECTORY, b"/logs"))
    assert error(by_and_by(client)) == FtpError.FAIL


@pytest.mark.parametrize("ending", [Opcode.TERMINATE_SESSION, Opcode.RESET_SESSIONS])
def test_a_session_that_is_ended_before_its_file_was_read_is_not_opened(
    hanging: HangingFolder, ending: Opcode
) -> None:
    client = FileClient(LoopbackLink(tree=Tree({"logs": hanging})))
    client.send(client.request(Opcode.OPEN_FILE_RO, b"/logs/a.log", session=2))
    assert client.replies(0.1) == []
    client.send(client.request(ending, session=2))
    assert by_and_by(client).opcode == Opcode.ACK
    hanging.released.set()
    time.sleep(0.05)
    assert client.replies(1.0) == []
    assert client.stage.link._files.open_files == 0


def test_no_more_than_a_few_requests_wait_for_the_disk(hanging: HangingFolder) -> None:
    stage = LoopbackLink(tree=Tree({"logs": hanging}))
    for number in range(3 * MAX_LATER):
        client = FileClient(stage, (230 + number % 20, 1 + number // 20))
        client.send(client.request(Opcode.LIST_DIRECTORY, b"/logs"))
        stage.run(0.2)
    assert len(stage.link._files._later) == MAX_LATER
    assert len(stage.sent("FILE_TRANSFER_PROTOCOL")) == 2 * MAX_LATER
