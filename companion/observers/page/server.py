"""Runs the web process: takes what the supervisor tells, and serves it to browsers, until it is gone."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import re
import select
import socket
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from prometheus_client import CONTENT_TYPE_LATEST
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from companion.observers.page.answering import Answering
from companion.observers.page.calls import shown_calls
from companion.observers.page.disk import Disk, no_file
from companion.observers.page.files import StateFolder
from companion.observers.page.messages import ALIVE, ANSWER, SETTINGS_REQUEST, WANTED, PageMessageKind
from companion.observers.page.metrics import Metrics
from companion.observers.page.news import SILENT, News
from companion.observers.page.recording_routes import RecordingRoutes
from companion.observers.page.recordings import RecordingsFolder
from companion.observers.page.settings import PageSettings
from companion.pages.access import Gate, WrongTokens
from companion.pages.calls import incident_shown
from companion.pages.requests import MOST_POSTED
from companion.pages.site import EventStreams, Server, as_json, event, is_quiet, posted, static_routes
from companion.system.child_process import settle_in
from companion.system.datagrams import LARGEST, Datagram, decode
from companion.system.log_lines import end_process
from companion.wire.incidents import incidents_from
from companion.wire.json_values import mapping_of

log = logging.getLogger(__name__)

_MOST_MEMORY = 256 << 20
"""Bytes of data. It needs a sixth of it."""
_BEAT = 1.0
_SETUP_WITHIN = 10.0
_STATIC = Path(__file__).parent / "static"
_PICTURE = re.compile(r"([0-9]{1,5})(-large|-raw)?\.jpg", re.ASCII)
_SCENE = re.compile(r"([0-9a-f]{16})\.jpg", re.ASCII)


class PageSite:
    """Answers requests from the news and the state folder."""

    def __init__(
        self,
        news: News,
        folder: StateFolder,
        recordings: RecordingsFolder,
        answering: Answering | None = None,
        ground: Sequence[Mapping[str, Any]] = (),
        settings: PageSettings | None = None,
    ) -> None:
        """answering, settings: None where the page only shows. ground: see `PageMessageKind.SETUP`."""
        self._news = news
        self._answering = answering
        self._settings = settings
        self._folder = folder
        self._ground = ground
        self.wrong_tokens = WrongTokens()
        self._metrics = Metrics(news, self.wrong_tokens)
        self._disk = Disk(2)
        self._recordings = RecordingRoutes(news, recordings, answering)
        self.streams = EventStreams()

    def app(self) -> Starlette:
        """Make the application."""
        routes = [
            Route("/events", self._events),
            Route("/live.jpg", self._live),
            Route("/from_above.png", self._from_above),
            Route("/healthz", self._health),
            Route("/metrics", self._show_metrics),
            Route("/calls.json", self._calls),
            Route("/shown-calls.json", self._shown_calls),
            Route("/calls/{name}", self._picture),
            Route("/scenes/{name}", self._scene),
            Route("/log.txt", self._log),
            *(Route(f"/{name}.json", self._document(name)) for name in ("status", "state", "check")),
            *self._recordings.routes(),
            *static_routes(_STATIC),
        ]
        if self._answering is not None:
            routes.append(Route("/answer", posted(self._answering.answer), methods=["POST"]))
            routes.append(Route("/undo", posted(self._answering.undo), methods=["POST"]))
            routes.append(Route("/incident", posted(self._answering.incident), methods=["POST"]))
            routes.append(Route("/incidents/{name}", self._incident))
        if self._settings is not None:
            routes += self._settings.routes()
        return Starlette(routes=routes)

    async def _events(self, request: Request) -> Response:
        return self.streams.answer(request, lambda: self._told(seen=not is_quiet(request)))

    async def _told(self, *, seen: bool) -> AsyncIterator[bytes]:
        told_at, frame, plotted, answered = None, None, float("-inf"), 0
        answering = self._answering
        yield event("ground", {"lines": self._ground})
        while True:
            news = self._news
            if news.told_at != told_at:
                told_at = news.told_at
                if points := [one for one in news.points if one[0] > plotted]:
                    plotted = points[-1][0]
                    yield event("points", {"points": points})
                yield event("news", {**news.event(), "answers": answering is not None})
            if answering is not None and answering.revision != answered:
                answered = answering.revision
                yield event("answered", {})
            picture = news.shown_picture() if seen else None
            if picture is not None and picture.frame != frame:
                frame = picture.frame
                age, above = round(news.picture_age(), 3), bool(news.from_above)
                yield event("picture", {"frame": frame, "age": age, "from_above": above})
            await news.more(_BEAT)
            if news.told_at == told_at:
                yield b": still here\n\n"

    async def _live(self, _: Request) -> Response:
        picture = self._news.shown_picture()
        if picture is None:
            return PlainTextResponse("no picture of the last seconds\n", 404)
        return Response(picture.jpeg, media_type="image/jpeg", headers={"x-frame": str(picture.frame)})

    async def _from_above(self, _: Request) -> Response:
        if self._news.shown_picture() is None or not self._news.from_above:
            return PlainTextResponse("nothing is known of the ground in metres\n", 404)
        return Response(self._news.from_above, media_type="image/png")

    async def _health(self, _: Request) -> Response:
        trouble, age = self._news.trouble(), self._news.event()["age"]
        shown = {"ok": not trouble, "state": self._news.state or None, "age": age, "why": trouble}
        return as_json(shown, 503 if trouble else 200)

    async def _show_metrics(self, _: Request) -> Response:
        return Response(self._metrics.text(), media_type=CONTENT_TYPE_LATEST)

    def _document(self, name: str) -> Callable[[Request], Any]:
        async def show(_: Request) -> Response:
            if self._news.trouble() == SILENT:
                return as_json({"state": "unknown", "why": SILENT}, 503)
            return as_json(self._news.told.get(name, {}))

        return show

    async def _calls(self, _: Request) -> Response:
        return await self._disk.answer(self._folder.calls, as_json)

    async def _shown_calls(self, _: Request) -> Response:
        state, told_at = self._news.told.get("state", {}), self._news.told_at
        folder, own = self._folder, self._answering.by_call() if self._answering is not None else {}
        incident = self._incidents()
        return await self._disk.answer(
            lambda: shown_calls(state, told_at, folder.calls(), folder.address, own, incident), as_json
        )

    def _incidents(self) -> Callable[[int], dict[str, Any] | None]:
        """Return what tells of the incident files of a call."""
        answering, told = self._answering, incidents_from(mapping_of(self._news.told.get("incidents")))
        if answering is None:
            return lambda _call: None
        return lambda call: incident_shown(
            told, call, answering.asked_for_incident(call), lambda name, _size: {"url": f"/incidents/{name}"}
        )

    async def _incident(self, request: Request) -> Response:
        name = request.path_params["name"]
        return await self._disk.download(
            request, lambda: (f"incident-{name}", self._folder.incident(name)), "application/zip"
        )

    async def _log(self, _: Request) -> Response:
        return await self._disk.answer(self._folder.log, PlainTextResponse)

    async def _picture(self, request: Request) -> Response:
        named = _PICTURE.fullmatch(request.path_params["name"])
        if named is None:
            return no_file()
        return await self._disk.answer(
            lambda: self._folder.picture(int(named[1]), named[2] or ""),
            lambda content: Response(content, media_type="image/jpeg"),
        )

    async def _scene(self, request: Request) -> Response:
        named = _SCENE.fullmatch(request.path_params["name"])
        if named is None:
            return no_file()
        return await self._disk.answer(
            lambda: self._folder.scene(named[1]), lambda content: Response(content, media_type="image/jpeg")
        )


def main(channel: int, listener: int) -> NoReturn:
    """Run until the supervisor is gone. channel, listener: descriptors of sockets."""
    settle_in(_MOST_MEMORY)
    for name in ("uvicorn", "uvicorn.error"):  # one line for each broken request would fill the log
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        asyncio.run(_serve(socket.socket(fileno=channel), socket.socket(fileno=listener)))
    except BaseException:
        log.critical("the page failed", exc_info=True)
    end_process(1)


async def _serve(channel: socket.socket, listener: socket.socket) -> None:
    if not select.select([channel], [], [], _SETUP_WITHIN)[0]:
        raise TimeoutError("the supervisor says nothing")
    kind, setup, _ = decode(channel.recv(LARGEST))
    if kind != PageMessageKind.SETUP:
        raise ValueError("the first message is no setup")
    channel.settimeout(0)
    news = News()
    answering = settings = None
    if setup["token_hash"]:
        settings = PageSettings(lambda asked: _send(channel, Datagram(SETTINGS_REQUEST, asked).encoded()))
        answering = Answering(
            news, lambda payload, now: _send(channel, Datagram(ANSWER, {"at": now}, payload).encoded())
        )
    folder = setup["folder"]
    site = PageSite(news, StateFolder(folder), RecordingsFolder(folder), answering, setup["ground"], settings)
    asyncio.get_running_loop().add_reader(channel, _listen, channel, news, answering, settings)
    most_posted = MOST_POSTED if answering is not None else 0
    gate = Gate(
        site.app(),
        token_hash=setup["token_hash"],
        own_address=setup["own_address"],
        most_posted=most_posted,
        wrong_tokens=site.wrong_tokens,
    )
    server = Server(gate)
    beating = asyncio.create_task(_beat(channel, server, site, answering))
    await server.serve(sockets=[listener])
    beating.cancel()


def _listen(
    channel: socket.socket, news: News, answering: Answering | None, settings: PageSettings | None
) -> None:
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
        message = decode(packed)
        if message.kind == PageMessageKind.ACKNOWLEDGEMENT and answering is not None:
            answering.acknowledge(bytes.fromhex(str(message.content.get("payload"))))
        elif message.kind == PageMessageKind.SETTINGS and settings is not None:
            settings.told = message.content
        elif message.kind == PageMessageKind.SETTINGS_ANSWER and settings is not None:
            settings.answered(message.content)
        else:
            news.take(message)
    except ValueError as error:
        log.error("a message of the supervisor is not understood: %s", error)


def _send(channel: socket.socket, said: bytes) -> None:
    """Tell the supervisor something. It is dropped when too many messages wait."""
    with contextlib.suppress(BlockingIOError):
        channel.send(said)


async def _beat(channel: socket.socket, server: Server, site: PageSite, answering: Answering | None) -> None:
    """Tell the supervisor once a second that this process lives, whether somebody watches, what is due."""
    while True:
        if server.started:
            _send(channel, WANTED if site.streams.seen else ALIVE)
            if answering is not None:
                answering.deliver()
        await asyncio.sleep(_BEAT if server.started else 0.05)
