"""Answers requests about recordings: which there are, a moment, a picture, the file."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from companion.observers.page.answering import Answering
from companion.observers.page.disk import Disk, no_file
from companion.observers.page.news import News
from companion.observers.page.recordings import RecordingsFolder
from companion.pages.calls import incident_shown
from companion.pages.site import as_json, posted
from companion.system.side_process import missing_packages
from companion.wire.incidents import MOST_NUMBER, incidents_from
from companion.wire.json_values import mapping_of

MOST_READING = 8
"""Requests that may wait for a recording to be read: they are answered one at a time."""
_NUMBER = re.compile(r"[0-9]{1,9}", re.ASCII)
_AT = re.compile(r"[0-9]{1,12}", re.ASCII)
_MCAP = "application/octet-stream"


class RecordingRoutes:
    """Answers from the recordings in the state folder. A thread of its own reads them, one at a time."""

    def __init__(self, news: News, folder: RecordingsFolder, answering: Answering | None) -> None:
        """answering: None where the page only shows: then no file is given, either."""
        self._news = news
        self._folder = folder
        self._answering = answering
        self._disk = Disk(1, MOST_READING)
        self._missing = missing_packages({"mcap": "mcap", "lz4": "lz4"}, "record")

    def routes(self) -> list[Route]:
        """Return the routes."""
        found = [
            Route("/recordings.json", self._list),
            Route("/recordings/{number}/moment.json", self._moment),
            Route("/recordings/{number}/frame.jpg", self._frame),
        ]
        if self._answering is not None:
            found.append(Route("/recording", posted(self._answering.recording), methods=["POST"]))
            found.append(Route("/recordings/{number}.mcap", self._file))
        return found

    async def _list(self, request: Request) -> Response:
        before = _digits(_NUMBER, request.query_params.get("before", str(MOST_NUMBER)))
        if before is None:
            return no_file()
        told = mapping_of(mapping_of(self._news.told.get("status")).get("recording"))
        on = told.get("on") is True
        if self._missing:
            return as_json({"files": 0, "bytes": 0, "older": False, "recordings": [], "why": self._missing})
        return await self._disk.answer(
            lambda: self._folder.shown(before, on=on), lambda found: as_json(self._with_wishes(found))
        )

    def _with_wishes(self, found: dict[str, Any]) -> dict[str, Any]:
        """Add what was asked for here, and what became of it."""
        answering = self._answering
        if answering is None:
            return found
        told = incidents_from(mapping_of(self._news.told.get("incidents")))
        for row in found["recordings"]:
            number = row["number"]
            row["incident"] = incident_shown(
                told,
                -number,
                answering.asked_for_incident(-number),
                lambda name, _size: {"url": f"/incidents/{name}"},
            )
            row["deletion"] = answering.deletion(number)
        return found

    async def _moment(self, request: Request) -> Response:
        return await self._at(request, self._folder.moment, as_json)

    async def _frame(self, request: Request) -> Response:
        return await self._at(
            request, self._folder.frame, lambda jpeg: Response(jpeg, media_type="image/jpeg")
        )

    async def _at(
        self, request: Request, read: Callable[[int, int], Any], shown: Callable[[Any], Response]
    ) -> Response:
        number = _digits(_NUMBER, request.path_params["number"])
        at = _digits(_AT, request.query_params.get("at", "0"))
        if number is None or at is None or self._missing:
            return no_file()
        try:
            return await self._disk.answer(lambda: read(number, at), shown)
        except MemoryError:
            return PlainTextResponse("it needs too much memory\n", 503)

    async def _file(self, request: Request) -> Response:
        number = _digits(_NUMBER, request.path_params["number"])
        if number is None:
            return no_file()
        return await self._disk.download(request, lambda: self._folder.file(number), _MCAP)


def _digits(form: re.Pattern[str], text: str) -> int | None:
    """Return a number that has this form, None for anything else."""
    return int(text) if form.fullmatch(text) else None
