"""The parameter protocol: list, read, set; and all parameters as one file."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from companion.link import encode
from companion.link.access_control import AccessControl
from companion.link.alerts import TextSender
from companion.link.inbound import ParameterRequest, Sender
from companion.link.outbox import Outbox
from companion.storage.served_tree import Held, MissingError, Opened
from companion.wire import notices
from companion.wire.ids import COMPONENT_ID
from companion.wire.packed_parameters import Asked, pack
from companion.wire.parameters import MAX_PARAMETERS, Parameter, ParameterError
from companion.wire.refusals import Rejected


@dataclass
class _Listing:
    """A list on one connection: who asked last, what is next, how many are left."""

    to: Sender
    at: int = 0
    left: int = 0


class ListSender:
    """Whoever asks while a list is told gets it round once from there: two on a connection cost one list."""

    def __init__(self, outbox: Outbox, row: str, count: int) -> None:
        """row: of the message table. count: values in the list."""
        self._outbox = outbox
        self._row = row
        self._count = count
        self._lists: dict[str, _Listing] = {}

    def begin(self, sender: Sender) -> None:
        """`sender` asks for all."""
        channel = self._outbox.channel(sender)
        if channel is not None:
            listing = self._lists.setdefault(channel.name, _Listing(sender))
            listing.to, listing.left = sender, self._count

    def due(self) -> Iterator[tuple[int, Sender]]:
        """Index and receiver of what is to be told now: the next one where none of the row waits."""
        for listing in self._lists.values():
            if listing.left and not self._outbox.waiting(self._row, listing.to):
                yield listing.at, listing.to
                listing.at = (listing.at + 1) % self._count
                listing.left -= 1


FOLDER = "@PARAM"
NAME = "param.pck"


class ParameterFile:
    """A folder of the tree that holds this one file."""

    def __init__(self, pack: Callable[[Asked], bytes]) -> None:
        """pack: makes it; may raise ValueError."""
        self._pack = pack

    def sizes(self) -> Mapping[str, int]:
        return {NAME: len(self._pack(Asked()))}

    def open(self, name: str) -> Opened:
        """With what is asked behind a `?`. Raises FileError, ValueError."""
        file, _, query = name.partition("?")
        if file != NAME:
            raise MissingError(name)
        return Held(self._pack(Asked.read(query)))


_DIGITS = 6
_INTEGER_BITS = 1e-30


class ParameterServer:
    """Answers reads by itself; a set is checked here, applied by the daemon and echoed by `changed`."""

    def __init__(
        self, outbox: Outbox, text_sender: TextSender, access: AccessControl, parameters: Sequence[Parameter]
    ) -> None:
        if len(parameters) > MAX_PARAMETERS:
            raise ParameterError(f"{len(parameters)} parameters, at most {MAX_PARAMETERS}")
        self._outbox = outbox
        self._text_sender = text_sender
        self._access = access
        self._entries = list(parameters)
        self._index = {entry.name: index for index, entry in enumerate(self._entries)}
        self._requested_by: dict[str, Sender] = {}
        self._lists = ListSender(outbox, "list", len(self._entries))
        self.configured: Mapping[str, float] = {}
        """Name -> the configured value, as far as it is known."""

    def at(self, index: int) -> Parameter | None:
        """The parameter with this index."""
        return self._entries[index] if 0 <= index < len(self._entries) else None

    @property
    def words(self) -> Mapping[str, str]:
        """Name of a weight's parameter -> its word, in the list's order."""
        return {entry.name: entry.word for entry in self._entries if entry.word is not None}

    def value(self, name: str) -> float:
        """The value in force of a parameter that is listed."""
        return self._entries[self._index[name]].value

    def accepts(self, name: str, value: float) -> bool:
        """Whether a parameter that is listed takes `value`."""
        return self._entries[self._index[name]].accepts(value)

    def echo(self, name: str, value: float, to: Sender, now: float) -> None:
        """Tell `to` a value that is not kept: what was asked of a parameter that always reads the same."""
        index = self._index[name]
        message = encode.parameter(replace(self._entries[index], value=value), index, len(self._entries))
        self._outbox.push("echo", message, now, key=index, to=to)

    def list_all(self, sender: Sender) -> None:
        """PARAM_REQUEST_LIST."""
        self._lists.begin(sender)

    def packed(self, asked: Asked) -> bytes:
        """The list as a file. Raises ValueError where it begins behind the last one."""
        return pack(self._entries, asked, self.configured)

    def read(self, sender: Sender, message: Any, now: float) -> None:
        """PARAM_REQUEST_READ, by name when the index is -1."""
        index = self._index.get(message.param_id) if message.param_index < 0 else message.param_index
        if index is None or self.at(index) is None:
            self._refuse_unknown(sender, message, message.param_index, now)
            return
        self._send("echo", index, now, sender)

    def set(self, sender: Sender, message: Any, now: float) -> ParameterRequest | None:
        """PARAM_SET of any type; the old value is echoed when it is refused."""
        index = self._index.get(message.param_id)
        if index is None:
            self._refuse_unknown(sender, message, -1, now)
            return None
        entry = self._entries[index]
        if not self._access.may_change(sender):
            self._access.rejected["sender"] += 1
            self._text_sender.refuse_sender(sender, now)
            self._send("echo", index, now, sender)
            return None
        refusal = self._refusal(entry, message.param_value)
        if refusal is not None:
            reason, text = refusal
            self._access.rejected[reason] += 1
            self._text_sender.refuse(text, now)
            self._send("echo", index, now, sender)
            return None
        self._requested_by[entry.name] = sender
        return ParameterRequest(sender, entry.name, round(message.param_value, _DIGITS))

    def changed(self, name: str, value: float, now: float) -> None:
        """The value in force: told to whoever asked, and to all when it changed by itself.

        Raises ParameterError for a name that is not listed or a value that it cannot have.
        """
        index = self._index.get(name)
        if index is None or not self._entries[index].accepts(value):
            raise ParameterError(f"{name} = {value:g} cannot be told: not listed, or out of range")
        is_changed = self._entries[index].value != value
        self._entries[index] = replace(self._entries[index], value=value)
        asker = self._requested_by.pop(name, None)
        if asker is not None:
            self._send("echo", index, now, None if is_changed else asker)
        elif is_changed:
            self._send("news", index, now)

    def tick(self, now: float) -> None:
        """Feed the lists."""
        for index, to in self._lists.due():
            self._send("list", index, now, to)

    def _refuse_unknown(self, sender: Sender, message: Any, index: int, now: float) -> None:
        """What was asked of everybody may well be another component's."""
        self._access.rejected["unknown parameter"] += 1
        if message.target_component == COMPONENT_ID:
            error = encode.no_parameter(message._param_id_raw, index, sender)
            self._outbox.push(
                "no parameter", error, now, key=(sender, message._param_id_raw, index), to=sender
            )

    def _send(self, row: str, index: int, now: float, to: Sender | None = None) -> None:
        message = encode.parameter(self._entries[index], index, len(self._entries))
        self._outbox.push(row, message, now, key=index, to=to)

    def _refusal(self, entry: Parameter, value: float) -> tuple[Rejected, str] | None:
        if entry.read_only:
            return "read-only", notices.read_only(entry.name)
        # An integer's bits in the float's place read as a number next to nothing.
        is_integer_bits = 0 < abs(value) < _INTEGER_BITS
        if is_integer_bits or not entry.accepts(_rounded(value)):
            return "range", notices.value_refused(entry.name, entry.allowed())
        return None


def _rounded(value: float) -> float:
    return round(value, _DIGITS) if math.isfinite(value) else value
