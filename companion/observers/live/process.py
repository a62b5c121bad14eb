"""Runs the live view's process: what the supervisor sends goes to each viewer that wants its topic."""

from __future__ import annotations

import logging
import socket
import time
from typing import NoReturn

import foxglove
from foxglove.websocket import ChannelView, Client, WebSocketServer

from anytraverse.release import own_version
from companion.observers.recording.messages import RecordedMessage, take_messages
from companion.observers.recording.topics import TOPICS, Topic
from companion.system.child_process import settle_in
from companion.system.datagrams import Datagram
from companion.system.log_lines import end_process

log = logging.getLogger(__name__)

_MOST_MEMORY = 512 << 20
_MOST_FILES = 256
"""Open files: each connection takes one. Beyond that the server stops to listen, and is started again."""
_MOST_WAITING = 32
"""Messages that wait for a viewer; of more the oldest is dropped. A frame with its maps is five."""
_CHECKED_EVERY = 2.0
_ANSWERS_WITHIN = 0.5


class Viewers:
    """Serves Foxglove's WebSocket protocol, and tells each new viewer what holds.

    Viewers are heard by a thread of the server's own.
    """

    def __init__(self, host: str, port: int) -> None:
        """Listen. port 0: any free one. Raises RuntimeError when it cannot."""
        self._host = host
        self._checked_at = time.monotonic()
        self._holds: dict[Topic, RecordedMessage] = {}
        self._seen_by: dict[int, set[int]] = {}
        """Viewer -> the channels that it wants."""
        self._channels = {
            topic: foxglove.Channel(
                row.name,
                message_encoding=row.encoding,
                schema=foxglove.Schema(name=row.schema, encoding=row.schema_encoding, data=row.schema_data),
            )
            for topic, row in TOPICS.items()
        }
        self._topics = {channel.id(): topic for topic, channel in self._channels.items()}
        self._server: WebSocketServer = foxglove.start_server(
            name=f"AnyTraverse companion {own_version()}",
            host=host,
            port=port,
            server_listener=self,
            message_backlog_size=_MOST_WAITING,
        )

    def report(self, now: float) -> Datagram:
        """Say where it listens, and how many viewers see at least one topic. now: monotonic seconds.

        Raises OSError when it does not listen any more.
        """
        if now - self._checked_at >= _CHECKED_EVERY:
            self._checked_at = now
            socket.create_connection((self._host, self._server.port), _ANSWERS_WITHIN).close()
        return Datagram(b"l", {"port": self._server.port, "clients": len(self._seen_by)})

    def show(self, message: RecordedMessage) -> None:
        """Show a message to whoever wants its topic."""
        if TOPICS[message.topic].standing:
            self._holds[message.topic] = message
        self._channels[message.topic].log(message.data, log_time=message.at)

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Show a viewer what holds of a topic."""
        self._seen_by.setdefault(client.id, set()).add(channel.id)
        topic = self._topics.get(channel.id)
        held = self._holds.get(topic) if topic is not None else None
        if held is not None:
            self._channels[held.topic].log(held.data, log_time=held.at, sink_id=client.id)

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:
        """Forget that a viewer wants a topic."""
        wanted = self._seen_by.get(client.id, set())
        wanted.discard(channel.id)
        if not wanted:
            self._seen_by.pop(client.id, None)


def main(descriptor: int, host: str, port: int) -> NoReturn:
    """Show what the supervisor sends until it is gone. descriptor: of the channel."""
    settle_in(_MOST_MEMORY, NOFILE=_MOST_FILES)
    code = 0
    try:
        foxglove.set_log_level("CRITICAL")  # whoever reaches the port could fill the log
        viewers = Viewers(host, port)
        take_messages(descriptor, viewers.show, lambda: viewers.report(time.monotonic()).encoded())
    except BaseException:
        log.critical("the live view failed", exc_info=True)
        code = 1
    end_process(code)
