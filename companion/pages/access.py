"""Lets in who may see the page, and bounds what each connection may take."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import logging
import math
import socket
import time
from collections.abc import Iterable
from typing import Any
from urllib.parse import parse_qs

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from companion.pages.listen import hashed
from companion.system.error_guard import ErrorGuard

log = logging.getLogger(__name__)

HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "cache-control": "no-store",
}
_LONGEST_QUERY = 512
_MOST_HEADERS = 8 << 10
"""Bytes of a request's headers, names and values."""
_HERE = frozenset({"localhost", "127.0.0.1", "[::1]"})
_KNOWN_FOR = 30 * 24 * 3600
"""Seconds for which a browser need not say the token again."""
_SLOWED = 0.5
"""Seconds until a wrong token is answered."""
_LOG_EVERY = 60.0


class WrongTokens:
    """Counts requests with a wrong token, and logs them once a minute at most."""

    def __init__(self) -> None:
        self.count = 0
        self._logged_at = -math.inf

    def note(self, sender: str) -> None:
        """Count a request. sender: its address."""
        self.count += 1
        now = time.monotonic()
        if now - self._logged_at >= _LOG_EVERY:
            self._logged_at = now
            log.warning("a wrong token from %s, %d since the start", sender or "nowhere", self.count)


class _LateResponse(PlainTextResponse):  # type: ignore[misc]  # it is Any for mypy
    """Is sent after `_SLOWED`, so that nobody tries tokens fast: a connection takes one at a time."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        await asyncio.sleep(_SLOWED)
        await super().__call__(scope, receive, send)


class Gate:
    """Checks each request before the page sees it, and adds `HEADERS` to each answer."""

    def __init__(
        self,
        app: ASGIApp,
        *,
        token_hash: str,
        own_address: str,
        origin: str = "",
        most_posted: int = 0,
        where_the_token_is: str = "[web] token in companion.toml",
        wrong_tokens: WrongTokens | None = None,
    ) -> None:
        """token_hash: of `hashed`, "" where no token is needed. own_address: where it listens if only this
        computer reaches it, else "".

        origin: "http://HOST:PORT" as browsers elsewhere open it; then it answers to no other name but this
        computer's own. most_posted: bytes of JSON that a POST may bring; 0: the page only shows.
        wrong_tokens: where they are counted.
        """
        self._app = app
        self._origin = origin
        self._most_posted = most_posted
        self._hint = where_the_token_is
        self._token_hash = token_hash
        self._wrong_tokens = wrong_tokens or WrongTokens()
        itself = f"[{own_address}]" if ":" in own_address else own_address
        named = {itself, _host(origin.partition("://")[2])} - {""}
        self._names = _HERE | named if named else None
        """What a request may call this computer; None: anything."""
        self._guard = ErrorGuard(lambda _now: None)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return

        async def answer(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = [
                    *message.get("headers", ()),
                    *((k.encode(), v.encode()) for k, v in HEADERS.items()),
                ]
                if message["status"] >= 400:  # so that a refused body is not read
                    headers.append((b"connection", b"close"))
                message = {**message, "headers": headers}
            await send(message)

        refusal, connection = self._refusal(scope), scope.get("state", {}).get("connection")
        if refusal is None and connection is not None:
            connection.let_in = True
        with self._guard.survived("a request", asyncio.get_running_loop().time()):
            await (self._app if refusal is None else refusal)(scope, receive, answer)

    def _refusal(self, scope: Scope) -> Response | None:
        """Return the answer to a request that may not pass, None for one that may."""
        headers = Headers(scope=scope)
        if sum(len(name) + len(value) for name, value in headers.raw) > _MOST_HEADERS:
            return PlainTextResponse(f"headers of at most {_MOST_HEADERS} bytes, please\n", 431)
        posted = scope["method"] == "POST" and self._most_posted > 0
        if not posted and scope["method"] not in ("GET", "HEAD"):
            taken = "GET, HEAD, POST" if self._most_posted else "GET, HEAD"
            return PlainTextResponse(f"this page takes {taken}\n", 405, {"allow": taken})
        if (not posted and headers.get("content-length", "0") != "0") or "transfer-encoding" in headers:
            return PlainTextResponse("a request without a body, please\n", 413)
        # Another site's name may lead here (DNS rebinding), and its scripts would read the page.
        if self._names is not None and _host(headers.get("host", "")) not in self._names:
            return PlainTextResponse("open it as http://localhost and the port\n", 421)
        if headers.get("sec-fetch-site") in ("cross-site", "same-site") and scope["path"] != "/":
            return PlainTextResponse("another site may not load this\n", 403)
        refusal = self._without_token(scope, headers) if self._token_hash else None
        return self._of_post(headers) if posted and refusal is None else refusal

    def _of_post(self, headers: Headers) -> Response | None:
        """Return the answer to a POST that may not pass: one of another site, or of no browser's page."""
        if headers.get("origin") not in {self._origin or None, f"http://{headers.get('host', '')}"} - {None}:
            return PlainTextResponse("only the page itself may send this\n", 403)
        if headers.get("sec-fetch-site", "same-origin") != "same-origin":
            return PlainTextResponse("only the page itself may send this\n", 403)
        if headers.get("content-type", "").partition(";")[0].strip().lower() != "application/json":
            return PlainTextResponse("send JSON\n", 415)
        length = headers.get("content-length", "")
        if not (length.isascii() and length.isdecimal()) or int(length[:9]) > self._most_posted:
            return PlainTextResponse(f"at most {self._most_posted} bytes, please\n", 413)
        return None

    def _without_token(self, scope: Scope, headers: Headers) -> Response | None:
        """Return the answer to a request that neither knows the token nor has a cookie that says so."""
        port, now = (scope.get("server") or ("", 0))[1], int(time.time())
        # A browser knows cookies by computer, not by port, and over ssh two rovers' pages are on localhost.
        name = f"anytraverse-{self._proof(f'name {port}')[:8]}"
        kind, _, given = headers.get("authorization", "").partition(" ")
        bearer = given.strip() if kind.lower() == "bearer" else ""
        if bearer and self._is_token(bearer):
            return None
        query = parse_qs(scope["query_string"][:_LONGEST_QUERY].decode("latin-1")).get("token", [""])[-1]
        if query and self._is_token(query):  # with a cookie, too: it must leave the address bar
            shown, until = RedirectResponse("/", 303), now + _KNOWN_FOR
            shown.set_cookie(
                name, self._cookie(until, port), max_age=_KNOWN_FOR, httponly=True, samesite="strict"
            )
            return shown
        if any(self._is_valid(one, port, now) for one in _cookies(headers, name)):
            return None
        why = f"this page needs its token: open it as http://.../?token=... ({self._hint})\n"
        if bearer or query:
            self._wrong_tokens.note((scope.get("client") or ("",))[0])
            return _LateResponse(why, 401, {"www-authenticate": "Bearer"})
        return PlainTextResponse(why, 401, {"www-authenticate": "Bearer"})

    def _is_valid(self, cookie: str, port: int, now: int) -> bool:
        """Return whether we made a cookie for this port, at most 30 days ago by our clock."""
        until = cookie.partition(".")[0]
        if not (until.isascii() and until.isdecimal() and len(until) <= 12):
            return False
        made = hmac.compare_digest(cookie.encode(), self._cookie(int(until), port).encode())
        return made and now <= int(until) <= now + _KNOWN_FOR

    def _cookie(self, until: int, port: int) -> str:
        """Return the value of the cookie that counts until then, in seconds since 1970."""
        return f"{until}.{self._proof(f'until {until} {port}')}"

    def _proof(self, text: str) -> str:
        """Return what only somebody who knows the token's hash can make of a text."""
        named = f"the cookie of the page, {text}".encode()
        return hmac.new(self._token_hash.encode(), named, hashlib.sha256).hexdigest()

    def _is_token(self, given: str) -> bool:
        return hmac.compare_digest(hashed(given), self._token_hash)


def _host(header: str) -> str:
    """Return the name in a Host header, without the port."""
    end = header.find("]") + 1 if header.startswith("[") else header.find(":")
    return (header[:end] if end > 0 else header).lower()


def _cookies(headers: Headers, name: str) -> list[str]:
    """Return the values of the cookies of a name. Cookies of others need no parser, so none can stall it."""
    parts = (part.strip().partition("=") for given in headers.getlist("cookie") for part in given.split(";"))
    return [value for found, _, value in parts if found == name]


MOST_CONNECTIONS = 64
MOST_STRANGERS = 8
"""Connections of one address without a request that the gate has let in. An ssh tunnel is one address."""
_IDLE = 10.0
"""Seconds within which a connection must make a request, and between two requests."""
_STALLED = 10.0
"""Seconds within which the other end must take what it is sent, one piece at a time."""


class BoundedConnection(H11Protocol):  # type: ignore[misc]  # it is Any for mypy
    """Ends a connection that is one too many, makes no request, or does not take what it is sent.

    Where there are too many, it ends the oldest without an admitted request: strangers lock nobody out.
    """

    app_state: dict[str, Any]
    let_in = False
    """Whether the gate has let in a request of it."""
    _made_at = 0.0
    _seen: Any = None
    _idle_timer: asyncio.TimerHandle | None = None
    _stall_timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:
        super().connection_made(transport)
        self._made_at = self.loop.time()
        self.app_state = {**self.app_state, "connection": self}
        there = sorted(
            (one for one in self.connections if not one.transport.is_closing()), key=lambda one: one._made_at
        )
        strangers = [one for one in there if not one.let_in]
        same = [one for one in strangers if one.address == self.address]
        if len(same) > MOST_STRANGERS:
            same[0].transport.abort()
        elif len(there) > MOST_CONNECTIONS:
            strangers[0].transport.abort()
        if transport.is_closing():
            return
        transport.set_write_buffer_limits(high=0)
        accepted = transport.get_extra_info("socket")
        # Else a computer that was switched off would count as one that watches.
        accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(1e3 * _STALLED))
        self._idle_timer = self.loop.call_later(_IDLE, self._check)

    @property
    def address(self) -> str:
        """The other end's, without its port; "" where that is gone already."""
        return str(self.client[0]) if self.client else ""

    def connection_lost(self, exc: Exception | None) -> None:
        for timer in _set(self._idle_timer, self._stall_timer):
            timer.cancel()
        super().connection_lost(exc)

    def pause_writing(self) -> None:
        super().pause_writing()
        self._stall_timer = self.loop.call_later(_STALLED, self.transport.abort)

    def resume_writing(self) -> None:
        for timer in _set(self._stall_timer):
            timer.cancel()
        super().resume_writing()

    def _check(self) -> None:
        """End the connection if it has not made a new request since the last check."""
        request = self.cycle
        if request is self._seen and (request is None or request.response_complete):
            self.transport.abort()
            return
        self._seen = request
        self._idle_timer = self.loop.call_later(_IDLE, self._check)


def _set(*timers: asyncio.TimerHandle | None) -> Iterable[asyncio.TimerHandle]:
    return (timer for timer in timers if timer is not None)
