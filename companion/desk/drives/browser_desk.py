"""Asks somebody in a browser, with the card that the console and the rover's own page have."""

from __future__ import annotations

import asyncio
import re
import secrets
import socket
import threading
import time
from collections.abc import AsyncIterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from companion.desk.drives.answered_before import nearest_to
from companion.desk.drives.drive import Drive
from companion.desk.drives.judge import DriveJudge
from companion.desk.drives.rehearsal import AskedCall, Rehearsal
from companion.pages import wording
from companion.pages.access import Gate
from companion.pages.calls import shown
from companion.pages.given import OwnAnswers
from companion.pages.listen import hashed, listen_here
from companion.pages.requests import MOST_POSTED, RequestError, check_answer, read_answer, read_object
from companion.pages.site import EventStreams, Server, event, posted, static_routes
from companion.wire.ids import Stage
from companion.wire.typed_answers import CommandError, typed

SHOWN = 24
"""Calls that are shown, the newest ones."""
_BEAT, _CYCLE = 1.0, 0.05
_WAITS = 0.5
"""Seconds after which the drive looks whether it is to end."""
_LAST_WORD = 1.5
"""Seconds in which a page that is open hears that the drive is over."""
_STATIC = Path(__file__).parent / "static"
_PICTURE = re.compile(r"([0-9]{1,5})-(raw|large)\.jpg", re.ASCII)


class BrowserDesk:
    """Serves the page on this computer alone, behind a token, while it is entered.

    The drive runs in the caller's thread, which calls `ask` and `progress`; a thread of its own serves. What
    the page is told is made in the caller's thread, and replaced as a whole.
    """

    def __init__(
        self, judge: DriveJudge, vocabulary: Sequence[str], found: Rehearsal, drive: Drive, port: int = 0
    ) -> None:
        """vocabulary: the configured one. found: what the drive led to so far. port: 0: any free one."""
        self._judge = judge
        self._vocabulary = vocabulary
        self._found = found
        self._drive = drive
        self._port = port
        self._token = secrets.token_hex(16)
        self._streams = EventStreams()
        self._server = Server(Gate(self._app(), token_hash=hashed(self._token), **_GATE))
        self._thread: threading.Thread | None = None
        self._answered = threading.Condition()
        self._line: str | None = None
        self._ended = self._skipped = False
        self._current: AskedCall | None = None
        self._asked: dict[int, tuple[float, float]] = {}
        """By call: when it was asked, in monotonic seconds and since 1970."""
        self._nearest: dict[int, dict[str, Any] | None] = {}
        self._names: dict[str, float] = {}
        self._revision = 0
        self._news: Mapping[str, Any] = self._made(0, "playing")
        self.url = ""

    def __enter__(self) -> BrowserDesk:
        """Begin to serve, at `url`. Raises OSError."""
        listener, self.url = listen_here(self._port, self._token)
        self._thread = threading.Thread(target=self._serve, args=[listener], name="page", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Tell the page that the drive is over, and end."""
        self._current = None
        self._tell(self._found.frames, "over")
        deadline = time.monotonic() + _LAST_WORD
        while self._streams.open and time.monotonic() < deadline:
            time.sleep(_CYCLE)
        self._server.should_exit = True
        if self._thread is not None:
            self._thread.join(2.0)

    def ask(self, call: AskedCall, _problem: str) -> str | None:
        """Wait for an answer to a call. None: it is skipped. Raises KeyboardInterrupt to end the drive."""
        if call is not self._current:
            self._current = call
            self._asked[call.id] = time.monotonic(), time.time()
            self._nearest[call.id] = nearest_to(call, self._found.calls, self._judge.engine)
        with self._answered:
            self._line, self._skipped = None, False
        self._tell(self._found.frames, "asking")
        with self._answered:
            while self._line is None and not self._skipped and not self._ended:
                self._answered.wait(_WAITS)
            if self._ended:
                raise KeyboardInterrupt
            self._tell(self._found.frames, "judging")
            return self._line

    def progress(self, number: int) -> None:
        """Tell how far the drive is. number: of the frame. Raises KeyboardInterrupt to end the drive."""
        if self._ended:
            raise KeyboardInterrupt
        self._current = None
        self._tell(number, "playing")

    def _serve(self, listener: socket.socket) -> None:
        asyncio.run(self._server.serve(sockets=[listener]))

    def _app(self) -> Starlette:
        return Starlette(
            routes=[
                Route("/events", self._events),
                Route("/calls/{name}", self._picture),
                *(
                    Route(f"/{name}", posted(carry_out), methods=["POST"])
                    for name, carry_out in (
                        ("answer", self._answer),
                        ("skip", self._skip),
                        ("end", self._end),
                    )
                ),
                *static_routes(_STATIC),
            ]
        )

    async def _events(self, request: Request) -> Response:
        return self._streams.answer(request, self._chunks)

    async def _chunks(self) -> AsyncIterator[bytes]:
        while True:
            seen, news = self._revision, self._news
            yield event("news", news)
            if news["state"] == "over":
                return
            until = time.monotonic() + _BEAT
            while self._revision == seen and time.monotonic() < until:
                await asyncio.sleep(_CYCLE)

    async def _picture(self, request: Request) -> Response:
        named = _PICTURE.fullmatch(request.path_params["name"])
        call = next((one for one in self._found.calls if named and one.id == int(named[1])), None)
        if named is None or call is None:
            return PlainTextResponse("there is no such picture\n", 404)
        return Response(call.raw if named[2] == "raw" else call.judged, media_type="image/jpeg")

    def _answer(self, body: bytes) -> str:
        answer = read_answer(read_object(body))
        with self._answered:
            call = self._waiting()
            if not answer.target:
                raise RequestError("words are changed with the answer to a call: wait for the next one")
            check_answer(answer, call.data if call.id == answer.target else None, call.id)
            try:
                self._line = typed(answer)
            except CommandError as error:
                raise RequestError(str(error)) from error
            self._answered.notify()
        return "sent"

    def _skip(self, _body: bytes) -> str:
        with self._answered:
            self._waiting()
            self._skipped = True
            self._answered.notify()
        return "skipped"

    def _end(self, _body: bytes) -> str:
        with self._answered:
            self._ended = True
            self._answered.notify()
        return "it ends, and keeps what was answered"

    def _waiting(self) -> AskedCall:
        """Return the call that waits for an answer. Raises RequestError without one."""
        if self._current is None or self._line is not None or self._skipped or self._ended:
            raise RequestError("no call waits for an answer now")
        return self._current

    def _tell(self, number: int, state: str) -> None:
        self._news = self._made(number, state)
        self._revision += 1

    def _made(self, number: int, state: str) -> dict[str, Any]:
        """Return what the page is told."""
        calls = self._found.calls
        memory = self._judge.engine.memory
        words = memory.preferences
        used = [{"word": word, "weight": words[word], "fixed": word in self._vocabulary} for word in words]
        offered = [word for word in self._vocabulary if word not in words]
        return {
            "state": state,
            "title": self._drive.title,
            "frame": number,
            "count": self._drive.count,
            "asked": len(calls),
            "answered": sum(call.by_person for call in calls),
            "words": used + [{"word": word, "weight": None, "fixed": True} for word in offered],
            "given": dict(memory.given),
            "names": list(_names(calls).items()),
            "calls": [self._shown(call) for call in reversed(calls[-SHOWN:]) if call.id in self._asked],
        }

    def _shown(self, call: AskedCall) -> dict[str, Any]:
        """Return what the page shows of a call."""
        waits = call is self._current
        since, at = self._asked[call.id]
        said = [
            {
                "at": at,
                "said": wording.without_box(one.line),
                "text": one.text,
                "tone": "good" if one.taken else "bad",
                "settled": True,
            }
            for one in call.said
        ]
        told = shown(
            call.data,
            OwnAnswers(),
            key=str(call.id),
            pictures={kind: f"/calls/{call.id}-{kind}.jpg" for kind in ("raw", "large")},
            said=[],
            nearest=self._nearest[call.id],
            since=since,
        )
        return told | {
            "stage": Stage.OPEN.name.lower() if waits else "closed",
            "open": waits,
            "known": told["known"] if waits else None,
            "outcome": "answered" if call.by_person else "not remembered",
            "stands": f"At {call.at:.1f} s of the drive, {call.frame}.",
            "holding": False,
            "large": {},
            "given": [],
            "answers": said,
            "first": "",
        }


_GATE: dict[str, Any] = {
    "own_address": "127.0.0.1",
    "most_posted": MOST_POSTED,
    "where_the_token_is": "the address that `companion rehearse` printed",
}


def _names(calls: list[AskedCall]) -> dict[str, float]:
    """Return the words that answers set, with their weights, the newest first."""
    found: dict[str, float] = {}
    for call in calls:
        for word, weight in wording.named(call.record).items():
            found.pop(word, None)
            found[word] = weight
    return dict(reversed(found.items()))
