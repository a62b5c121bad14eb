"""A tiny rover, just enough of a companion to talk to, and a sky that loses messages, in virtual time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from companion.wire import ids
from companion.wire.answers import Acknowledgement, Answer, AnyOperation
from companion.wire.call_report import CallReport
from companion.wire.delivery import Pending
from companion.wire.ftp import FtpError, FtpPayload, Opcode
from companion.wire.payloads import Summary
from gcs_plugin.client import events as ev
from gcs_plugin.client.client import OperatorClient

THING_CALL = CallReport(
    id=7,
    kind=ids.Kind.CALL,
    stage=ids.Stage.OPEN,
    outcome=ids.Outcome.NONE,
    reasons=ids.Reasons.UNKNOWN_OBJECT,
    holding=True,
    test=False,
    frame_id=4711,
    age_s=0,
    roi=(0.3, 0.5, 0.7, 0.95),
    worst_tile_box=(0.41, 0.55, 0.6, 0.81),
    roi_uncertainty=0.38,
    worst_tile=0.71,
    drivable_share=0.9,
    similarity=0.97,
    latitude=None,
    longitude=None,
    heading=None,
    word_count=2,
    words=1234,
)
QUIET_SUMMARY = Summary(
    state=ids.State.OK,
    policy=ids.Policy.HOLD,
    reasons=ids.Reasons.NONE,
    sequence=0,
    current_id=0,
    frame_id=4700,
    frame_age_ms=120,
    latency_ms=90,
    roi_traversability=0.9,
    roi_uncertainty=0.05,
    worst_tile=0.1,
    similarity=0.98,
    field_of_view=70,
    words=1234,
    dropped=0,
    sectors=(0.9,) * 16,
)


class TextSender:
    """Encodes and decodes MAVLink as one component of one system."""

    def __init__(self, system: int, component: int) -> None:
        self._mavlink = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self._mavlink.robust_parsing = True

    def frame(self, message: Any) -> bytes:
        packed: bytes = message.pack(self._mavlink)
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        return packed

    def sign(self) -> None:
        """From now on, and hear nothing that is not signed."""
        self._mavlink.signing.secret_key = bytes(range(32))
        self._mavlink.signing.sign_outgoing = True

    def tunnel(self, kind: int, payload: bytes, length: int | None = None) -> bytes:
        size = len(payload) if length is None else length
        return self.frame(mavlink.MAVLink_tunnel_message(0, 0, kind, size, payload.ljust(128, b"\0")))

    def parse(self, data: bytes) -> list[Any]:
        return self._mavlink.parse_buffer(data) or []


class TinyRover:
    """Speaks once a second; an answer to its call closes it, is applied once and acknowledged each time."""

    def __init__(self, system: int = 1, call: CallReport | None = None) -> None:
        self.companion = TextSender(system, ids.COMPONENT_ID)
        self.autopilot = TextSender(system, ids.AUTOPILOT_COMPONENT_ID)
        self.system = system
        self.call = call
        self.result = ids.Result.APPLIED
        self.stage_after = ids.Stage.CLOSED
        self.applied: list[tuple[int, ids.Motion, tuple[AnyOperation, ...]]] = []
        self.heard_ground = False
        self.lists_asked = 0
        self.policy = ids.Policy.HOLD
        self.policies_asked: list[int] = []
        self.grants = True
        self.sequence = 0
        self.files = {"/state.json": b'{"state": "calling", "words": {}, "given": {}}'}
        """By path, what can be fetched; without any, requests for files are not answered."""
        self._open_file = b""
        self._parts: dict[int, dict[int, Answer]] = {}
        self._acknowledgements: dict[int, bytes] = {}

    @property
    def current_id(self) -> int:
        return self.call.id if self.call and self.call.stage is not ids.Stage.CLOSED else 0

    def heartbeat(self) -> bytes:
        state = ids.State.CALLING if self.current_id else ids.State.OK
        mode = ids.heartbeat_mode(state, self.current_id, self.policy)
        return self.companion.frame(mavlink.MAVLink_heartbeat_message(18, 8, 0, mode, 4, 3))

    def vehicle(self, mode: int = 10, base_mode: int = 0x81) -> bytes:
        return self.autopilot.frame(mavlink.MAVLink_heartbeat_message(10, 3, base_mode, mode, 4, 3))

    def summary(self) -> bytes:
        self.sequence += 1
        payload = replace(QUIET_SUMMARY, sequence=self.sequence, current_id=self.current_id).pack()
        return self.companion.tunnel(ids.TUNNEL_SUMMARY, payload)

    def call_frames(self) -> list[bytes]:
        return [] if self.call is None else [self.companion.tunnel(ids.TUNNEL_CALL, self.call.pack())]

    def text(self, text: str) -> bytes:
        return self.companion.frame(mavlink.MAVLink_statustext_message(3, text.encode()))

    def speak(self) -> list[bytes]:
        """What it says each second."""
        return [self.heartbeat(), self.vehicle(), self.summary(), *self.call_frames()]

    def hear(self, data: bytes) -> list[bytes]:
        """What it says to what was sent to it."""
        replies: list[bytes] = []
        for message in self.companion.parse(data):
            if message.get_type() == "HEARTBEAT":
                self.heard_ground = True
            elif message.get_type() == "PARAM_REQUEST_LIST":
                self.lists_asked += 1
                replies.append(
                    self.companion.frame(mavlink.MAVLink_param_value_message(b"AT_W_GRASS", 1.0, 9, 1, 0))
                )
            elif message.get_type() == "FILE_TRANSFER_PROTOCOL" and self.files:
                replies += self._file(FtpPayload.unpack(bytes(message.payload)))
            elif message.get_type() == "COMMAND_LONG" and message.target_component == ids.COMPONENT_ID:
                replies.append(self._commanded(message))
            elif message.get_type() == "TUNNEL" and message.payload_type == ids.TUNNEL_ANSWER:
                assert (message.target_system, message.target_component) == (self.system, 191)
                received = Answer.unpack(bytes(message.payload[: message.payload_length]))
                replies += self._answered(*received)
        return replies

    def _file(self, asked: FtpPayload) -> list[bytes]:
        """The replies to a request for a file; a burst comes as one frame each 80 bytes."""
        if asked.opcode == Opcode.OPEN_FILE_RO and asked.path() not in self.files:
            replies = [asked.nak(FtpError.FILE_NOT_FOUND)]
        elif asked.opcode == Opcode.OPEN_FILE_RO:
            self._open_file = self.files[asked.path()]
            replies = [asked.ack(len(self._open_file).to_bytes(4, "little"))]
        elif asked.opcode in (Opcode.READ_FILE, Opcode.BURST_READ_FILE):
            end = asked.offset + asked.size if asked.opcode == Opcode.READ_FILE else len(self._open_file)
            starts = range(asked.offset, end, 80)
            replies = [asked.ack(self._open_file[one : min(one + 80, end)], offset=one) for one in starts]
        else:
            replies = [asked.ack()]
        return [
            self.companion.frame(mavlink.MAVLink_file_transfer_protocol_message(0, 0, 0, one.pack()))
            for one in replies
        ]

    def _commanded(self, message: Any) -> bytes:
        assert (message.target_system, message.target_component) == (self.system, 191)
        assert (message.command, message.param1, message.param2) == (31010, 0, 5)
        self.policies_asked.append(int(message.param3))
        if self.grants:
            self.policy = ids.Policy(int(message.param3))
        return self.companion.frame(mavlink.MAVLink_command_ack_message(31010, 0 if self.grants else 2))

    def _answered(self, answer: Answer, part: int, parts: int) -> list[bytes]:
        known = self._parts.setdefault(answer.transaction, {})
        known[part] = answer
        if len(known) < parts:
            return []
        if answer.transaction not in self._acknowledgements:
            self._acknowledgements[answer.transaction] = self._apply(answer, known)
        reply = self._acknowledgements[answer.transaction]
        return [self.companion.tunnel(ids.TUNNEL_ACKNOWLEDGEMENT, reply), *self.call_frames()]

    def _apply(self, last: Answer, parts: dict[int, Answer]) -> bytes:
        operations = tuple(op for number in sorted(parts) for op in parts[number].operations)
        self.applied.append((last.target, last.motion, operations))
        closes = self.stage_after is ids.Stage.CLOSED
        outcome = ids.Outcome.ANSWERED if closes else ids.Outcome.NONE
        if self.call is not None:
            self.call = replace(self.call, stage=self.stage_after, outcome=outcome)
        return Acknowledgement(
            last.transaction, last.target, self.result, self.stage_after, outcome,
            0.12, 0.2, ids.Reasons.NONE, 99, "thank you",
        ).pack()  # fmt: skip


@pytest.fixture
def thing_call() -> CallReport:
    """An open call about an unknown thing that holds the vehicle."""
    return THING_CALL


@pytest.fixture
def quiet_summary() -> Summary:
    return QUIET_SUMMARY


@pytest.fixture
def tiny_rover() -> Callable[..., TinyRover]:
    """Makes a rover: tiny_rover(system, call)."""
    return TinyRover


@pytest.fixture
def speaker() -> Callable[..., TextSender]:
    """Makes any component: speaker(system, component)."""
    return TextSender


class Sky:
    """A client and a tiny rover with a link between them that loses what it is told to, in virtual time."""

    def __init__(self, rover: Any, ground: TextSender) -> None:
        self.rover, self.ground = rover, ground
        self.client = OperatorClient()
        self.now = 100.0
        self.told: list[ev.Event] = []
        self.sent: list[float] = []
        self.rover_speaks = True
        self.lose_up: Callable[[int], bool] = lambda _: False
        self.lose_down: Callable[[int], bool] = lambda _: False
        self.unheard: set[int] = set()
        self._up = self._down = 0
        self._speak_at = self.now

    def hear(self, *frames: bytes) -> None:
        for message in self.ground.parse(b"".join(frames)):
            self.client.receive(message, self.now)

    def run(self, seconds: float) -> None:
        until = self.now + seconds
        while self.now < until:
            self.now = round(self.now + 0.05, 3)
            if self.rover_speaks and self.now >= self._speak_at:
                self._speak_at = self.now + 1.0
                self._carry_up(self.rover.speak())
            for message in self.client.outgoing(self.now):
                self.sent.append(self.now)
                self._down += 1
                if not self.lose_down(self._down) and not self._never_heard(message):
                    replies = self.rover.hear(self.ground.frame(message))
                    self._carry_up(replies if self.rover_speaks else [])
            self.told += self.client.events()

    def _never_heard(self, message: Any) -> bool:
        if message.get_type() != "TUNNEL":
            return False
        answer, _, _ = Answer.unpack(bytes(message.payload[: message.payload_length]))
        return answer.transaction in self.unheard

    def _carry_up(self, frames: Sequence[bytes]) -> None:
        for frame in frames:
            self._up += 1
            if not self.lose_up(self._up):
                self.hear(frame)

    def answer(
        self, *operations: AnyOperation, motion: ids.Motion = ids.Motion.GO, target: int = 7
    ) -> Pending:
        return self.client.answer(1, Answer(target, motion, operations), self.now)

    def of(self, kind: type[Any]) -> list[Any]:
        return [event for event in self.told if isinstance(event, kind)]


@pytest.fixture
def sky(
    tiny_rover: Callable[..., TinyRover], speaker: Callable[..., TextSender], thing_call: CallReport
) -> Sky:
    return Sky(tiny_rover(1, thing_call), speaker(255, 190))
