"""Whatever is asked of the file server: no exception, no session too many, nothing left open."""

import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import LinkSettings
from companion.link.ftp.server import MAX_REPLIES
from companion.link.ftp.sessions import IDLE, MAX_SESSIONS
from companion.sim.loopback_link import LoopbackLink
from companion.storage.served_files import MatchingFiles
from companion.storage.served_tree import Document, Tree
from companion.wire.ftp import FtpPayload, Opcode
from companion.wire.ids import COMPONENT_ID
from companion.wire.messages import MESSAGES

LARGE = 64 * 1024
PATHS = [
    b"/",
    b"/logs",
    b"/logs/large.log",
    b"/logs/small.log",
    b"/state.json",
    b"/bad",
    b"/../x",
    b"\xff",
    b"",
]
REQUESTS = st.builds(
    lambda opcode, data, size, sequence, session, offset: FtpPayload(
        sequence, session, opcode, max(size, len(data)), offset=offset, data=data
    ).pack(),
    opcode=st.sampled_from([*Opcode, 16, 255]),
    data=st.sampled_from(PATHS) | st.binary(max_size=239),
    size=st.sampled_from([0, 1, 80, 239]),
    sequence=st.integers(0, 600),
    session=st.integers(0, 3),
    offset=st.sampled_from([0, 1, 80, LARGE, LARGE + 9, 2**31, 2**32 - 1]),
)
PAYLOADS = REQUESTS | st.binary(min_size=251, max_size=251)
SENDERS = st.sampled_from([(255, 190), (254, 230), (1, 1), (7, 7)])
STEPS = st.lists(st.tuples(SENDERS, PAYLOADS, st.sampled_from([0, 0, 0, 0.02, 0.5, 4.0])), max_size=40)


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Tree:
    folder: Path = tmp_path_factory.mktemp("logs")
    (folder / "large.log").write_bytes(b"x" * (LARGE + 10))
    (folder / "small.log").write_bytes(b"small")

    def bad() -> bytes:
        raise ZeroDivisionError

    return Tree({"logs": MatchingFiles(folder), "state.json": Document(lambda: b"{}"), "bad": Document(bad)})


def descriptors() -> int:
    return len(os.listdir("/proc/self/fd"))


@pytest.mark.slow
@settings(max_examples=80, deadline=None)
@given(STEPS)
def test_nothing_that_is_asked_for_does_harm(tree: Tree, steps: list[tuple[Any, bytes, float]]) -> None:
    before = descriptors()
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", asked_budget=500.0), tree=tree)
    stage.run(0.05)
    files, outbox = stage.link._files, stage.link._outbox
    for sender, payload, pause in steps:
        message = mavlink.MAVLink_file_transfer_protocol_message(0, 1, COMPONENT_ID, payload)
        stage.send(message, sender)
        stage.run(pause or 0.01)
        assert files.open_files <= MAX_SESSIONS
        assert descriptors() <= before + MAX_SESSIONS
        assert outbox.waiting("file reply") <= MAX_REPLIES
        assert outbox.waiting("file data") <= MAX_SESSIONS
    stage.run(IDLE + 10.0, step=0.05)
    assert files.open_files == 0
    assert descriptors() == before
    assert stage.link.counters.lost <= len(steps)
    for frame in stage.frames:
        if frame.message.get_type() == "FILE_TRANSFER_PROTOCOL":
            assert frame.size <= MESSAGES["file data"].bytes
            assert FtpPayload.unpack(bytes(frame.message.payload)).opcode in (Opcode.ACK, Opcode.NAK)
