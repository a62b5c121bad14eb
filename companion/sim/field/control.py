"""Serves the control channel, outside MAVLink: what a person beside the trail could see and do.

It is loopback TCP with one JSON object a line each way: {"do": "status"} is answered with the status, every
other request with {"ok": true} or {"error": "what to do"}. A client that sends too long a line or does not
read its answers is dropped.
"""

from __future__ import annotations

import contextlib
import json
import selectors
import socket
import time
from collections.abc import Callable, Sequence
from typing import Any

MAX_LINE = 4096
MAX_ANSWER = 1 << 20
MAX_CLIENTS = 8

Handler = Callable[[dict[str, Any]], dict[str, Any]]


class FieldError(Exception):
    """Raised when the field refused a request or is gone. The message says what to do."""


class ControlServer:
    """Serves on 127.0.0.1 with the selector of the caller's loop; `handle` answers one request."""

    def __init__(self, selector: selectors.BaseSelector, handle: Handler) -> None:
        self._selector = selector
        self._handle = handle
        self._clients: dict[socket.socket, _Client] = {}
        self._listening = socket.create_server(("127.0.0.1", 0))
        self._listening.settimeout(0.0)
        self._selector.register(self._listening, selectors.EVENT_READ, self._accept)
        self.address: tuple[str, int] = self._listening.getsockname()

    def close(self) -> None:
        for client in list(self._clients):
            self._drop(client)
        self._selector.unregister(self._listening)
        self._listening.close()

    def _accept(self, _events: int) -> None:
        with contextlib.suppress(OSError):
            client, _ = self._listening.accept()
            if len(self._clients) >= MAX_CLIENTS:
                client.close()
                return
            client.settimeout(0.0)
            self._clients[client] = _Client(client)
            self._selector.register(client, selectors.EVENT_READ, lambda events: self._serve(client, events))

    def _serve(self, key: socket.socket, events: int) -> None:
        client = self._clients[key]
        try:
            if events & selectors.EVENT_READ:
                for line in client.lines():
                    client.write(answer(line, self._handle))
            client.flush()
        except (OSError, FieldError):
            self._drop(key)
            return
        wanted = selectors.EVENT_READ | (selectors.EVENT_WRITE if client.unsent else 0)
        self._selector.modify(key, wanted, lambda events: self._serve(key, events))

    def _drop(self, key: socket.socket) -> None:
        del self._clients[key]
        self._selector.unregister(key)
        key.close()


class _Client:
    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._received = bytearray()
        self.unsent = bytearray()

    def lines(self) -> list[bytes]:
        try:
            chunk = self._connection.recv(MAX_LINE)
        except BlockingIOError:
            return []
        if not chunk:
            raise FieldError("the client hung up")
        self._received += chunk
        *lines, rest = bytes(self._received).split(b"\n")
        if len(rest) > MAX_LINE:
            raise FieldError("the client's line has no end")
        self._received = bytearray(rest)
        return lines

    def write(self, text: bytes) -> None:
        if len(self.unsent) + len(text) > MAX_ANSWER:
            raise FieldError("the client does not read")
        self.unsent += text

    def flush(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while self.unsent:
                del self.unsent[: self._connection.send(self.unsent)]


def answer(line: bytes, handle: Handler) -> bytes:
    """Returns the answer to one line as a line; a line that is no request is answered with an error."""
    try:
        request = json.loads(line)
        if not isinstance(request, dict) or not isinstance(request.get("do"), str):
            raise FieldError('send one JSON object a line, such as {"do": "status"}')
        reply = handle(request)
    except FieldError as reason:
        reply = {"error": str(reason)}
    except (ValueError, RecursionError):
        reply = {"error": 'this is not JSON; send one object a line, such as {"do": "status"}'}
    return json.dumps(reply).encode() + b"\n"


class FieldControl:
    """The client of the control channel: `ask` sends any request, the other methods the common ones.

    It is not safe to use from several threads.
    """

    def __init__(self, host: str, port: int, timeout: float = 5.0) -> None:
        """Connects. Raises FieldError when no field answers within `timeout` s."""
        self._timeout = timeout
        try:
            self._socket = socket.create_connection((host, port), timeout=timeout)
        except OSError as reason:
            raise FieldError(f"no field at {host}:{port} ({reason}): is it running?") from reason
        self._received = bytearray()

    def __enter__(self) -> FieldControl:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._socket.close()

    def ask(self, do: str, **fields: object) -> dict[str, Any]:
        """Sends a request and returns its answer. Raises FieldError: refused, or the field is gone."""
        deadline = time.monotonic() + self._timeout
        try:
            self._socket.settimeout(self._timeout)
            self._socket.sendall(json.dumps({"do": do, **fields}).encode() + b"\n")
            reply = json.loads(self._line(deadline))
        except (OSError, ValueError) as reason:
            self.close()
            raise FieldError(f"the field does not answer ({reason}): connect again") from reason
        if "error" in reply:
            raise FieldError(str(reply["error"]))
        return dict(reply)

    def status(self) -> dict[str, Any]:
        return self.ask("status")

    def look(self, box: Sequence[float], at: float | None = None) -> dict[str, Any]:
        """Says what a box of a picture shows, see `Album.look`. at: monotonic s when it was taken."""
        return self.ask("look", box=list(box), at=at)

    def start(self) -> None:
        """Arms the rover and sets the mode that drives the trail."""
        self.ask("start")

    def mode(self, mode: str) -> None:
        self.ask("mode", mode=mode)

    def rc(self, channel: int, pwm: int) -> None:
        """Moves a switch of the remote control. channel: 5 to 16. pwm: pulse width in us, 800 to 2200."""
        self.ask("rc", channel=channel, pwm=pwm)

    def parameter(self, name: str, value: float) -> None:
        """Sets a parameter of the autopilot, as whoever set the rover up does."""
        self.ask("parameter", name=name, value=value)

    def film(self, fps: float) -> None:
        """Has the camera take so many pictures a second from now on: 0.2 to 60."""
        self.ask("film", fps=fps)

    def remove(self, thing: str) -> None:
        self.ask("remove", id=thing)

    def stop(self) -> None:
        """Ends the field's process."""
        self.ask("stop")

    def _line(self, deadline: float) -> bytes:
        while b"\n" not in self._received:
            self._socket.settimeout(max(0.001, deadline - time.monotonic()))
            chunk = self._socket.recv(65536)
            if not chunk or len(self._received) > MAX_ANSWER:
                raise OSError("it closed the connection or answered without an end")
            self._received += chunk
        line, _, rest = bytes(self._received).partition(b"\n")
        self._received = bytearray(rest)
        return line
