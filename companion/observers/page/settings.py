"""Has settings of the file looked at and changed by the supervisor, for browsers, one request at a time."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Callable, Mapping
from typing import Any

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from companion.observers.page.messages import LONGEST_SAID
from companion.pages.requests import RequestError, read_object
from companion.pages.site import as_json, posted_later
from companion.system.datagrams import Datagram
from companion.wire.json_values import mapping_of

ANSWERED_WITHIN = 40.0
"""Seconds that the supervisor has. It gives each step less itself, and says why it failed."""


class PageSettings:
    """Answers what browsers ask about settings. told: what the supervisor says of them, {} before it does."""

    def __init__(self, send: Callable[[Mapping[str, Any]], None], within: float = ANSWERED_WITHIN) -> None:
        """send: sends a request to the supervisor, or drops it; ValueError: it is too long. within: s."""
        self._send = send
        self._within = within
        self._open: tuple[str, asyncio.Future[Mapping[str, Any]]] | None = None
        """The request that waits, by its id."""
        self.told: Mapping[str, Any] = {}

    def routes(self) -> list[Route]:
        """Make the routes."""
        return [
            Route("/settings.json", self._show),
            Route("/settings/look", posted_later(self._look), methods=["POST"]),
            Route("/settings/write", posted_later(self._write), methods=["POST"]),
        ]

    def answered(self, content: Mapping[str, Any]) -> None:
        """Take what became of a request. One that nobody waits for any more is let go."""
        if self._open is not None and self._open[0] == content.get("id") and not self._open[1].done():
            self._open[1].set_result(content)

    async def _show(self, _: Request) -> Response:
        return as_json(self.told)

    async def _look(self, body: bytes, asked_from: str) -> Mapping[str, Any]:
        """Have it said what changes would change."""
        changes = read_object(body).get("changes")
        if not isinstance(changes, dict) or not changes:
            raise RequestError("changes is an object of settings")
        rows = {row["key"]: row for row in map(mapping_of, self.told.get("rows", ())) if "key" in row}
        for key in changes:
            if key not in rows:
                raise RequestError(f"{key[:64]} is no setting of this page")
            if rows[key].get("shell") is not False:
                raise RequestError(f"only in the shell, by `companion config set`: {key}")
        return await self._ask({"changes": changes}, asked_from)

    async def _write(self, body: bytes, asked_from: str) -> Mapping[str, Any]:
        """Have written what was looked at."""
        proposal = read_object(body).get("proposal")
        if not isinstance(proposal, str) or not 0 < len(proposal) <= 64:
            raise RequestError("proposal is the name of what was looked at")
        return await self._ask({"write": proposal}, asked_from)

    async def _ask(self, asked: Mapping[str, Any], asked_from: str) -> Mapping[str, Any]:
        if self._open is not None:
            raise RequestError("another change is being looked at or made: wait for it")
        self._open = secrets.token_hex(8), asyncio.get_running_loop().create_future()
        try:
            request = {"id": self._open[0], "asked_from": asked_from[:64], **asked}
            if len(Datagram(b" ", request).encoded()) > LONGEST_SAID:
                raise RequestError("that is too much at once: change less")
            self._send(request)
            answer = await asyncio.wait_for(self._open[1], self._within)
        except (TimeoutError, asyncio.TimeoutError) as error:
            raise RequestError(
                "the companion did not answer: look what is so before you try again"
            ) from error
        except ValueError as error:
            raise error if isinstance(error, RequestError) else RequestError(str(error)) from error
        finally:
            self._open = None
        return answer
