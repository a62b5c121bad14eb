"""Receives operators' answers, passes each one on once, and sends the acknowledgements."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.link import encode
from companion.link.access_control import AccessControl
from companion.link.alerts import TextSender
from companion.link.inbound import AnswerRequest, ParameterRequest, PolicyRequest, Sender
from companion.link.limits import SenderCache
from companion.link.outbox import Outbox
from companion.link.parameter_server import ParameterServer
from companion.wire import notices
from companion.wire.answers import Acknowledgement, AnswerMessage, ForgetWord, Operation, SetWord
from companion.wire.ids import (
    ANSWER_COMMAND,
    CHANGING_RESULTS,
    SET_POLICY,
    SET_WEIGHT,
    TUNNEL_ACKNOWLEDGEMENT,
    VERSION,
    Motion,
    Outcome,
    Policy,
    Reasons,
    Result,
    Stage,
)
from companion.wire.packing import PayloadError
from companion.wire.parameters import ANSWER

MAX_PARTS = 4
OF_A_SENDER, IN_ALL = 8, 1024
"""Incomplete answers of one sender and in all: more than the senders of one shared rate may begin in 30 s."""
PATIENCE = 30.0
"""s to wait for the next part. A sender that backs off, on a radio that loses half, takes 8 to 16 s."""


@dataclass
class _Pieces:
    newest_at: float
    parts: dict[int, AnswerMessage] = field(default_factory=dict)


class Reassembly:
    """Reassembles answers that come in two to four parts; at most eight of one sender at once."""

    def __init__(self) -> None:
        self._open: SenderCache[_Pieces] = SenderCache(OF_A_SENDER, IN_ALL)

    def add(self, sender: Sender, part: AnswerMessage, now: float) -> AnswerMessage | None:
        """Add a part; return the whole answer, operations in order, when it completes one, else None.

        Raises PayloadError for more than four parts, and for parts that contradict each other.
        """
        if part.parts == 1:
            return part
        if part.parts > MAX_PARTS:
            raise PayloadError(f"{part.parts} parts, at most {MAX_PARTS}")
        key = (sender, part.transaction)
        pieces = self._open.get(key)
        if pieces is None or now - pieces.newest_at >= PATIENCE:
            pieces = _Pieces(now)
        pieces.newest_at = now
        self._open.put(key, pieces)
        if any(_envelope(other) != _envelope(part) for other in pieces.parts.values()):
            self._open.pop(key)
            raise PayloadError("the parts do not belong together")
        pieces.parts[part.part] = part
        if len(pieces.parts) < part.parts:
            return None
        self._open.pop(key)
        operations = tuple(op for number in range(part.parts) for op in pieces.parts[number].operations)
        return replace(part, operations=operations, part=0, parts=1)


def _envelope(part: AnswerMessage) -> tuple[int, int, int]:
    return part.target, part.motion, part.parts


REPEAT_WITHIN = 5.0
"""s in which the same command or AT_ANSWER counts as a repetition."""
MAX_ID = 0xFFFF

_COMMAND_RESULTS = {
    Result.APPLIED: mavlink.MAV_RESULT_ACCEPTED,
    Result.APPLIED_NOT_REMEMBERED: mavlink.MAV_RESULT_ACCEPTED,
    Result.NOT_COVERED: mavlink.MAV_RESULT_ACCEPTED,
    Result.STALE: mavlink.MAV_RESULT_DENIED,
    Result.REFUSED: mavlink.MAV_RESULT_FAILED,
    Result.DENIED: mavlink.MAV_RESULT_DENIED,
    Result.BUSY: mavlink.MAV_RESULT_TEMPORARILY_REJECTED,
}


@dataclass
class _CachedReply:
    """An answer that was passed on at `at` (s), and its stored reply.

    reply: an Acknowledgement; for a command the MAV_RESULT; for AT_ANSWER whether it was accepted. None while
    it is undecided.
    """

    at: float
    reply: Any = None


class AnswerService:
    """Turns TUNNEL 45003, the answer command and AT_ANSWER into one AnswerRequest for each answer.

    A repeated answer gets the stored acknowledgement; while it is undecided, it gets no reply.
    """

    def __init__(
        self, outbox: Outbox, text_sender: TextSender, access: AccessControl, parameters: ParameterServer
    ) -> None:
        self._outbox = outbox
        self._text_sender = text_sender
        self._access = access
        self._parameters = parameters
        self._reassembly = Reassembly()
        self._reply_cache: SenderCache[_CachedReply] = SenderCache()
        # Of its own: whoever sets AT_ANSWER often must not push out a transaction that may come again.
        self._parameter_cache: SenderCache[_CachedReply] = SenderCache()

    def tunnel(self, sender: Sender, payload: bytes, now: float) -> AnswerRequest | None:
        """Take the payload of an answer, or of one part of it; return the answer once it is complete."""
        try:
            part = AnswerMessage.unpack(payload)
        except PayloadError:
            other = bool(payload) and payload[0] != VERSION
            self._access.rejected["version" if other else "payload"] += 1
            if other:
                self._text_sender.refuse(notices.other_version(), now)
            return None
        if not self._access.may_change(sender):
            self._access.rejected["sender"] += 1
            self._text_sender.refuse_sender(sender, now)
            self._reply(sender, _refusal(part, Result.DENIED, "this sender may not answer"), now)
            return None
        if self._is_repeated((sender, part.transaction), now):
            return None
        try:
            whole = self._reassembly.add(sender, part, now)
        except PayloadError as error:
            self._access.rejected["parts"] += 1
            self._reply(sender, _refusal(part, Result.REFUSED, str(error)), now)
            return None
        if whole is None:
            return None
        self._reply_cache.put((sender, part.transaction), _CachedReply(now))
        return AnswerRequest(sender, whole.transaction, whole.target, whole.motion, whole.operations)

    def command(self, sender: Sender, message: Any, now: float) -> AnswerRequest | PolicyRequest | None:
        """Take the answer command. It is always acknowledged, here when it is refused, else by the daemon."""
        if not self._access.may_change(sender):
            self._access.rejected["sender"] += 1
            self._text_sender.refuse_sender(sender, now)
            self._command_ack(sender, mavlink.MAV_RESULT_DENIED, now)
            return None
        if message.param2 == SET_POLICY and (policy := _integer(message.param3, 0, max(Policy))) is not None:
            return PolicyRequest(sender, Policy(policy))
        request = self._read_command(sender, message)
        if request is None:
            self._access.rejected["command"] += 1
            self._command_ack(sender, mavlink.MAV_RESULT_DENIED, now)
            self._text_sender.refuse(notices.refused("p1 id, p2 1-3, 4 index weight, 5 policy"), now)
            return None
        # The same command again is a new answer, unless its confirmation count marks it as a repetition.
        again = getattr(message, "confirmation", 0) > 0
        if self._is_repeated((sender, request), now, repeat_within=REPEAT_WITHIN if again else 0.0):
            return None
        self._reply_cache.put((sender, request), _CachedReply(now))
        return request

    def parameter(self, request: ParameterRequest, now: float) -> AnswerRequest | None:
        """Take AT_ANSWER, an answer without words from a parameter editor: id x 10 + motion; 0 is ignored.

        The echo is the value when it was accepted, else 0; later reads give 0. PARAM_SET has no mark for a
        repetition, so the same "go" or "look again" within 5 s counts as one, with the call's id or with 0.
        "Stay" is passed on each time, as it may follow a go. An answer to id 0 that was stale counts as
        repeated for 5 s, too: ground stations set a refused parameter again by themselves, and would
        otherwise answer a new call that the operator has not read.
        """
        sender, value = request.sender, request.value
        target, code = divmod(int(value), 10)
        if not 1 <= code <= max(Motion):
            if value:
                self._access.rejected["range"] += 1
                self._text_sender.refuse(notices.answer_refused(), now)
            self._parameters.echo(ANSWER, 0.0, sender, now)
            return None
        key = (sender, target, Motion(code))
        case = self._parameter_cache.get(key)
        if case is not None and code != Motion.STAY:
            if case.reply is None and now - case.at <= self._access.undecided_for:
                return None
            if case.reply is not None and now - case.at <= REPEAT_WITHIN:
                self._parameters.echo(ANSWER, value if case.reply else 0.0, sender, now)
                return None
        self._parameter_cache.put(key, _CachedReply(now))
        return AnswerRequest(sender, None, target, Motion(code), (), value)

    def acknowledge(self, request: AnswerRequest, ack: Acknowledgement, now: float) -> None:
        """Send the result to the sender, and store it for repetitions, unless it is BUSY (send it again)."""
        if request.value is not None:
            self._acknowledge_parameter(request, ack, now)
            return
        if request.transaction is None:
            key: tuple[Any, ...] = (request.sender, request)
            reply: Any = _COMMAND_RESULTS[ack.result]
            self._text_sender.answer(ack.text, now, taken=reply == mavlink.MAV_RESULT_ACCEPTED)
            self._command_ack(request.sender, reply, now)
        else:
            key = (request.sender, request.transaction)
            reply = ack
            self._reply(request.sender, ack, now)
        if ack.result == Result.BUSY:
            self._reply_cache.pop(key)
        else:
            self._reply_cache.put(key, _CachedReply(now, reply))

    def _acknowledge_parameter(self, request: AnswerRequest, ack: Acknowledgement, now: float) -> None:
        """Send the result as echo and as text. An answer that was not accepted may be sent again at once."""
        taken = ack.result in CHANGING_RESULTS
        self._text_sender.answer(ack.text, now, taken=taken)
        self._parameters.echo(ANSWER, (request.value or 0.0) if taken else 0.0, request.sender, now)
        # Also under the id that it was applied to: id 0 and then the call's own id are one answer.
        for target in (request.target, ack.target):
            key = (request.sender, target, request.motion)
            self._parameter_cache.pop(key)
            if taken or (ack.result is Result.STALE and request.target == 0):
                self._parameter_cache.put(key, _CachedReply(now, taken))

    def _is_repeated(self, key: tuple[Any, ...], now: float, repeat_within: float = math.inf) -> bool:
        case = self._reply_cache.get(key)
        if case is None:
            return False
        if case.reply is None:
            return now - case.at < self._access.undecided_for
        if now - case.at > repeat_within or repeat_within == 0.0:
            return False
        self._reply_cache.put(key, case)
        if isinstance(case.reply, Acknowledgement):
            self._reply(key[0], case.reply, now)
        else:
            self._command_ack(key[0], case.reply, now)
        return True

    def _reply(self, sender: Sender, ack: Acknowledgement, now: float) -> None:
        message = encode.tunnel(TUNNEL_ACKNOWLEDGEMENT, ack.pack(), sender)
        self._outbox.push("answer ack", message, now, key=(sender, ack.transaction), to=sender)

    def _command_ack(self, sender: Sender, result: int, now: float) -> None:
        self._outbox.push("command ack", encode.command_ack(ANSWER_COMMAND, result, sender), now, to=sender)

    def _read_command(self, sender: Sender, message: Any) -> AnswerRequest | None:
        target = _integer(message.param1, 0, MAX_ID)
        code = _integer(message.param2, 1, SET_WEIGHT)
        if target is None or code is None:
            return None
        if code != SET_WEIGHT:
            return AnswerRequest(sender, None, target, Motion(code), ())
        operation = self._weight(message.param3, message.param4)
        return None if operation is None else AnswerRequest(sender, None, target, Motion.NONE, (operation,))

    def _weight(self, index: float, value: float) -> Operation | None:
        number = _integer(index, 0, MAX_ID)
        entry = None if number is None else self._parameters.at(number)
        if entry is None or entry.word is None or not entry.accepts(value):
            return None
        return ForgetWord(entry.word) if value == entry.special else SetWord(entry.word, round(value, 6))


def _integer(value: float, first: int, last: int) -> int | None:
    if not math.isfinite(value) or value != int(value) or not first <= value <= last:
        return None
    return int(value)


def _refusal(part: AnswerMessage, result: Result, text: str) -> Acknowledgement:
    return Acknowledgement(
        part.transaction, part.target, result, Stage.CLOSED, Outcome.NONE, None, None, Reasons.NONE, 0, text
    )
