"""Runs the web process: takes what the supervisor tells, and serves it to browsers, until it is gone."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import re
import resource
import select
import signal
import socket
import sys
import time
import traceback
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import BoundedSemaphore
from typing import Any, NoReturn, TypeVar

import uvicorn
from prometheus_client import CONTENT_TYPE_LATEST
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route

from companion.web.access import BoundedConnection, Gate
from companion.web.files import StateFolder
from companion.web.messages import ALIVE, LARGEST, WANTED, Kind, decode
from companion.web.metrics import Metrics
from companion.web.news import SILENT, News

log = logging.getLogger(__name__)

_MOST_MEMORY = 256 << 20
"""Bytes of data. It needs a sixth of it."""
MOST_STREAMS = 8
_BEAT = 1.0
_DISK_PATIENCE = 5.0
MOST_READING = 16
"""Requests that may wait for the disk."""
_LARGEST_HEADER = 16 << 10
_SETUP_WITHIN = 10.0
_STATIC = Path(__file__).parent / "static"
_TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
_STREAM = "text/event-stream"
_PICTURE = re.compile(r"([0-9]{1,5})(-large)?\.jpg", re.ASCII)
_SCENE = re.compile(r"([0-9a-f]{16})\.jpg", re.ASCII)
_T = TypeVar("_T")


class Site:
    """Answers requests from the news and the state folder."""

    def __init__(self, news: News, folder: StateFolder) -> None:
        self._news = news
        self._folder = folder
        self._metrics = Metrics(news)
        self._disk = ThreadPoolExecutor(2, "disk")
        self._reading = BoundedSemaphore(MOST_READING)
        self.streams = 0
        """Open event streams: as many pages as are watched."""

    def app(self) -> Starlette:
        """Make the application."""
        routes = [
            Route("/events", self._events),
            Route("/live.jpg", self._live),
            Route("/healthz", self._health),
            Route("/metrics", self._show_metrics),
            Route("/calls.json", self._calls),
            Route("/calls/{name}", self._picture),
            Route("/scenes/{name}", self._scene),
            Route("/log.txt", self._log),
            *(Route(f"/{name}.json", self._document(name)) for name in ("status", "state", "check")),
            *(Route(path, _fixed(content, kind)) for path, content, kind in _static()),
        ]
        return Starlette(routes=routes)

    async def _events(self, request: Request) -> Response:
        if request.method == "HEAD":
            return Response(media_type=_STREAM)
        if self.streams >= MOST_STREAMS:
            return PlainTextResponse(f"{MOST_STREAMS} pages are open: close one\n", 503)
        return StreamingResponse(self._stream(), media_type=_STREAM)

    async def _stream(self) -> AsyncIterator[bytes]:
        if self.streams >= MOST_STREAMS:  # others that asked at the same moment came first
            return
        self.streams += 1
        try:
            told_at, frame = None, None
            while True:
                news = self._news
                if news.told_at != told_at:
                    told_at = news.told_at
                    yield _event("news", news.event())
                picture = news.shown_picture()
                if picture is not None and picture.frame != frame:
                    frame = picture.frame
                    yield _event("picture", {"frame": frame, "age": round(news.picture_age(), 3)})
                await news.more(_BEAT)
                if news.told_at == told_at:
                    yield b": still here\n\n"
        finally:
            self.streams -= 1

    async def _live(self, _: Request) -> Response:
        picture = self._news.shown_picture()
        if picture is None:
            return PlainTextResponse("no picture of the last seconds\n", 404)
        return Response(picture.jpeg, media_type="image/jpeg", headers={"x-frame": str(picture.frame)})

    async def _health(self, _: Request) -> Response:
        trouble, age = self._news.trouble(), self._news.event()["age"]
        shown = {"ok": not trouble, "state": self._news.state or None, "age": age, "why": trouble}
        return _json(shown, 503 if trouble else 200)

    async def _show_metrics(self, _: Request) -> Response:
        return Response(self._metrics.text(), media_type=CONTENT_TYPE_LATEST)

    def _document(self, name: str) -> Callable[[Request], Any]:
        async def show(_: Request) -> Response:
            if self._news.trouble() == SILENT:
                return _json({"state": "unknown", "why": SILENT}, 503)
            return _json(self._news.told.get(name, {}))

        return show

    async def _calls(self, _: Request) -> Response:
        return await self._read(self._folder.calls, _json)

    async def _log(self, _: Request) -> Response:
        return await self._read(self._folder.log, PlainTextResponse)

    async def _picture(self, request: Request) -> Response:
        named = _PICTURE.fullmatch(request.path_params["name"])
        if named is None:
            return PlainTextResponse("there is no such file\n", 404)
        return await self._read(
            lambda: self._folder.picture(int(named[1]), large=named[2] is not None),
            lambda content: Response(content, media_type="image/jpeg"),
        )

    async def _scene(self, request: Request) -> Response:
        named = _SCENE.fullmatch(request.path_params["name"])
        if named is None:
            return PlainTextResponse("there is no such file\n", 404)
        return await self._read(
            lambda: self._folder.scene(named[1]),
            lambda content: Response(content, media_type="image/jpeg"),
        )

    async def _read(self, read: Callable[[], _T], shown: Callable[[_T], Response]) -> Response:
        """Answer with what the disk has: 404 without such a file, 503 from a disk that is slow or fails."""
        if not self._reading.acquire(blocking=False):
            return PlainTextResponse("the disk is slow: ask again later\n", 503)
        running = self._disk.submit(read)
        running.add_done_callback(lambda _: self._reading.release())
        try:
            return shown(await asyncio.wait_for(asyncio.wrap_future(running), _DISK_PATIENCE))
        except FileNotFoundError:
            return PlainTextResponse("there is no such file\n", 404)
        except (OSError, TimeoutError, asyncio.TimeoutError) as error:
            return PlainTextResponse(f"the disk cannot be read: {error or 'it is slow'}\n", 503)


def _static() -> Iterator[tuple[str, bytes, str]]:
    """Yield path, content and type of each file of the page. They are read once, at the start."""
    for file in sorted(_STATIC.iterdir()):
        if file.suffix in _TYPES:
            path = "/" if file.name == "index.html" else f"/{file.name}"
            yield path, file.read_bytes(), _TYPES[file.suffix]


def _fixed(content: bytes, kind: str) -> Callable[[Request], Any]:
    async def show(_: Request) -> Response:
        return Response(content, media_type=kind)

    return show


def _json(content: Any, status: int = 200) -> Response:
    return Response(json.dumps(content, separators=(",", ":")), status, media_type="application/json")


def _event(name: str, content: Mapping[str, Any]) -> bytes:
    """Encode an event. clock: when it was made, in monotonic seconds, since it may wait on a slow network."""
    stamped = {**content, "clock": round(time.monotonic(), 3)}
    return f"event: {name}\ndata: {json.dumps(stamped, separators=(',', ':'))}\n\n".encode()


class _Server(uvicorn.Server):  # type: ignore[misc]  # it is Any for mypy
    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals alone: the supervisor gets them, too, and ends this process."""
        yield


def main(channel: int, listener: int) -> NoReturn:
    """Run until the supervisor is gone. channel, listener: descriptors of sockets."""
    with contextlib.suppress(OSError, ValueError):  # this computer's limit is lower
        resource.setrlimit(resource.RLIMIT_DATA, (_MOST_MEMORY, _MOST_MEMORY))
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    for name in ("uvicorn", "uvicorn.error"):  # one line for each broken request would fill the log
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        asyncio.run(_serve(socket.socket(fileno=channel), socket.socket(fileno=listener)))
    except BaseException:
        traceback.print_exc()
    sys.stderr.flush()
    os._exit(1)  # a thread may still wait for the disk


async def _serve(channel: socket.socket, listener: socket.socket) -> None:
    if not select.select([channel], [], [], _SETUP_WITHIN)[0]:
        raise TimeoutError("the supervisor says nothing")
    kind, setup, _ = decode(channel.recv(LARGEST))
    if kind is not Kind.SETUP:
        raise ValueError("the first message is no setup")
    channel.settimeout(0)
    news = News()
    site = Site(news, StateFolder(setup["folder"]))
    config = uvicorn.Config(
        Gate(site.app(), token=setup["token"], own_address=setup["own_address"]),
        http=BoundedConnection,
        ws="none",
        lifespan="off",
        loop="asyncio",
        log_config=None,
        access_log=False,
        proxy_headers=False,
        server_header=False,
        h11_max_incomplete_event_size=_LARGEST_HEADER,
    )
    asyncio.get_running_loop().add_reader(channel, _listen, channel, news)
    server = _Server(config)
    beating = asyncio.create_task(_beat(channel, server, site))
    await server.serve(sockets=[listener])
    beating.cancel()


def _listen(channel: socket.socket, news: News) -> None:
    """Take a message of the supervisor. Ends the process when the supervisor is gone."""
    try:
        packed = channel.recv(LARGEST)
    except (BlockingIOError, InterruptedError):
        return
    except OSError:
        packed = b""
    if not packed:
        os._exit(0)
    try:
        news.take(decode(packed))
    except ValueError as error:
        log.error("a message of the supervisor is not understood: %s", error)


async def _beat(channel: socket.socket, server: uvicorn.Server, site: Site) -> None:
    """Tell the supervisor once a second that this process lives, and whether somebody watches."""
    while True:
        if server.started:
            with contextlib.suppress(BlockingIOError):
                channel.send(WANTED if site.streams else ALIVE)
        await asyncio.sleep(_BEAT if server.started else 0.05)
