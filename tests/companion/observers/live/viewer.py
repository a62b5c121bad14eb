"""A viewer as Foxglove is one: it decodes messages by the schemas that are advertised."""

from __future__ import annotations

import base64
import json
import struct
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from math import inf
from typing import Any, NamedTuple

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from jsonschema import Draft202012Validator
from websockets import Subprotocol
from websockets.sync.client import connect

SUBPROTOCOL = "foxglove.sdk.v1"
_DATA = struct.Struct("<BIQ")
"""Opcode, subscription and time in ns since 1970, before a message's content."""
_FRAME = 1


class Seen(NamedTuple):
    """A decoded message. at: ns since 1970. content: of protobuf, or of JSON."""

    topic: str
    at: int
    content: Any


class Viewer:
    """Connects to a live view, and wants all topics, or some."""

    def __init__(self, url: str, topics: set[str] | None = None) -> None:
        """Connect, and take what is advertised."""
        self._closing = ExitStack()
        self._socket = self._closing.enter_context(
            connect(url, subprotocols=[Subprotocol(SUBPROTOCOL)], max_size=None)
        )
        assert self._socket.subprotocol == SUBPROTOCOL
        self.server = self._told("serverInfo")
        self.channels: Mapping[str, Any] = {one["topic"]: one for one in self._told("advertise")["channels"]}
        self._decoders = {one["id"]: _decoder(one) for one in self.channels.values()}
        self._topics = {one["id"]: topic for topic, one in self.channels.items()}
        wanted = [one["id"] for topic, one in self.channels.items() if topics is None or topic in topics]
        self.send(
            json.dumps(
                {"op": "subscribe", "subscriptions": [{"id": each, "channelId": each} for each in wanted]}
            )
        )

    def send(self, message: str | bytes) -> None:
        """Send something."""
        self._socket.send(message)

    def read(self, seconds: float = 0.0, most: float = inf) -> list[Seen]:
        """Return what has come, and what comes within so many seconds until there are `most` messages."""
        found, until = list[Seen](), time.monotonic() + seconds
        with suppress(TimeoutError):
            while len(found) < most:
                said = self._socket.recv(max(0.001, until - time.monotonic()))
                if isinstance(said, bytes) and said[0] == _FRAME:
                    _, subscription, at = _DATA.unpack_from(said)
                    content = self._decoders[subscription](said[_DATA.size :])
                    found.append(Seen(self._topics[subscription], at, content))
        return found

    def close(self) -> None:
        """Leave."""
        self._closing.close()

    def _told(self, operation: str) -> Any:
        said = json.loads(self._socket.recv(10.0))
        assert said["op"] == operation
        return said


def _decoder(channel: Mapping[str, Any]) -> Callable[[bytes], Any]:
    if channel["encoding"] == "json":
        validator = Draft202012Validator(json.loads(channel["schema"]))

        def read(data: bytes) -> Any:
            content = json.loads(data)
            # A field may be null where nothing is known.
            known = {name: value for name, value in content.items() if value is not None}
            validator.validate(known)
            return content

        return read
    files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    found: Any = message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))
    decode: Callable[[bytes], Any] = found.FromString
    return decode
