"""Serves the console's page: events out, answers in."""

from __future__ import annotations

import asyncio
import re
import time
from collections.abc import AsyncIterator, Callable
from functools import partial
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route

from anytraverse.release import own_version
from companion.pages.site import EventStreams, event, posted, static_routes
from gcs_plugin.console.console import Console
from gcs_plugin.console.export import MOST_CALLS
from gcs_plugin.console.requests import read_request
from gcs_plugin.console.rover_desk import RoverDesk
from gcs_plugin.console.track import Background

CYCLE = 0.02
_TELL_EVERY = 0.05
"""Seconds between two events on one stream, at least."""
_BEAT = 1.0
_STATIC = Path(__file__).parent / "static"
_EXPORT = re.compile(rf"(?:all|([0-9]{{1,5}}(?:,[0-9]{{1,5}}){{0,{MOST_CALLS - 1}}}))\.zip", re.ASCII)
_PICTURE = re.compile(r"(small|raw|large|nearest|place)\.jpg", re.ASCII)


class ConsoleSite:
    """Answers the page's requests."""

    def __init__(
        self, console: Console, about: Callable[[], dict[str, Any]], background: Background | None = None
    ) -> None:
        """about: returns "links", their "problems", and "doubled", how many messages two links brought."""
        self._console = console
        self._tell_about = about
        self._background = background
        self._streams = EventStreams()

    def app(self) -> Starlette:
        """Make the application."""
        posts = [
            Route(f"/{kind}", posted(partial(self._carry_out, kind)), methods=["POST"])
            for kind in ("answer", "policy", "undo", "fetch", "incident", "stop")
        ]
        pictures = Route("/pictures/{system:int}/{call:int}/{name}", self._picture)
        ground = Route("/pictures/{system:int}/ground.png", self._ground)
        export = Route("/export/{system:int}/{name}", self._export)
        incident = Route("/incidents/{system:int}/{name}", self._incident)
        background = Route("/background", self._show_background)
        gets = [Route("/events", self._events), background, pictures, ground, export, incident]
        return Starlette(routes=[*gets, *posts, *static_routes(_STATIC)])

    def _carry_out(self, kind: str, body: bytes) -> str:
        return self._console.carry_out(*read_request(kind, body), time.monotonic(), time.time())

    async def _picture(self, request: Request) -> Response:
        named = _PICTURE.fullmatch(request.path_params["name"])
        system, call = request.path_params["system"], request.path_params["call"]
        jpeg = self._console.picture(system, call, named[1]) if named is not None else None
        if jpeg is None:
            return PlainTextResponse("there is no such picture\n", 404)
        return Response(jpeg, media_type="image/jpeg")

    async def _ground(self, request: Request) -> Response:
        png = self._console.ground(request.path_params["system"])
        if png is None:
            return PlainTextResponse("there is no such picture\n", 404)
        return Response(png, media_type="image/png")

    async def _export(self, request: Request) -> Response:
        """Answer with a zip: of all calls, or of those whose numbers stand in the path."""
        system, named = request.path_params["system"], _EXPORT.fullmatch(request.path_params["name"])
        packed = None
        if named is not None:
            numbers = [int(one) for one in (named[1] or "").split(",") if one]
            packed = self._console.export(system, numbers, time.monotonic(), time.time())
        if packed is None:
            return PlainTextResponse("there are no such calls\n", 404)
        which = "calls" if named is None or named[1] is None or "," in named[1] else f"call-{int(named[1])}"
        saved_as = f'attachment; filename="rover-{system}-{which}.zip"'
        return Response(packed, media_type="application/zip", headers={"content-disposition": saved_as})

    async def _incident(self, request: Request) -> Response:
        system, name = request.path_params["system"], request.path_params["name"]
        path = self._console.incident(system, name)
        if path is None or not path.is_file():
            return PlainTextResponse("there is no such file\n", 404)
        return FileResponse(path, media_type="application/zip", filename=path.name)

    async def _show_background(self, _: Request) -> Response:
        if self._background is None:
            return PlainTextResponse("there is no such picture\n", 404)
        return Response(self._background.content, media_type=self._background.kind)

    async def _events(self, request: Request) -> Response:
        return self._streams.answer(request, self._news)

    async def _news(self) -> AsyncIterator[bytes]:
        told = _Told()
        yield event("fresh", {})  # points and timeline are told from their beginning
        while True:
            for chunk in told.news(self._console, self._about()):
                yield chunk
            await self._more(told)

    def _about(self) -> dict[str, Any]:
        corners = None if self._background is None else self._background.corners
        return {"version": own_version(), "background": corners, **self._tell_about()}

    async def _more(self, told: _Told) -> None:
        """Wait until there is something new, a beat at most."""
        await asyncio.sleep(_TELL_EVERY)
        deadline = time.monotonic() + _BEAT - _TELL_EVERY
        while told.revision == self._console.revision and time.monotonic() < deadline:
            await asyncio.sleep(CYCLE)


class _Told:
    """What one stream was told: each plotted point and each entry of the timeline only once."""

    def __init__(self) -> None:
        self.revision = -1
        self._told: dict[RoverDesk, tuple[int, int, int]] = {}
        """How many points, entries and revisions of the track there were, by desk."""

    def news(self, console: Console, about: dict[str, Any]) -> list[bytes]:
        self.revision = console.revision
        found, before, self._told = [], self._told, {}
        for system, desk in console.desks.items():
            points, entries, track = before.get(desk, (0, 0, 0))
            if fresh := desk.summaries - points:
                found.append(event("points", {"system": system, "points": list(desk.points)[-fresh:]}))
            if added := desk.entries - entries:
                found.append(event("timeline", {"system": system, "entries": list(desk.timeline)[-added:]}))
            if desk.track.revision != track:
                found.append(event("track", {"system": system, "points": desk.track.points}))
            self._told[desk] = desk.summaries, desk.entries, desk.track.revision
        found.append(event("news", {**about, "rovers": console.documents(time.monotonic())}))
        return found
