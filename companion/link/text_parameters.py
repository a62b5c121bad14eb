"""Serves the extended parameter protocol: words and weights as text, for clients such as MAVSDK."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.errors import PreferencesError
from anytraverse.operations import Operation
from companion.link import encode
from companion.link.access_control import AccessControl
from companion.link.alerts import TextSender
from companion.link.outbox import Outbox
from companion.link.parameter_server import ListSender, ParameterServer
from companion.wire import notices
from companion.wire.answers import Answer, Via
from companion.wire.ids import Motion, SenderId
from companion.wire.parameters import WORDS_TEXT
from companion.wire.refusals import Rejected
from companion.wire.words_text import read_weight, read_words, weight_text, words_text


class TextParameters:
    """Lists AT_WORDS, then each word's weight. It parses a set, which the daemon applies."""

    def __init__(
        self, outbox: Outbox, text_sender: TextSender, access: AccessControl, parameters: ParameterServer
    ) -> None:
        self._outbox = outbox
        self._text_sender = text_sender
        self._access = access
        self._parameters = parameters
        self._words_of = parameters.words
        self._names = [WORDS_TEXT, *self._words_of]
        self._words = ""
        self._lists = ListSender(outbox, "text list", len(self._names))

    def set_words(self, words: Mapping[str, float]) -> None:
        """Set the words in force."""
        self._words = words_text(words)

    def list_all(self, sender: SenderId) -> None:
        """Answer PARAM_EXT_REQUEST_LIST."""
        self._lists.begin(sender)

    def read(self, sender: SenderId, message: Any, now: float) -> None:
        """Answer PARAM_EXT_REQUEST_READ, by name when the index is -1. An unknown name is only counted."""
        index = message.param_index
        if index < 0:
            index = self._names.index(message.param_id) if message.param_id in self._names else -1
        if 0 <= index < len(self._names):
            self._send("text echo", index, sender, now)
        else:
            self._access.rejected["unknown parameter"] += 1

    def set(self, sender: SenderId, message: Any, now: float) -> Answer | None:
        """Parse PARAM_EXT_SET; acknowledge it here when it is refused, otherwise return it."""
        name, raw = message.param_id, bytes(message._param_value_raw)
        reason: Rejected | None = None
        text = ""
        operations: tuple[Operation, ...] = ()
        if not self._access.may_change(sender):
            reason = "sender"
        elif name not in self._names:
            reason = "unknown parameter"
        elif message.param_type != mavlink.MAV_PARAM_EXT_TYPE_CUSTOM:
            reason, text = "range", notices.refused(f"{name} takes text")
        else:
            try:
                operations = self._read(name, raw)
            except (PreferencesError, UnicodeDecodeError) as error:
                what = "not UTF-8" if isinstance(error, UnicodeDecodeError) else str(error)
                reason, text = "range", notices.refused(what)
        if reason:
            self._access.rejected[reason] += 1
            if reason == "sender":
                self._text_sender.refuse_sender(sender, now)
            elif text:
                self._text_sender.refuse(text, now)
            unsupported = reason == "range"
            result = mavlink.PARAM_ACK_VALUE_UNSUPPORTED if unsupported else mavlink.PARAM_ACK_FAILED
            self._push_ack(sender, message._param_id_raw, self._value(name), result, now)
            return None
        return Answer(0, Motion.NONE, operations, sender=sender, via=Via.TEXT, name=name, raw=raw)

    def acknowledge(self, answer: Answer, result: int, now: float) -> None:
        """Send the result (PARAM_ACK) of a set, with its value, or the one in force if it failed."""
        failed = result == mavlink.PARAM_ACK_FAILED
        value = self._value(answer.name) if failed else answer.raw
        self._push_ack(answer.sender, answer.name.encode(), value, result, now)

    def tick(self, now: float) -> None:
        """Queue the next entries of the lists."""
        for index, to in self._lists.due():
            self._send("text list", index, to, now)

    def _read(self, name: str, raw: bytes) -> tuple[Operation, ...]:
        """Parse a value as set. Raises PreferencesError, UnicodeDecodeError."""
        content, _, rest = raw.partition(b"\0")
        if rest.strip(b"\0"):
            raise PreferencesError("NUL inside the text")
        text = content.decode()
        return read_words(text) if name == WORDS_TEXT else (read_weight(self._words_of[name], text),)

    def _value(self, name: str) -> bytes:
        if name == WORDS_TEXT:
            return self._words.encode()
        return weight_text(self._parameters.value(name)).encode() if name in self._words_of else b""

    def _send(self, row: str, index: int, to: SenderId, now: float) -> None:
        name = self._names[index]
        message = encode.text_parameter(name, self._value(name).decode(), index, len(self._names))
        self._outbox.push(row, message, now, key=index, to=to)

    def _push_ack(self, sender: SenderId, name: bytes, value: bytes, result: int, now: float) -> None:
        message = encode.text_ack(name, value, result)
        self._outbox.push("text ack", message, now, key=(sender, name), to=sender)
