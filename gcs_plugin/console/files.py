"""Fetches a rover's files, one at a time, the most urgent first. No I/O: the client does it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from companion.wire.documents import DocumentError
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.client.fetch import Fetch, FetchStatus
from gcs_plugin.client.listing import Listing

MOST_WANTED = 32
TRIES = 3
AGAIN_S = 5.0
"""Seconds before a file that failed is asked for again; with each failure longer."""
SOON_S = 1.0
"""The same of a call's picture the first time: a rover announces it shortly before it has written it."""
MEASURED_BYTES = 600
"""A file of fewer bytes says little about the link's rate."""


class Rank(IntEnum):
    """How urgent a file is; the lowest number goes first."""

    CALL_PICTURE = 0
    STATE = 1
    RECORD = 2
    LARGE_PICTURE = 3
    CHECK = 4
    OLD = 5


@dataclass
class _Wanted:
    path: str
    rank: Rank
    use: Callable[[bytes], None]
    failures: int = 0
    not_before: float = 0.0


class Files:
    """What is fetched from one rover. rate: bytes a second of the newest long file, None while not known."""

    def __init__(self, client: OperatorClient, system: int) -> None:
        self._client = client
        self._system = system
        self._wanted: dict[str, _Wanted] = {}
        self._running: tuple[_Wanted, Fetch | Listing, float] | None = None
        self.rate: float | None = None
        self.problems: dict[str, str] = {}
        """Why a file did not come, by path."""

    def want(self, path: str, rank: Rank, use: Callable[[bytes], None]) -> None:
        """Fetch a file, once, and give its content to `use`, which may raise DocumentError.

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

    def progress(self, path: str) -> tuple[int, int | None] | None:
        """Return the bytes of a file that is being fetched: received, and in all; None: it is not."""
        if self._running is None or self._running[0].path != path:
            return None
        fetch = self._running[1]
        return (fetch.received, fetch.size) if isinstance(fetch, Fetch) else None

    def step(self, now: float) -> bool:
        """Take what has come, and begin what is most urgent. Returns whether something changed."""
        changed = self._finish(now)
        ready = [one for one in self._wanted.values() if one.not_before <= now]
        urgent = min(ready, key=lambda one: one.rank, default=None)
        if urgent is None:
            return changed
        if self._running is not None and (
            self._running[0].rank <= urgent.rank or urgent.rank is not Rank.CALL_PICTURE
        ):
            return changed
        folder = urgent.path.endswith("/")
        begin = self._client.list_folder if folder else self._client.fetch
        self._running = urgent, begin(self._system, urgent.path.rstrip("/"), now), now
        return True

    def _finish(self, now: float) -> bool:
        if self._running is None:
            return False
        wanted, fetch, began = self._running
        if fetch.status is FetchStatus.WAITING:
            self._running = wanted, fetch, now
        if not fetch.settled:
            return False
        self._running = None
        problem = fetch.problem
        if fetch.status is FetchStatus.DONE:
            content = fetch.content if isinstance(fetch, Fetch) else "\n".join(fetch.names).encode()
            if isinstance(fetch, Fetch) and len(content) >= MEASURED_BYTES:
                self.rate = len(content) / max(0.02, now - began)
            try:
                wanted.use(content)
            except DocumentError as error:
                problem = str(error)
        if not problem:
            self._wanted.pop(wanted.path, None)
            return True
        wanted.failures += 1
        soon = wanted.rank is Rank.CALL_PICTURE and wanted.failures == 1
        wanted.not_before = now + (SOON_S if soon else AGAIN_S * 2**wanted.failures)
        self.problems[wanted.path] = problem
        if wanted.failures >= TRIES:
            self._wanted.pop(wanted.path, None)
        while len(self.problems) > MOST_WANTED:
            self.problems.pop(next(iter(self.problems)))
        return True
