"""Receives operators' answers, passes each one on once, and sends the acknowledgements."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import ForgetWord, Operation, OtherPlace, SetWord
from companion.link import encode
from companion.link.access_control import REQUESTS_AT_ONCE, REQUESTS_PER_SECOND, AccessControl
from companion.link.alerts import TextSender
from companion.link.answer_store import AnswerStore
from companion.link.inbound import ParameterRequest, PolicyRequest
from companion.link.limits import TokenBucket
from companion.link.outbox import Outbox
from companion.link.parameter_server import ParameterServer
from companion.link.reassembly import Reassembly
from companion.link.text_parameters import TextParameters
from companion.wire import notices
from companion.wire.answers import COMMANDS, Acknowledgement, Answer, Via
from companion.wire.ids import (
    ANSWER_COMMAND,
    CHANGING_RESULTS,
    OTHER_PLACE,
    PAGE_SENDER,
    REFUSE_MATCH,
    SET_POLICY,
    SET_WEIGHT,
    TUNNEL_ACKNOWLEDGEMENT,
    VERSION,
    Motion,
    Policy,
    Result,
    SenderId,
)
from companion.wire.packing import PayloadError
from companion.wire.parameters import ANSWER

MAX_ID = 0xFFFF

_MOST_FROM_PAGE = 64
_PAGE_WAITED = 1.0
"""s after which an answer of the page is dropped, since one of us was stopped. It comes again if meant."""
_COMMAND_RESULTS = {
    Result.APPLIED: mavlink.MAV_RESULT_ACCEPTED,
    Result.APPLIED_NOT_REMEMBERED: mavlink.MAV_RESULT_ACCEPTED,
    Result.NOT_COVERED: mavlink.MAV_RESULT_ACCEPTED,
    Result.STALE: mavlink.MAV_RESULT_DENIED,
    Result.REFUSED: mavlink.MAV_RESULT_FAILED,
    Result.DENIED: mavlink.MAV_RESULT_DENIED,
    Result.BUSY: mavlink.MAV_RESULT_TEMPORARILY_REJECTED,
}


TRACKING = {
    Via.TRACK_POINT: int(mavlink.MAV_CMD_CAMERA_TRACK_POINT),
    Via.TRACK_RECTANGLE: int(mavlink.MAV_CMD_CAMERA_TRACK_RECTANGLE),
}


class AnswerService:
    """Turns TUNNEL 45003, the answer command, AT_ANSWER and texts into answers, and acknowledges each.

    So it does with the payloads that come from the rover's own page. They do not pass the link.

    A repeated answer is not passed on: it gets the reply that the store has. While it is undecided, a TEXT is
    reported to be in progress, and the others get no reply.
    """

    def __init__(
        self,
        outbox: Outbox,
        text_sender: TextSender,
        access: AccessControl,
        parameters: ParameterServer,
        texts: TextParameters,
        store: AnswerStore,
    ) -> None:
        self._outbox = outbox
        self._text_sender = text_sender
        self._access = access
        self._parameters = parameters
        self._texts = texts
        self._store = store
        self._reassembly = Reassembly()
        self._from_page: deque[tuple[bytes, float]] = deque(maxlen=_MOST_FROM_PAGE)
        self._page_rate = TokenBucket(REQUESTS_PER_SECOND, REQUESTS_AT_ONCE, 0.0)
        self.to_page: Callable[[Acknowledgement], None] = lambda _acknowledgement: None
        """Takes the acknowledgement of an answer that was given on the page."""

    def receive_from_page(self, payload: bytes, at: float) -> None:
        """Take a payload of the page, as `tunnel` does, for the next `poll_page`. at: s, when it was sent."""
        self._from_page.append((payload, at))

    def poll_page(self, now: float) -> Iterator[Answer]:
        """Return the complete answers that the page gave just now, no more than a sender may give."""
        while self._from_page:
            payload, at = self._from_page.popleft()
            if now - at <= _PAGE_WAITED and self._page_rate.take(1.0, now):
                received = self._unpacked(PAGE_SENDER, Via.PAGE, payload, now)
                answer = None if received is None else self._completed(*received, now)
                if answer is not None:
                    yield answer

    def tunnel(self, sender: SenderId, payload: bytes, now: float) -> Answer | None:
        """Take the payload of an answer, or of one part of it; return the answer once it is complete."""
        received = self._unpacked(sender, Via.TUNNEL, payload, now)
        if received is None:
            return None
        if not self._access.permits(sender, now, self._text_sender.refuse_sender):
            denied = _of_part(received[0], Result.DENIED, "this sender may not answer")
            self._push_ack(sender, denied, now)
            return None
        return self._completed(*received, now)

    def command(self, sender: SenderId, message: Any, now: float) -> Answer | PolicyRequest | None:
        """Take the answer command. It is always acknowledged, here when it is refused, else by the daemon."""
        if not self._access.permits(sender, now, self._text_sender.refuse_sender):
            self._command_ack(sender, mavlink.MAV_RESULT_DENIED, now)
            return None
        if message.param2 == SET_POLICY and (policy := _integer(message.param3, 0, max(Policy))) is not None:
            return PolicyRequest(sender, Policy(policy))
        answer = self._read_command(sender, message)
        if answer is None:
            self._access.rejected["command"] += 1
            self._command_ack(sender, mavlink.MAV_RESULT_DENIED, now)
            self._text_sender.refuse(notices.refused("p2 1-3, 4 weight, 5 policy, 6 other place"), now)
            return None
        return self.admit(answer, now)

    def parameter(self, request: ParameterRequest, now: float) -> Answer | None:
        """Take AT_ANSWER, an answer without words from a parameter editor: id x 10 + motion; 0 is ignored.

        4 in the place of a motion refuses the newest match.
        The echo is the value when it was accepted, else 0; later reads give 0.
        """
        target, code = divmod(int(request.value), 10)
        if code == OTHER_PLACE:
            return self.admit(_refusal(request.sender, Via.AT_ANSWER, target), now)
        if not 1 <= code <= max(Motion):
            if request.value:
                self._access.rejected["range"] += 1
                self._text_sender.refuse(notices.answer_refused(), now)
            self._parameters.echo(ANSWER, 0.0, request.sender, now)
            return None
        return self.admit(Answer(target, Motion(code), sender=request.sender, via=Via.AT_ANSWER), now)

    def admit(self, answer: Answer, now: float) -> Answer | None:
        """Return a new answer, for the daemon to decide; None for a repeated one, or one text too many."""
        if self._is_repeated(answer, now):
            return None
        if not self._store.begin(answer, now):
            self._texts.acknowledge(answer, mavlink.PARAM_ACK_FAILED, now)
            return None
        return answer

    def acknowledge(self, answer: Answer, reply: Acknowledgement, now: float) -> None:
        """Send the result of an answer to its sender, and store it for repetitions."""
        if answer.via in COMMANDS or answer.via is Via.AT_ANSWER:
            self._text_sender.send_result(reply.text, now, accepted=reply.result in CHANGING_RESULTS)
        self._reply(answer, reply, now)
        self._store.finish(answer, reply, now)

    def _is_repeated(self, answer: Answer, now: float) -> bool:
        """Whether an answer is a repetition; it then gets its reply, if that is decided."""
        known = self._store.find(answer, now)
        if known is None:
            return False
        _, reply = known
        if reply is not None:
            self._reply(answer, reply, now)
        elif answer.via is Via.TEXT:
            self._texts.acknowledge(answer, mavlink.PARAM_ACK_IN_PROGRESS, now)
        return True

    def _reply(self, answer: Answer, reply: Acknowledgement, now: float) -> None:
        accepted = reply.result in CHANGING_RESULTS
        match answer.via:
            case Via.TUNNEL:
                self._push_ack(answer.sender, reply, now)
            case Via.PAGE:
                self.to_page(reply)
            case Via.COMMAND:
                self._command_ack(answer.sender, _COMMAND_RESULTS[reply.result], now)
            case Via.TRACK_POINT | Via.TRACK_RECTANGLE:
                command = TRACKING[answer.via]
                message = encode.command_ack(command, _COMMAND_RESULTS[reply.result], answer.sender)
                self._outbox.push("camera ack", message, now, to=answer.sender)
            case Via.AT_ANSWER:
                value = _parameter_value(answer) if accepted else 0
                self._parameters.echo(ANSWER, float(value), answer.sender, now)
            case Via.TEXT:
                result = mavlink.PARAM_ACK_ACCEPTED if accepted else mavlink.PARAM_ACK_FAILED
                self._texts.acknowledge(answer, result, now)

    def _unpacked(
        self, sender: SenderId, via: Via, payload: bytes, now: float
    ) -> tuple[Answer, int, int] | None:
        try:
            answer, part, parts = Answer.unpack(payload)
            return replace(answer, sender=sender, via=via), part, parts
        except PayloadError:
            other = bool(payload) and payload[0] != VERSION
            self._access.rejected["version" if other else "payload"] += 1
            if other:
                self._text_sender.refuse(notices.other_version(), now)
            return None

    def _completed(self, answer: Answer, part: int, parts: int, now: float) -> Answer | None:
        """Return the answer that this part completes, if it is new."""
        if self._is_repeated(answer, now):  # of a long answer, one part suffices
            return None
        try:
            whole = self._reassembly.add(answer, part, parts, now)
        except PayloadError as error:
            self._access.rejected["parts"] += 1
            self._reply(answer, _of_part(answer, Result.REFUSED, str(error)), now)
            return None
        return None if whole is None else self.admit(whole, now)

    def _push_ack(self, sender: SenderId, ack: Acknowledgement, now: float) -> None:
        message = encode.tunnel(TUNNEL_ACKNOWLEDGEMENT, ack.pack(), sender)
        self._outbox.push("answer ack", message, now, key=(sender, ack.transaction), to=sender)

    def _command_ack(self, sender: SenderId, result: int, now: float) -> None:
        self._outbox.push("command ack", encode.command_ack(ANSWER_COMMAND, result, sender), now, to=sender)

    def _read_command(self, sender: SenderId, message: Any) -> Answer | None:
        target = _integer(message.param1, 0, MAX_ID)
        code = _integer(message.param2, 1, REFUSE_MATCH)
        if target is None or code is None or code == SET_POLICY:
            return None
        # The same command again is a new answer, unless this count, which COMMAND_INT lacks, is above 0.
        again = getattr(message, "confirmation", 0)
        if code == REFUSE_MATCH:
            return replace(_refusal(sender, Via.COMMAND, target), confirmation=again)
        if code != SET_WEIGHT:
            return Answer(target, Motion(code), sender=sender, via=Via.COMMAND, confirmation=again)
        operation = self._weight(message.param3, message.param4)
        if operation is None:
            return None
        return Answer(target, Motion.NONE, (operation,), sender=sender, via=Via.COMMAND, confirmation=again)

    def _weight(self, index: float, value: float) -> Operation | None:
        number = _integer(index, 0, MAX_ID)
        entry = None if number is None else self._parameters.at(number)
        if entry is None or entry.word is None or not entry.accepts(value):
            return None
        return ForgetWord(entry.word) if value == entry.special else SetWord(entry.word, round(value, 6))


def _of_part(part: Answer, result: Result, text: str) -> Acknowledgement:
    return Acknowledgement.without_figures(part.transaction, part.target, result, text)


def _refusal(sender: SenderId, via: Via, call_id: int) -> Answer:
    return Answer(0, Motion.NONE, (OtherPlace(call_id),), sender=sender, via=via)


def _parameter_value(answer: Answer) -> int:
    match answer.operations:
        case (OtherPlace(call_id),):
            return 10 * call_id + OTHER_PLACE
    return 10 * answer.target + answer.motion


def _integer(value: float, first: int, last: int) -> int | None:
    if not math.isfinite(value) or value != int(value) or not first <= value <= last:
        return None
    return int(value)
