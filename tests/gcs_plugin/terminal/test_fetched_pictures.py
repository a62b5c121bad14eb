"""`picture` from both ends in virtual time: the companion's file server and the operator's client."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.sim.loopback_link import LoopbackLink
from companion.storage.served_tree import Document, Documents, Tree
from companion.wire.ftp import FtpPayload, Opcode
from companion.wire.payloads import CallData
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.client.fetch import LIFETIME_S, Fetch, FetchStatus
from gcs_plugin.client.rovers import Rover
from gcs_plugin.terminal.commands import CommandError, Picture, parse
from gcs_plugin.terminal.output import TextOutput
from gcs_plugin.terminal.pictures import Pictures, jpeg_size
from gcs_plugin.terminal.resolve import picture_of
from gcs_plugin.terminal.session import Session

CONTENT = random.Random(1).randbytes(6000)
JPEG = bytes.fromhex("ffd8ffe000104a46494600010100000100010000ffc0001108006000800301220002110103110100")


class Air:
    """Both ends, and what the air does to frames of files. loss: of each frame, each way."""

    def __init__(self, content: bytes = CONTENT, loss: float = 0.0, seed: int = 1) -> None:
        calls = Documents(lambda: {"7.jpg": len(content)}, lambda _: content)
        self.link = LoopbackLink(tree=Tree({"file": Document(lambda: content), "calls": calls}))
        self.client = OperatorClient()
        self.loss = loss
        self.silent = False
        self._random = random.Random(seed)
        self._heard = 0
        self.run(1.0)

    def run(self, seconds: float, fetch: Fetch | None = None) -> None:
        """Let time pass, at most until `fetch` is settled."""
        end = self.link.now + seconds
        while self.link.now < end and not (fetch is not None and fetch.settled):
            for message in self.client.outgoing(self.link.now):
                if self._arrives(message):
                    self.link.send(message)
            self.link.run(0.02)
            for frame in self.link.frames[self._heard :]:
                if self._arrives(frame.message):
                    self.client.receive(frame.message, frame.at)
            self._heard = len(self.link.frames)

    def fetch(self, path: str = "/file", within: float = 60.0) -> Fetch:
        fetch = self.client.fetch(1, path, self.link.now)
        self.run(within, fetch)
        return fetch

    def _arrives(self, message: object) -> bool:
        file = type(message).__name__ == "MAVLink_file_transfer_protocol_message"
        return not self.silent and not (file and self._random.random() < self.loss)


@pytest.mark.parametrize("size", [0, 1, 80, 239, 1500, 6000])
def test_a_file_of_any_size_comes_whole_and_its_session_is_given_back(size: int) -> None:
    air = Air(CONTENT[:size])
    fetch = air.fetch()
    assert (fetch.status, fetch.content, fetch.size) == (FetchStatus.DONE, CONTENT[:size], size)
    air.run(1.0)
    assert air.link.link._files.open_files == 0
    assert not air.client.busy


def test_a_picture_takes_two_seconds_on_a_radio() -> None:
    air = Air(CONTENT[:1500])
    began = air.link.now
    assert air.fetch().status is FetchStatus.DONE
    assert air.link.now - began < 2.5


@pytest.mark.parametrize("loss", [0.1, 0.3, 0.5])
def test_what_is_lost_is_asked_for_again(loss: float) -> None:
    for seed in range(4):
        fetch = Air(CONTENT[:1500], loss, seed).fetch(within=120.0)
        assert (fetch.status, fetch.content) == (FetchStatus.DONE, CONTENT[:1500])


def test_after_a_silence_it_goes_on_where_it_stopped() -> None:
    air = Air()
    fetch = air.client.fetch(1, "/file", air.link.now)
    air.run(2.0, fetch)
    received = fetch.received
    assert 0 < received < len(CONTENT)
    air.silent = True
    air.run(40.0)
    air.silent = False
    sent = len(air.link.sent("FILE_TRANSFER_PROTOCOL"))
    air.run(20.0, fetch)
    assert (fetch.status, fetch.content) == (FetchStatus.DONE, CONTENT)
    again = [FtpPayload.unpack(bytes(one.payload)) for one in air.link.sent("FILE_TRANSFER_PROTOCOL")[sent:]]
    assert min(one.offset for one in again if one.request == Opcode.BURST_READ_FILE) >= received


def test_a_file_that_is_not_there_is_said_at_once() -> None:
    fetch = Air().fetch("/calls/9.jpg", within=1.0)
    assert (fetch.status, fetch.problem) == (FetchStatus.FAILED, "the companion has no such file")


def test_nobody_waits_for_ever() -> None:
    air = Air()
    air.silent = True
    fetch = air.fetch(within=LIFETIME_S + 1.0)
    assert fetch.status is FetchStatus.FAILED
    assert "no byte for 60 s" in fetch.problem
    assert not air.client.busy


@settings(max_examples=60)
@given(st.binary(max_size=251), st.integers(0, 3))
def test_whatever_comes_is_survived(payload: bytes, kind: int) -> None:
    fetch = Fetch(1, "/file", 0.0, session=5)
    fetch.due(0.0)
    fetch.receive(FtpPayload(2, 5, Opcode.ACK, 4, Opcode.OPEN_FILE_RO, data=(100).to_bytes(4, "little")), 0.1)
    reply = bytearray(payload.ljust(251, b"\0"))
    if kind:
        reply[2], reply[3] = 5, (Opcode.ACK, Opcode.NAK)[kind % 2]
    try:
        fetch.receive(FtpPayload.unpack(bytes(reply)), 0.2)
    except ValueError:
        return
    assert fetch.received <= 100
    assert len(fetch.content) == fetch.size


def test_a_file_too_long_to_hold_is_refused() -> None:
    fetch = Fetch(1, "/file", 0.0, session=5)
    fetch.due(0.0)
    fetch.receive(FtpPayload(2, 5, Opcode.ACK, 4, Opcode.OPEN_FILE_RO, data=b"\xff" * 4), 0.1)
    assert fetch.status is FetchStatus.FAILED


def test_picture_is_a_command_with_an_id_and_a_size() -> None:
    assert parse("picture") == Picture()
    assert parse("rover 2 picture C7 large") == Picture(7, "large", rover=2)
    assert parse("picture 7 RAW") == Picture(7, "raw")
    assert parse("Picture 12") == Picture(12)
    with pytest.raises(CommandError):
        parse("picture 70000")
    with pytest.raises(CommandError):
        parse("picture of a drum")


def test_the_name_here_never_comes_from_the_air(thing_call: CallData) -> None:
    rover = Rover(3)
    assert picture_of(Picture(7), rover) == ("/calls/7.jpg", "rover3-call7.jpg")
    assert picture_of(Picture(7, "large"), rover)[0] == "/calls/7-large.jpg"
    assert picture_of(Picture(7, "raw"), rover) == ("/calls/7-raw.jpg", "rover3-call7-raw.jpg")
    with pytest.raises(CommandError, match="no call is open"):
        picture_of(Picture(), rover)
    rover.handle_call(replace(thing_call, picture="/calls/7.jpg"), 0.0)
    assert picture_of(Picture(), rover)[0] == f"/calls/{thing_call.id}.jpg"


def test_a_jpeg_tells_its_size() -> None:
    assert jpeg_size(JPEG) == (128, 96)
    for length in range(len(JPEG)):
        assert jpeg_size(JPEG[:length]) in (None, (128, 96))
    assert jpeg_size(b"") is None
    assert jpeg_size(b"\x89PNG") is None


def test_the_operator_types_picture_and_reads_where_it_lies(tmp_path: Path) -> None:
    lines: list[str] = []

    class Page:
        def write(self, text: str) -> None:
            lines.append(text)

        def flush(self) -> None:
            pass

    air = Air(JPEG)
    session = Session(air.client, TextOutput(Page(), colours=False), keep=Pictures(tmp_path).keep)
    session.type("picture 7", air.link.now)
    for _ in range(20):
        air.run(0.1)
        session.step(air.link.now)
    assert (tmp_path / "rover1-call7.jpg").read_bytes() == JPEG
    page = "".join(lines)
    assert f"rover1-call7.jpg (128 x 96 pixels, {len(JPEG)} bytes)" in page
    session.type("picture 8", air.link.now)
    for _ in range(20):
        air.run(0.1)
        session.step(air.link.now)
    assert "/calls/8.jpg did not come: the companion has no such file" in "".join(lines)
