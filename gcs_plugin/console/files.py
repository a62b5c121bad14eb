"""Fetches a rover's files, one at a time, the most urgent first. No I/O: the client does it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from enum import IntEnum

from companion.wire.json_values import DocumentError
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.client.fetch import Fetch, FetchStatus
from gcs_plugin.client.listing import Listing

MOST_WANTED = 32
TRIES = 3
AGAIN_S = 5.0
"""Seconds before a file that failed is asked for again; with each failure longer."""
SOON_S = 1.0
"""The same of a call's picture the first time: a rover announces it shortly before it has written it."""
MOST_BEGUN = 2
"""Incident files that are kept in part."""
MEASURED_BYTES = 600
"""A file of fewer bytes says little about the link's rate."""


Use = Callable[[bytes], "Future[None] | None"]
"""Takes a file's content, at once or in a thread. Raises DocumentError, as the thread may."""


class DamagedError(DocumentError):
    """Reports a content that is not what the rover has: nothing of it is kept."""


class Rank(IntEnum):
    """How urgent a file is; the lowest number goes first."""

    CALL_PICTURE = 0
    STATE = 1
    RECORD = 2
    LARGE_PICTURE = 3
    CHECK = 4
    OLD = 5
    INCIDENT = 6
    """It may take minutes: it makes way for any other file, and goes on where it was."""


@dataclass
class _Wanted:
    path: str
    rank: Rank
    use: Use
    failures: int = 0
    not_before: float = 0.0
    taking: Future[None] | None = None
    """What `use` does in a thread."""


@dataclass
class _Running:
    """What is being fetched. began: when it was first asked for. before: bytes that were here already."""

    wanted: _Wanted
    fetch: Fetch | Listing
    began: float
    before: int


class FetchedFiles:
    """What is fetched from one rover. rate: bytes a second of the newest long file, None while not known."""

    def __init__(self, client: OperatorClient, system: int) -> None:
        self._client = client
        self._system = system
        self._wanted: dict[str, _Wanted] = {}
        self._running: _Running | None = None
        self._begun: dict[str, Fetch] = {}
        """What has come of incident files that made way, were stopped or failed, by path."""
        self.rate: float | None = None
        self.problems: dict[str, str] = {}
        """Why a file did not come, by path."""

    def want(self, path: str, rank: Rank, use: Use) -> None:
        """Fetch a file, once, and give its content to `use`.

        A path that ends in "/" is a folder: `use` gets the names of its files, one a line.
        """
        if path in self._wanted or len(self._wanted) >= MOST_WANTED:
            return
        self.problems.pop(path, None)
        self._wanted[path] = _Wanted(path, rank, use)

    def waits(self, path: str) -> bool:
        """Whether a file is still to come."""
        return path in self._wanted

    def put_back(self, rank: Rank) -> None:
        """Let files of this rank wait until nothing else is wanted."""
        for one in self._wanted.values():
            if one.rank is rank:
                one.rank = Rank.OLD

    def stop(self, path: str) -> None:
        """Fetch an incident file no more. What has come of it stays."""
        self._wanted.pop(path, None)
        if self._running is not None and self._running.wanted.path == path:
            self._interrupt()

    def forget(self, path: str) -> None:
        """Forget what has come of an incident file."""
        self._begun.pop(path, None)

    def progress(self, path: str) -> tuple[int, int | None] | None:
        """Return the bytes of a file that was begun: received, and in all; None: it was not."""
        running = (
            self._running.fetch if self._running is not None and self._running.wanted.path == path else None
        )
        fetch = running or self._begun.get(path)
        return (fetch.received, fetch.size) if isinstance(fetch, Fetch) else None

    def step(self, now: float) -> bool:
        """Take what has come, and begin what is most urgent. Returns whether something changed."""
        checked = self._take_checked(now)
        changed = self._finish(now) or checked
        ready = [one for one in self._wanted.values() if one.not_before <= now and one.taking is None]
        urgent = min(ready, key=lambda one: one.rank, default=None)
        if urgent is None:
            return changed
        if self._running is not None:
            running = self._running.wanted.rank
            yields = running is Rank.INCIDENT or urgent.rank is Rank.CALL_PICTURE
            if running <= urgent.rank or not yields:
                return changed
            self._interrupt()
        fetch = self._begin(urgent, now)
        before = fetch.received if isinstance(fetch, Fetch) else 0
        self._running = _Running(urgent, fetch, now, before)
        return True

    def _begin(self, wanted: _Wanted, now: float) -> Fetch | Listing:
        if (begun := self._begun.pop(wanted.path, None)) is not None:
            self._client.resume(begun, now)
            return begun
        folder = wanted.path.endswith("/")
        begin = self._client.list_folder if folder else self._client.fetch
        return begin(self._system, wanted.path.rstrip("/"), now)

    def _interrupt(self) -> None:
        """Stop what is being fetched; of an incident file what has come stays."""
        assert self._running is not None
        wanted, fetch = self._running.wanted, self._running.fetch
        self._running = None
        if isinstance(fetch, Fetch):
            self._client.stop(fetch)
            self._keep(wanted, fetch)

    def _keep(self, wanted: _Wanted, fetch: Fetch) -> None:
        if wanted.rank is Rank.INCIDENT:
            self._begun[wanted.path] = fetch
            while len(self._begun) > MOST_BEGUN:
                self._begun.pop(next(iter(self._begun)))

    def _take_checked(self, now: float) -> bool:
        """Take what threads are done with. Returns whether there was something."""
        done = [(one, one.taking) for one in self._wanted.values() if one.taking and one.taking.done()]
        for wanted, taking in done:
            wanted.taking, problem = None, ""
            try:
                taking.result()
            except DocumentError as error:
                problem = str(error)
                if isinstance(error, DamagedError):
                    self.forget(wanted.path)
            self._end(wanted, problem, now)
        return bool(done)

    def _finish(self, now: float) -> bool:
        if self._running is None:
            return False
        running = self._running
        wanted, fetch = running.wanted, running.fetch
        if fetch.status is FetchStatus.WAITING:
            running.began = now
        if not fetch.settled:
            return False
        self._running = None
        if isinstance(fetch, Fetch):
            self._keep(wanted, fetch)
        problem = fetch.problem
        if fetch.status is FetchStatus.DONE:
            content = fetch.content if isinstance(fetch, Fetch) else "\n".join(fetch.names).encode()
            if isinstance(fetch, Fetch) and len(content) - running.before >= MEASURED_BYTES:
                self.rate = (len(content) - running.before) / max(0.02, now - running.began)
            try:
                wanted.taking = wanted.use(content)
            except DocumentError as error:
                problem = str(error)
        if wanted.taking is None:
            self._end(wanted, problem, now)
        return True

    def _end(self, wanted: _Wanted, problem: str, now: float) -> None:
        """Be done with a file, or try it again later."""
        if not problem:
            self._wanted.pop(wanted.path, None)
            self.forget(wanted.path)
            return
        wanted.failures += 1
        soon = wanted.rank is Rank.CALL_PICTURE and wanted.failures == 1
        wanted.not_before = now + (SOON_S if soon else AGAIN_S * 2**wanted.failures)
        self.problems[wanted.path] = problem
        if wanted.failures >= TRIES:
            self._wanted.pop(wanted.path, None)
        while len(self.problems) > MOST_WANTED:
            self.problems.pop(next(iter(self.problems)))
