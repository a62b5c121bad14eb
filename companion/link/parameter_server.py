"""Serves the MAVLink parameter protocol (list, read, set), and all parameters as one file."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from companion.link import encode
from companion.link.access_control import AccessControl
from companion.link.alerts import TextSender
from companion.link.inbound import ParameterRequest
from companion.link.outbox import Outbox
from companion.storage.served_tree import InMemoryFile, MissingError, Opened
from companion.wire import notices
from companion.wire.ids import COMPONENT_ID, SenderId
from companion.wire.parameters import MAX_PARAMETERS, ListOptions, Parameter, ParameterError, pack
from companion.wire.refusals import Rejected


@dataclass
class _Listing:
    """A list that is being sent on one connection. to: newest requester. at: next index. left: entries."""

    to: SenderId
    at: int = 0
    left: int = 0


class ListSender:
    """Sends a list of values entry by entry, one list at a time on each connection.

    A client that requests the list while it is being sent gets all entries from that index on, round to it
    again. So two clients on a connection share one list.
    """

    def __init__(self, outbox: Outbox, row: str, count: int) -> None:
        """row: row of the message table that the entries are sent by. count: entries in the list."""
        self._outbox = outbox
        self._row = row
        self._count = count
        self._lists: dict[str, _Listing] = {}

    def begin(self, sender: SenderId) -> None:
        """Start the list for `sender`, or make the running one go round once more."""
        channel = self._outbox.channel(sender)
        if channel is not None:
            listing = self._lists.setdefault(channel.name, _Listing(sender))
            listing.to, listing.left = sender, self._count

    def due(self) -> Iterator[tuple[int, SenderId]]:
        """Yield index and receiver of each entry to send now: the next one, where none of the row waits."""
        for listing in self._lists.values():
            if listing.left and not self._outbox.waiting(self._row, listing.to):
                yield listing.at, listing.to
                listing.at = (listing.at + 1) % self._count
                listing.left -= 1


FOLDER = "@PARAM"
NAME = "param.pck"


class ParameterFile:
    """Serves the folder `@PARAM`, which holds one file: all parameters, packed."""

    def __init__(self, pack: Callable[[ListOptions], bytes]) -> None:
        """pack: makes the file's content; may raise ValueError."""
        self._pack = pack

    def sizes(self) -> Mapping[str, int]:
        return {NAME: len(self._pack(ListOptions()))}

    def open(self, name: str) -> Opened:
        """Open `param.pck`; options follow a `?`, see `ListOptions.read`. Raises FileError, ValueError."""
        file, _, query = name.partition("?")
        if file != NAME:
            raise MissingError(name)
        return InMemoryFile(self._pack(ListOptions.read(query)))


_DIGITS = 6
_INTEGER_BITS = 1e-30


class ParameterServer:
    """Answers reads itself; checks sets, which the daemon applies and `set_value` then echoes."""

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
        self._requested_by: dict[str, SenderId] = {}
        self._lists = ListSender(outbox, "list", len(self._entries))
        self._configured: Mapping[str, float] = {}

    def at(self, index: int) -> Parameter | None:
        """The parameter with this index; None when there is none."""
        return self._entries[index] if 0 <= index < len(self._entries) else None

    @property
    def words(self) -> Mapping[str, str]:
        """Parameter name -> word, of the parameters that are weights of words, in the list's order."""
        return {entry.name: entry.word for entry in self._entries if entry.word is not None}

    def value(self, name: str) -> float:
        """The value in force of a listed parameter."""
        return self._entries[self._index[name]].value

    def accepts(self, name: str, value: float) -> bool:
        """Whether a listed parameter accepts `value`."""
        return self._entries[self._index[name]].accepts(value)

    def echo(self, name: str, value: float, to: SenderId, now: float) -> None:
        """Send `to` a value that is not stored, for AT_ANSWER, which always reads as 0."""
        index = self._index[name]
        message = encode.parameter(replace(self._entries[index], value=value), index, len(self._entries))
        self._outbox.push("echo", message, now, key=index, to=to)

    def list_all(self, sender: SenderId) -> None:
        """Answer PARAM_REQUEST_LIST."""
        self._lists.begin(sender)

    def packed(self, options: ListOptions) -> bytes:
        """Pack the parameters into a file. Raises ValueError when `options.start` is behind the last one."""
        return pack(self._entries, options, self._configured)

    def read(self, sender: SenderId, message: Any, now: float) -> None:
        """Answer PARAM_REQUEST_READ, by name when the index is -1."""
        index = self._index.get(message.param_id) if message.param_index < 0 else message.param_index
        if index is None or self.at(index) is None:
            self._refuse_unknown(sender, message, message.param_index, now)
            return
        self._send("echo", index, now, sender)

    def set(self, sender: SenderId, message: Any, now: float) -> ParameterRequest | None:
        """Check PARAM_SET of any type; return the request, or echo the old value when it is refused."""
        index = self._index.get(message.param_id)
        if index is None:
            self._refuse_unknown(sender, message, -1, now)
            return None
        entry = self._entries[index]
        if not self._access.permits(sender, now, self._text_sender.refuse_sender):
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

    def set_configured(self, values: Mapping[str, float]) -> None:
        """Set the configured values, name -> value, which a client may request as defaults."""
        self._configured = values

    def echo_in_force(self, name: str, now: float) -> None:
        """Echo the value in force, because a requested one was not accepted."""
        self.set_value(name, self.value(name), now)

    def set_value(self, name: str, value: float, now: float) -> None:
        """Set the value in force. A changed value is sent to all, an unchanged one only to its requester.

        Raises ParameterError for a name that is not listed or a value that it does not accept.
        """
        index = self._index.get(name)
        if index is None or not self._entries[index].accepts(value):
            raise ParameterError(f"{name} = {value:g} cannot be set: not listed, or out of range")
        is_changed = self._entries[index].value != value
        self._entries[index] = replace(self._entries[index], value=value)
        asker = self._requested_by.pop(name, None)
        if asker is not None:
            self._send("echo", index, now, None if is_changed else asker)
        elif is_changed:
            self._send("changed value", index, now)

    def tick(self, now: float) -> None:
        """Queue the next entries of the lists."""
        for index, to in self._lists.due():
            self._send("list", index, now, to)

    def _refuse_unknown(self, sender: SenderId, message: Any, index: int, now: float) -> None:
        """Refuse an unknown parameter, with an error only when we alone were asked.

        A request to all components may be for a parameter of another one.
        """
        self._access.rejected["unknown parameter"] += 1
        if message.target_component == COMPONENT_ID:
            error = encode.no_parameter(message._param_id_raw, index, sender)
            self._outbox.push(
                "no parameter", error, now, key=(sender, message._param_id_raw, index), to=sender
            )

    def _send(self, row: str, index: int, now: float, to: SenderId | None = None) -> None:
        message = encode.parameter(self._entries[index], index, len(self._entries))
        self._outbox.push(row, message, now, key=index, to=to)

    def _refusal(self, entry: Parameter, value: float) -> tuple[Rejected, str] | None:
        if entry.read_only:
            return "read-only", notices.read_only(entry.name)
        # Some clients put an integer's bits in place of the float, which reads as a tiny number.
        is_integer_bits = 0 < abs(value) < _INTEGER_BITS
        if is_integer_bits or not entry.accepts(_rounded(value)):
            return "range", notices.value_refused(entry.name, entry.allowed())
        return None


def _rounded(value: float) -> float:
    return round(value, _DIGITS) if math.isfinite(value) else value
