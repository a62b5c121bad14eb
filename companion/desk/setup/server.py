"""Serves the pages of a set-up to this computer alone, behind a token."""

from __future__ import annotations

import asyncio
import secrets
import socket
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from companion.desk.setup.session import SetupSession
from companion.desk.setup.threads import DaemonThreads
from companion.pages.access import Gate
from companion.pages.listen import hashed, listen_here
from companion.pages.requests import MOST_POSTED, RequestError, read_object
from companion.pages.site import Server, as_json, static_routes

IDLE = 3600.0
"""Seconds after which it ends when nobody changes or opens anything."""
WITHIN = 30.0
"""Seconds in which a request is carried out: the first judgement loads a network."""
_POSTED_WITHIN = 5.0
_MOST_TOLD, _MOST_DONE = 16, 8
"""Calls at once: of what only tells, and of what changes or judges, which may take seconds."""
_STATIC = Path(__file__).parent / "static"
_WHERE = "the address that `companion setup` printed"

Action = Callable[[Mapping[str, Any]], Any]


class SetupServer:
    """Serves while it is entered, in a thread of its own. url: what to open, with the token."""

    def __init__(
        self, session: SetupSession, port: int = 0, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """port: 0: any free one."""
        self._session = session
        self._port = port
        self._clock = clock
        self._used_at = clock()
        self._telling, self._doing = DaemonThreads(_MOST_TOLD), DaemonThreads(_MOST_DONE)
        self._token = secrets.token_hex(16)
        gate = Gate(
            self._app(),
            token_hash=hashed(self._token),
            own_address="127.0.0.1",
            most_posted=MOST_POSTED,
            where_the_token_is=_WHERE,
        )
        self._server = Server(gate)
        self._thread: threading.Thread | None = None
        self.url, self.port = "", 0

    def __enter__(self) -> SetupServer:
        """Begin to serve. Raises OSError."""
        listener, self.url = listen_here(self._port, self._token)
        self.port = int(listener.getsockname()[1])
        self._thread = threading.Thread(target=self._serve, args=[listener], name="page", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.should_exit = True
        if self._thread is not None:
            self._thread.join(3.0)
        self._session.close()

    @property
    def is_idle(self) -> bool:
        """Whether nobody has changed or opened anything for `IDLE` seconds."""
        return self._clock() - self._used_at > IDLE

    def _serve(self, listener: socket.socket) -> None:
        asyncio.run(self._server.serve(sockets=[listener]))

    def _app(self) -> Starlette:
        told, session = self._told, self._session
        actions = {
            "draft": session.change,
            "forget": session.forget,
            "write": session.write,
            "drag": session.drag,
            "judge": session.judge,
        }
        return Starlette(
            routes=[
                Route("/state.json", told(session.state, used=True)),
                Route("/camera.json", told(session.camera)),
                Route("/frame.jpg", self._picture(lambda: session.live.jpeg)),
                Route("/judged.jpg", self._picture(lambda: session.map.jpeg)),
                Route("/job/{name}.json", self._job),
                Route("/job/{name}", self._start, methods=["POST"]),
                *(Route(f"/{name}", self._posted(act), methods=["POST"]) for name, act in actions.items()),
                *static_routes(_STATIC),
            ]
        )

    def _told(self, tell: Callable[[], Any], *, used: bool = False) -> Callable[[Request], Any]:
        async def answer(_: Request) -> Response:
            if used:
                self._used_at = self._clock()
            return await _within(self._telling, tell)

        return answer

    def _picture(self, newest: Callable[[], bytes]) -> Callable[[Request], Any]:
        async def answer(_: Request) -> Response:
            jpeg = newest()
            if not jpeg:
                return PlainTextResponse("there is no picture yet\n", 404)
            return Response(jpeg, media_type="image/jpeg")

        return answer

    async def _job(self, request: Request) -> Response:
        return as_json(self._session.jobs.document(request.path_params["name"]))

    async def _start(self, request: Request) -> Response:
        name = request.path_params["name"]
        return await self._posted(lambda told: self._session.jobs.start(name, told))(request)

    def _posted(self, act: Action) -> Callable[[Request], Any]:
        async def answer(request: Request) -> Response:
            self._used_at = self._clock()
            try:
                body = await asyncio.wait_for(request.body(), _POSTED_WITHIN)
                told = read_object(body)
            except RequestError as error:
                return as_json({"problem": str(error)}, 409)
            except (TimeoutError, asyncio.TimeoutError, ClientDisconnect):
                return as_json({"problem": "the request did not come whole"}, 408)
            return await _within(self._doing, lambda: act(told))

        return answer


async def _within(threads: DaemonThreads, act: Callable[[], Any]) -> Response:
    """Carry out in a thread, and answer with the result, or with what is wrong."""
    try:
        return as_json(await threads.call(act, WITHIN))
    except RequestError as error:
        return as_json({"problem": str(error)}, 409)
    except asyncio.CancelledError:  # the server ends
        return as_json({"problem": "the set-up ends"}, 503)
    except (TimeoutError, asyncio.TimeoutError):
        return as_json({"problem": f"that did not end within {WITHIN:.0f} s: try again"}, 503)
