"""What both pages' servers do alike: serve files of the page, JSON and events, and run on a socket."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import uvicorn
from starlette.requests import ClientDisconnect, Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp

from companion.pages.access import BoundedConnection
from companion.pages.requests import RequestError

MOST_STREAMS = 8
_EVENT_STREAM = "text/event-stream"
_SHARED = Path(__file__).parent / "static"
_TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
HEAD = b"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<link rel="icon" href="/favicon.svg" type="image/svg+xml">
<link rel="stylesheet" href="/look.css">
<link rel="stylesheet" href="/style.css">
<script type="module" src="/main.js"></script>
"""
FOOT = b"""  <p id="about"></p>
</footer>
<p id="say" class="unseen" role="status" aria-live="assertive"></p>
</body>
</html>
"""
"""What each index.html is served between: the file begins with its title, and ends within its footer."""
_LARGEST_HEADER = 16 << 10
_POSTED_WITHIN = 5.0
_LAST_ANSWERS = 0.1
_LEAVES_WITHIN = 2
"""Seconds after which the answers that still wait are cancelled."""


def static_routes(folder: Path) -> list[Route]:
    """Make a route for each file of the page in `folder`, and for those that both pages share.

    They are read once, here. index.html is "/", between `HEAD` and `FOOT`.
    """
    found = {}
    for file in (*sorted(_SHARED.iterdir()), *sorted(folder.iterdir())):
        if file.suffix in _TYPES:
            path, content = f"/{file.name}", file.read_bytes()
            if file.name == "index.html":
                path, content = "/", HEAD + content + FOOT
            found[path] = Route(path, _fixed(content, _TYPES[file.suffix]))
    return list(found.values())


def _fixed(content: bytes, kind: str) -> Callable[[Request], Any]:
    async def show(_: Request) -> Response:
        return Response(content, media_type=kind)

    return show


def as_json(content: Any, status: int = 200) -> Response:
    """Answer with JSON."""
    return Response(json.dumps(content, separators=(",", ":")), status, media_type="application/json")


def event(name: str, content: Mapping[str, Any]) -> bytes:
    """Encode an event. clock: when it was made, in monotonic seconds, since it may wait on a slow network."""
    stamped = {**content, "clock": round(time.monotonic(), 3)}
    return f"event: {name}\ndata: {json.dumps(stamped, separators=(',', ':'))}\n\n".encode()


def posted(carry_out: Callable[[bytes], str]) -> Callable[[Request], Any]:
    """Make what answers a POST. carry_out: takes its body; returns what was done, or raises RequestError."""

    async def done(body: bytes, _asked_from: str) -> Mapping[str, Any]:
        return {"done": carry_out(body)}

    return posted_later(done)


def posted_later(
    carry_out: Callable[[bytes, str], Awaitable[Mapping[str, Any]]],
) -> Callable[[Request], Any]:
    """Make what answers a POST with what `carry_out` returns. It takes the body, and who asks, an address.

    It has a deadline of its own, and raises RequestError.
    """

    async def answer(request: Request) -> Response:
        try:
            body = await asyncio.wait_for(request.body(), _POSTED_WITHIN)
        except (TimeoutError, asyncio.TimeoutError, ClientDisconnect):
            return as_json({"problem": "the request did not come whole"}, 408)
        try:
            return as_json(await carry_out(body, request.client.host if request.client else ""))
        except RequestError as error:
            return as_json({"problem": str(error)}, 409)

    return answer


class EventStreams:
    """Answers with streams of events, at most `MOST_STREAMS` at once.

    open: how many there are. seen: how many of them somebody sees: a page in the background asks for a
    "?quiet" one, to hear of calls alone.
    """

    def __init__(self) -> None:
        self.open = self.seen = 0

    def answer(self, request: Request, chunks: Callable[[], AsyncIterator[bytes]]) -> Response:
        """Answer with the events that `chunks` makes; with 503 when too many are open."""
        if request.method == "HEAD":
            return Response(media_type=_EVENT_STREAM)
        if self.open >= MOST_STREAMS:
            return PlainTextResponse(f"{MOST_STREAMS} pages are open: close one\n", 503)
        seen = not is_quiet(request)
        return StreamingResponse(self._counted(chunks, seen=seen), media_type=_EVENT_STREAM)

    async def _counted(
        self, chunks: Callable[[], AsyncIterator[bytes]], *, seen: bool
    ) -> AsyncIterator[bytes]:
        if self.open >= MOST_STREAMS:  # others that asked at the same moment came first
            return
        self.open += 1
        self.seen += seen
        try:
            async for chunk in chunks():
                yield chunk
        finally:
            self.open -= 1
            self.seen -= seen


def is_quiet(request: Request) -> bool:
    """Whether a page in the background asks."""
    return "quiet" in request.query_params


class Server(uvicorn.Server):  # type: ignore[misc]  # it is Any for mypy
    """Serves an application over bounded connections. It leaves signals to the process that runs it.

    Set `should_exit` to end it: answers that are on their way have `_LAST_ANSWERS` s.
    """

    def __init__(self, app: ASGIApp) -> None:
        super().__init__(
            uvicorn.Config(
                app,
                http=BoundedConnection,
                ws="none",
                lifespan="off",
                loop="asyncio",
                log_config=None,
                access_log=False,
                proxy_headers=False,
                server_header=False,
                h11_max_incomplete_event_size=_LARGEST_HEADER,
                timeout_graceful_shutdown=_LEAVES_WITHIN,
            )
        )

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End, and abort what is open: streams of events have no end, and who takes nothing delays none."""
        asyncio.get_running_loop().call_later(_LAST_ANSWERS, self._abort)
        await super().shutdown(sockets)

    def _abort(self) -> None:
        for connection in list(self.server_state.connections):
            connection.transport.abort()

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals alone."""
        yield
