"""Answers COMMAND_LONG and COMMAND_INT, except the answer command: messages on request, rates, storage."""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.release import own_version
from companion.link import encode
from companion.link.access_control import AccessControl
from companion.link.alerts import TextSender
from companion.link.inbound import ParameterRequest, PolicyRequest, ResetRequest
from companion.link.outbox import Outbox
from companion.link.parameter_server import ParameterServer
from companion.wire.ids import ANSWER_COMMAND, SenderId
from companion.wire.messages import MESSAGES
from companion.wire.parameters import NUMBER_RATE, SUMMARY_RATE

ACCEPTED: int = mavlink.MAV_RESULT_ACCEPTED
LATER: int = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
DENIED: int = mavlink.MAV_RESULT_DENIED
UNSUPPORTED: int = mavlink.MAV_RESULT_UNSUPPORTED
STORAGE_LOAD, STORAGE_SAVE, STORAGE_RESET = 0, 1, 2
_HEARTBEAT = mavlink.MAVLINK_MSG_ID_HEARTBEAT
_SUMMARY = mavlink.MAVLINK_MSG_ID_TUNNEL
_NUMBER = mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT
_VERSION = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
_RATES = {_SUMMARY: (SUMMARY_RATE, "summary"), _NUMBER: (NUMBER_RATE, "number")}
_SECOND = 1_000_000
_NEVER, _DEFAULT, _UNKNOWN = -1, 0, 0
_LONGEST = 2**31 - 1
_Request = ParameterRequest | ResetRequest


class CommandService:
    """Executes commands and acknowledges each. Any sender may read; only allowed senders change values."""

    def __init__(
        self, outbox: Outbox, text_sender: TextSender, access: AccessControl, parameters: ParameterServer
    ) -> None:
        self._outbox = outbox
        self._text_sender = text_sender
        self._access = access
        self._parameters = parameters
        self._version = encode.autopilot_version(own_version())

    def receive(self, sender: SenderId, message: Any, now: float) -> _Request | None:
        """Take a COMMAND_LONG or COMMAND_INT; execute it here, or return the request for the daemon."""
        result: int
        request: _Request | None = None
        first, second = message.param1, message.param2
        match message.command:
            case mavlink.MAV_CMD_REQUEST_MESSAGE:
                result = self._send_newest(first, sender, now)
            case mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
                result = self._send_newest(_VERSION, sender, now) if first == 1 else DENIED
            case mavlink.MAV_CMD_GET_MESSAGE_INTERVAL:
                result = self._send_interval(first, sender, now)
            case mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                result, request = self._set_rate(first, second, sender, now)
            case mavlink.MAV_CMD_PREFLIGHT_STORAGE if first == STORAGE_RESET and self._allowed(sender, now):
                return ResetRequest(sender)
            case mavlink.MAV_CMD_PREFLIGHT_STORAGE:
                # Nothing to do for load and save: the daemon stores each change as it is made.
                result = ACCEPTED if first in (STORAGE_LOAD, STORAGE_SAVE) else DENIED
            case _:
                result = UNSUPPORTED
        self._acknowledge(sender, message.command, result, now)
        return request

    def acknowledge(self, request: PolicyRequest | ResetRequest, result: int, now: float) -> None:
        """Send the result (MAV_RESULT) of a request that the daemon decided."""
        reset = isinstance(request, ResetRequest)
        command = mavlink.MAV_CMD_PREFLIGHT_STORAGE if reset else ANSWER_COMMAND
        self._acknowledge(request.sender, command, result, now)

    def _allowed(self, sender: SenderId, now: float) -> bool:
        return self._access.permits(sender, now, self._text_sender.refuse_sender)

    def _send_newest(self, message_id: float, to: SenderId, now: float) -> int:
        """Send the newest message of this id once, from the budget for replies; return the MAV_RESULT."""
        channel = self._outbox.channel(to)
        if message_id == _VERSION:
            messages, row = [self._version], "version"
        elif channel is None:
            return LATER
        elif message_id == _HEARTBEAT:
            messages, row = [channel.periodic.newest_heartbeat()], "heartbeat asked"
        elif message_id == _SUMMARY:
            summary = channel.periodic.newest_summary(to, now)
            messages, row = [] if summary is None else [summary], "summary asked"
        elif message_id == _NUMBER:
            messages, row = channel.periodic.newest_numbers(now), "number asked"
        else:
            return UNSUPPORTED
        for index, message in enumerate(messages):
            self._outbox.push(row, message, now, key=(to, index), to=to)
        return ACCEPTED if messages else LATER

    def _send_interval(self, message_id: float, to: SenderId, now: float) -> int:
        if not 0 <= message_id <= 0xFFFF or message_id != int(message_id):
            return DENIED
        rate = self._parameters.value(_RATES[int(message_id)][0]) if message_id in _RATES else None
        if message_id == _HEARTBEAT:
            interval = _SECOND
        elif rate is not None:
            interval = min(_LONGEST, round(_SECOND / rate)) if rate else _NEVER
        else:
            interval = _NEVER if message_id == _VERSION else _UNKNOWN
        message = encode.message_interval(int(message_id), interval)
        self._outbox.push("interval reply", message, now, key=(to, message_id), to=to)
        return ACCEPTED

    def _set_rate(
        self, message_id: float, interval: float, sender: SenderId, now: float
    ) -> tuple[int, ParameterRequest | None]:
        """Translate an interval (us) into a request to set the rate's parameter. The heartbeat's is fixed."""
        if not self._allowed(sender, now):
            return DENIED, None
        if message_id == _HEARTBEAT:
            return (ACCEPTED if interval in (_DEFAULT, _SECOND) else DENIED), None
        if message_id not in _RATES:
            return UNSUPPORTED, None
        name, row = _RATES[int(message_id)]
        if interval == _NEVER:
            rate = 0.0
        elif interval == _DEFAULT:
            rate = 1.0 / (MESSAGES[row].period or 1.0)
        elif math.isfinite(interval) and interval > 0:
            rate = round(_SECOND / interval, 6)
        else:
            return DENIED, None
        if not self._parameters.accepts(name, rate):
            return DENIED, None
        return ACCEPTED, ParameterRequest(sender, name, rate)

    def _acknowledge(self, sender: SenderId, command: int, result: int, now: float) -> None:
        self._outbox.push("command ack", encode.command_ack(command, result, sender), now, to=sender)
