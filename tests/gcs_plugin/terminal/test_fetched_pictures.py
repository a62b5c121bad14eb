"""`picture` from both ends in virtual time: the companion's file server and the operator's client."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.picture_size import jpeg_size
from bench.link.radio_model import LinkConditions, RadioModel
from companion.config.link_settings import LinkSettings
from companion.link.parser import Parser
from companion.sim.loopback_link import LoopbackLink
from companion.storage.served_tree import Document, Documents, Tree
from companion.wire.call_report import CallReport
from companion.wire.ftp import FtpPayload, Opcode
from companion.wire.typed_answers import CommandError
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.client.fetch import LIFETIME_S, Fetch, FetchStatus
from gcs_plugin.client.rovers import TrackedRover
from gcs_plugin.terminal.commands import FetchPicture, parse
from gcs_plugin.terminal.output import TextOutput
from gcs_plugin.terminal.pictures import Pictures
from gcs_plugin.terminal.resolve import picture_of
from gcs_plugin.terminal.session import Session

CONTENT = random.Random(1).randbytes(6000)
STEP = 0.02
GOOD = LinkConditions()
LOSSY = LinkConditions(loss=0.3, rate=5760.0)
JPEG = bytes.fromhex("ffd8ffe000104a46494600010100000100010000ffc0001108006000800301220002110103110100")


class Air:
    """Both ends, and a radio between them that may be bad in both directions.

    requests: the file requests that were sent.
    """

    def __init__(
        self, content: bytes = CONTENT, weather: LinkConditions = GOOD, seed: int = 1, budget: float = 1500.0
    ) -> None:
        calls = Documents(lambda: {"7.jpg": len(content)}, lambda _: content)
        tree = Tree({"file": Document(lambda: content), "calls": calls})
        self.link = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", asked_budget=budget), tree=tree)
        self.client = OperatorClient()
        self.silent = False
        self.requests: list[FtpPayload] = []
        self._up, self._down = RadioModel(weather, f"up {seed}"), RadioModel(weather, f"down {seed}")
        self._encoder, self._parser = mavlink.MAVLink(None, 255, 190), Parser()
        self.run(1.0)

    def run(self, seconds: float, fetch: Fetch | None = None) -> None:
        """Let time pass, at most until `fetch` is settled."""
        end = self.link.now + seconds
        while self.link.now < end and not (fetch is not None and fetch.settled):
            now = self.link.now
            for message in self.client.outgoing(now):
                if message.get_type() == "FILE_TRANSFER_PROTOCOL":
                    self.requests.append(FtpPayload.unpack(bytes(message.payload)))
                if not self.silent:
                    self._down.put(bytes(message.pack(self._encoder)), now)
            for frame in self._down.take(now):
                self.link.far.write(frame)
            self.link.run(STEP, STEP)
            for sent in self.link.frames:
                if not (self.silent and sent.message.get_type() == "FILE_TRANSFER_PROTOCOL"):
                    self._up.put(bytes(sent.message.get_msgbuf()), now)
            self.link.frames.clear()
            for frame in self._up.take(now):
                for message in self._parser.feed(frame, now, whole=True):
                    self.client.receive(message, now)

    def fetch(self, path: str = "/file", within: float = 60.0) -> Fetch:
        fetch = self.client.fetch(1, path, self.link.now)
        self.run(within, fetch)
        return fetch


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


def test_a_picture_comes_within_ten_seconds_where_a_radio_loses_30_percent() -> None:
    times = []
    for seed in range(24):
        air = Air(CONTENT[:1500], LOSSY, seed)
        began = air.link.now
        fetch = air.fetch()
        assert (fetch.status, fetch.content) == (FetchStatus.DONE, CONTENT[:1500])
        times.append(air.link.now - began)
    assert sorted(times)[12] < 4.0
    assert max(times) < 10.0


@settings(max_examples=25, deadline=None)
@given(
    st.builds(
        LinkConditions,
        loss=st.floats(0.0, 0.4),
        twice=st.floats(0.0, 0.3),
        shuffled=st.floats(0.0, 0.3),
        stall_every=st.sampled_from([0.0, 5.0]),
        rate=st.sampled_from([960.0, 5760.0, 0.0]),
    ),
    st.sampled_from([240.0, 1500.0, 0.0]),
    st.integers(0, 2000),
    st.integers(0, 1000),
)
def test_over_any_radio_it_comes_whole_and_requests_stay_few(
    weather: LinkConditions, budget: float, size: int, seed: int
) -> None:
    air = Air(CONTENT[:size], weather, seed, budget)
    fetch = air.fetch(within=400.0)
    if fetch.status is FetchStatus.DONE:
        assert fetch.content == CONTENT[:size]
    else:
        assert "no byte for 60 s" in fetch.problem
    replies_wanted = sum(request.opcode != Opcode.TERMINATE_SESSION for request in air.requests)
    assert replies_wanted <= 30 + 12 * (size // 80)


def test_after_a_silence_it_goes_on_where_it_stopped() -> None:
    air = Air()
    fetch = air.client.fetch(1, "/file", air.link.now)
    air.run(2.0, fetch)
    received = fetch.received
    assert 0 < received < len(CONTENT)
    before = len(air.requests)
    air.silent = True
    air.run(40.0)
    air.silent = False
    again = len(air.requests)
    assert 5 < again - before < 40
    air.run(20.0, fetch)
    assert (fetch.status, fetch.content) == (FetchStatus.DONE, CONTENT)
    assert min(one.offset for one in air.requests[again:] if one.opcode == Opcode.BURST_READ_FILE) >= received


def test_what_is_replaced_takes_no_more_of_the_budget() -> None:
    air = Air()
    air.client.fetch(1, "/file", air.link.now)
    air.run(0.5)
    fetch = air.client.fetch(1, "/calls/7.jpg", air.link.now)
    air.run(0.5)
    assert [one.number for one in air.link.link._files._sessions] == [fetch.session]


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
    assert parse("picture") == (None, FetchPicture())
    assert parse("rover 2 picture C7 large") == (2, FetchPicture(7, "large"))
    assert parse("picture 7 RAW") == (None, FetchPicture(7, "raw"))
    assert parse("picture ground") == (None, FetchPicture(None, "ground"))
    assert parse("Picture 12") == (None, FetchPicture(12))
    with pytest.raises(CommandError):
        parse("picture 70000")
    for wrong in ("picture of a drum", "picture 7 ground", "picture ground 7"):
        with pytest.raises(CommandError):
            parse(wrong)


def test_the_name_here_never_comes_from_the_air(thing_call: CallReport) -> None:
    rover = TrackedRover(3)
    assert picture_of(FetchPicture(7), rover) == ("/calls/7.jpg", "rover3-call7.jpg")
    assert picture_of(FetchPicture(7, "large"), rover)[0] == "/calls/7-large.jpg"
    assert picture_of(FetchPicture(7, "raw"), rover) == ("/calls/7-raw.jpg", "rover3-call7-raw.jpg")
    assert picture_of(FetchPicture(None, "ground"), rover) == ("/maps/from_above.png", "rover3-ground.png")
    with pytest.raises(CommandError, match="no call is open"):
        picture_of(FetchPicture(), rover)
    rover.handle_call(replace(thing_call, picture="/calls/7.jpg"), 0.0)
    assert picture_of(FetchPicture(), rover)[0] == f"/calls/{thing_call.id}.jpg"


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
