"""Whatever floods in and out, each connection keeps to its budgets, and what matters gets out soon."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import ConnectionSettings, LinkSettings
from companion.link import encode
from companion.sim.loopback_link import LoopbackLink, Wire
from companion.storage.served_tree import Document, Tree
from companion.wire.ftp import FtpPayload, Opcode
from companion.wire.ids import COMPONENT_ID, TUNNEL_SUMMARY, Policy, Stage, State
from companion.wire.parameters import build
from companion.wire.payloads import Summary
from tests.companion.link.payloads import LONG_CALL, SUMMARY

STEP = 0.05
SOON = 4.0
LIST = mavlink.MAVLink_param_request_list_message(1, 191)
UNKNOWN = mavlink.MAVLink_command_long_message(1, 191, 31011, 0, 0, 0, 0, 0, 0, 0, 0)
FLOODS = ("summaries", "numbers", "texts", "call", "lists", "news", "reads", "files")
TREE = Tree({"state.json": Document(lambda: b"x" * 60_000)})
FILES = (
    FtpPayload(1, 0, Opcode.OPEN_FILE_RO, 11, data=b"/state.json"),
    FtpPayload(2, 0, Opcode.BURST_READ_FILE, 80),
    FtpPayload(3, 0, Opcode.LIST_DIRECTORY, 1, data=b"/"),
    FtpPayload(4, 0, Opcode.READ_FILE, 239, offset=30_000),
    FtpPayload(5, 0, Opcode.BURST_READ_FILE, 239, offset=10_000),
)
FILE = "FILE_TRANSFER_PROTOCOL"
NUMBERS = dict.fromkeys(("AT_TRAV", "AT_UNC", "AT_SIM", "AT_CALL"), 0.5)


class Meter:
    """Bytes of one budget over time: `excess` is the most by which a stretch of time went over its rate."""

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._lowest = 0.0
        self._before = 0
        self.excess = 0.0

    def take(self, total: int, now: float) -> None:
        self._lowest = min(self._lowest, self._before - self._rate * now)
        self._before = total
        self.excess = max(self.excess, total - self._rate * now - self._lowest)


connections = st.builds(
    ConnectionSettings,
    st.just("udpout:127.0.0.1:14551"),
    budget=st.sampled_from([150.0, 300.0, 1000.0]),
    burst=st.sampled_from([300.0, 600.0]),
    asked_budget=st.sampled_from([100.0, 1500.0]),
)


@pytest.mark.slow
@settings(max_examples=12, deadline=None)
@given(
    connections,
    connections,
    st.lists(st.sets(st.sampled_from(FLOODS)), min_size=6, max_size=6),
    st.sampled_from(["main", "wifi", None]),
)
def test_every_budget_holds_and_what_matters_gets_out(
    first: ConnectionSettings, second: ConnectionSettings, floods: list[set[str]], old: str | None
) -> None:
    main = LinkSettings(
        "udpout:127.0.0.1:14550", first.budget, first.burst, first.asked_budget, more={"wifi": second}
    )
    stage = LoopbackLink(main, build([f"word {number}" for number in range(20)], {}, {}), tree=TREE)
    wires: dict[str, Wire] = {"main": stage, "wifi": stage.more["wifi"]}
    if old is not None:
        wires[old].mavlink1 = True
    meters = {
        (name, budget): (Meter(rate), one.burst)
        for name, one in main.connections().items()
        for budget, rate in (("unsolicited", one.budget), ("asked", one.asked_budget))
    }

    def live(flooding: set[str], seconds: float) -> None:
        for number in range(round(seconds / STEP)):
            flood(stage, flooding, number)
            stage.run(STEP, step=STEP)
            for (name, budget), (meter, _) in meters.items():
                meter.take(stage.link.counters.connections[name].sent[budget], stage.now)

    live(floods[0], 2)
    stage.link.alerts.announce(LONG_CALL, "C1 unknown thing ahead 38%: go/stay/word", stage.now)
    began = stage.now
    for number, wire in enumerate(wires.values()):
        wire.send(UNKNOWN, (255, number))
    for flooding in floods:
        live(flooding, 2)
    for meter, burst in meters.values():
        assert meter.excess <= burst + 1e-6
    for name, wire in wires.items():
        beats = wire.times("HEARTBEAT")
        assert max(after - before for before, after in pairwise(beats)) < 1.6
        said = [f.at for f in wire.frames if f.message.get_type() == "STATUSTEXT" and "C1" in f.message.text]
        assert said[0] - began < SOON
        if name != old:
            data = [f.at for f in wire.frames if getattr(f.message, "payload_type", 0) == 45002]
            assert data[0] - began < SOON
        assert wire.times("COMMAND_ACK")[0] - began < SOON
    # What the floods kept off the wire is told by the next summary that there is room for.
    calm(stage)
    dropped = stage.link.counters.connections
    for name, wire in wires.items():
        if name != old:
            assert Summary.unpack(wire.tunnels(TUNNEL_SUMMARY)[-1]).dropped == dropped[name].dropped_summaries


def test_a_download_goes_on_under_all_floods_and_what_was_dropped_is_counted_and_shown() -> None:
    wifi = {"wifi": ConnectionSettings("udpout:127.0.0.1:14551")}
    main = LinkSettings("udpout:127.0.0.1:14550", budget=150.0, more=wifi)
    stage = LoopbackLink(main, build([f"word {number}" for number in range(20)], {}, {}), tree=TREE)
    for number in range(400):
        flood(stage, set(FLOODS), number)
        stage.run(STEP, step=STEP)
    calm(stage)
    counters = stage.link.counters
    assert sum(frame.size for frame in stage.frames if frame.message.get_type() == FILE) > 1000
    assert counters.rejected["rate"] > 0
    assert counters.lost > 0
    assert Summary.unpack(stage.tunnels(TUNNEL_SUMMARY)[-1]).dropped > 0
    assert counters.dropped_summaries == sum(one.dropped_summaries for one in counters.connections.values())


def calm(stage: LoopbackLink) -> None:
    stage.link.alerts.announce(replace(LONG_CALL, stage=Stage.CLOSED), "", stage.now)
    for _ in range(60):
        stage.link.summary(SUMMARY, stage.now)
        stage.run(0.2, step=STEP)


def flood(stage: LoopbackLink, kinds: set[str], number: int) -> None:
    now = stage.now
    if "summaries" in kinds:
        stage.link.summary(SUMMARY, now)
        stage.link.set_state(State(1 + number // 20 % 2), number // 20, Policy.REPORT)
    if "numbers" in kinds:
        stage.link.numbers(NUMBERS, now)
    if "texts" in kinds:
        stage.link.texts.send(f"a text that is quite long, at {now:.2f}", 6, now)
    if "call" in kinds and now > 2:
        stage.link.alerts.announce(replace(LONG_CALL, frame_id=number), f"C1 unknown thing {number}", now)
    if "news" in kinds:
        stage.link.parameters.set_value("AT_W_WORD_1", number % 20 / 20, now)
    for wire in (stage, stage.more["wifi"]):
        if "lists" in kinds:
            wire.send(LIST)
        if "reads" in kinds:
            wire.send(mavlink.MAVLink_param_request_read_message(1, 191, b"", number % 20))
        if "files" in kinds:
            request = FILES[number % len(FILES)]
            wire.send(encode.file_transfer(request.pack(), (1, COMPONENT_ID)), (255, 191))
