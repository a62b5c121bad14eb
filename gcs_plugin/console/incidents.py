"""The incident files of one rover: has them packed, fetches them, and stores them in a folder."""

from __future__ import annotations

import contextlib
import io
import re
import struct
import time
import zipfile
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from companion.pages.calls import incident_shown
from companion.wire.answers import Answer, PackIncident
from companion.wire.delivery import Pending
from companion.wire.ids import Motion
from companion.wire.incidents import DOCUMENT, FOLDER, MOST_MEMBERS, Incidents, read_incidents
from companion.wire.json_values import DocumentError
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.client.fetch import MAX_BYTES
from gcs_plugin.console.fetched import QUICK_FOR_LARGE
from gcs_plugin.console.files import DamagedError, FetchedFiles, Rank
from gcs_plugin.console.rover_page import Download, RoverPage

AGAIN_S = 3.0
"""Seconds between two readings of /incidents.json while an incident is packed."""
FOLLOWED_S = 180.0
"""Seconds for which a request is followed. They begin anew whenever the rover says that it packs."""
MOST_STORED = 32
"""Files that stay in the folder, the newest ones."""
_LARGEST_CONTENT = 512 << 20
"""Bytes of what a file holds, as it says itself."""
_END = struct.Struct("<4s4H2LH")
"""A zip's end of central directory: magic, disks, members, bytes of the directory, its place, a comment."""
_LONGEST_ENTRY = 256
"""Bytes of the directory for one member."""
_CHECKING = ThreadPoolExecutor(1, "check")
"""Checks and stores files, one at a time."""
_PATH, _DOCUMENT_PATH = f"/{FOLDER}/", f"/{DOCUMENT}"
_STORED = re.compile(r"rover[0-9]{1,3}-[0-9]{8}-[0-9]{6}-.*\.zip", re.ASCII)


class RoverIncidents:
    """Follows one rover's incidents. `step` asks for what is due; times are those of its `now`."""

    def __init__(
        self,
        client: OperatorClient,
        system: int,
        files: FetchedFiles,
        folder: Path | None,
        page: RoverPage | None = None,
    ) -> None:
        """folder: where files are stored; None: none are fetched. page: the rover's; None: files come by
        MAVLink FTP.
        """
        self._client = client
        self._system = system
        self._files = files
        self._folder = folder
        self._page = page
        self._downloads: dict[str, Download] = {}
        """What is fetched from the rover's page, by name."""
        self._problems: dict[str, str] = {}
        self._told = Incidents()
        self._asked: dict[int, Pending] = {}
        self._followed_until = self._read_at = float("-inf")
        self.stored: dict[str, Path] = {}
        """What was fetched, by the name on the rover."""

    def asked(self, transaction: int) -> bool:
        """Whether this is the transaction of a request for an incident."""
        return any(one.answer.transaction == transaction for one in self._asked.values())

    def ask(self, call: int, now: float) -> None:
        """Have an incident packed. call: 0: the last minute. Raises PayloadError."""
        request = (PackIncident(call),)
        self._asked[call] = self._client.answer(self._system, Answer(0, Motion.NONE, request), now)
        self._followed_until = now + FOLLOWED_S

    def fetch(self, name: str) -> None:
        """Fetch a file, or go on with one that was begun."""

        def check(content: bytes) -> Future[None]:
            return _CHECKING.submit(self._store, name, content)

        if self._page is None:
            self._files.want(_PATH + name, Rank.INCIDENT, check)
        elif name not in self._downloads:
            self._problems.pop(name, None)
            download = Download(self._page, _PATH + name, lambda content: check(content).result())
            self._downloads[name] = download

    def stop(self, name: str) -> None:
        """Stop fetching a file."""
        if (download := self._downloads.pop(name, None)) is not None:
            download.stop()
        self._files.stop(_PATH + name)

    def step(self, now: float) -> None:
        """Take downloads, and read what the rover tells: after a request, and once on a quick link."""
        for name, download in list(self._downloads.items()):
            if download.done:
                del self._downloads[name]
                if download.problem:
                    self._problems[name] = download.problem
        asked = any(one.applied for one in self._asked.values())
        followed = now < self._followed_until and (asked or self._told.packing is not None)
        due = followed and now - self._read_at >= AGAIN_S
        first = self._read_at < 0 and (self._files.rate or 0.0) >= QUICK_FOR_LARGE
        if (due or first) and not self._files.waits(_DOCUMENT_PATH):
            self._read_at = now
            self._files.want(_DOCUMENT_PATH, Rank.STATE, self._hear)

    def document(self, call: int) -> dict[str, Any]:
        """Return what the page shows of the incident files of a call, 0: of the last minute."""
        return incident_shown(self._told, call, self._asked.get(call), self._how)

    def _how(self, name: str, size: int) -> dict[str, Any]:
        """Return how a file can be had."""
        if name in self.stored:
            return {"url": f"/incidents/{self._system}/{name}"}
        if self._page is not None and self._folder is not None:
            download = self._downloads.get(name)
            return {
                "waits": download is not None,
                "received": 0 if download is None else download.received,
                "seconds": None,
                "problem": self._problems.get(name, ""),
                "fetchable": True,
            }
        path, rate = _PATH + name, self._files.rate
        problem = self._files.problems.get(path, "")
        if size > MAX_BYTES:
            problem = "it is too much for MAVLink FTP: save it from the rover's own page"
        elif self._folder is None:
            problem = "this console has no folder for files"
        return {
            "waits": self._files.waits(path),
            "received": (self._files.progress(path) or (0, None))[0],
            "seconds": size / rate if rate else None,
            "problem": problem,
            "fetchable": size <= MAX_BYTES and self._folder is not None,
        }

    def _hear(self, content: bytes) -> None:
        self._told = read_incidents(content)
        unsettled = any(not one.settled for one in self._asked.values())
        if self._told.packing is not None:
            self._followed_until = self._read_at + FOLLOWED_S
        elif not unsettled:
            self._followed_until = float("-inf")

    def _store(self, name: str, content: bytes) -> None:
        """Check and store a file that has come. Raises DocumentError."""
        if not _is_whole(content):
            raise DamagedError("it came damaged")
        assert self._folder is not None
        path = self._folder / f"rover{self._system}-{time.strftime('%Y%m%d-%H%M%S')}-{name}"
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
            _delete_oldest(self._folder)
        except OSError as error:
            with contextlib.suppress(OSError):
                path.unlink()
            raise DocumentError(f"it cannot be stored: {(error.strerror or str(error)).lower()}") from error
        self.stored[name] = path


def _is_whole(content: bytes) -> bool:
    """Whether this is a zip as rovers write it, whose members are as they were packed."""
    if not _is_bounded(content):
        return False
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as packed:
            members = packed.infolist()
            if len(members) > MOST_MEMBERS or sum(one.file_size for one in members) > _LARGEST_CONTENT:
                return False
            return packed.testzip() is None
    except Exception:  # what came over a radio may be anything, and zipfile raises whatever it leads to
        return False


def _is_bounded(content: bytes) -> bool:
    """Whether a zip's directory is small. `zipfile` reads it by its bytes, whatever count stands beside them,
    and others where a comment or the ZIP64 format follows: rovers write neither.
    """
    if len(content) < _END.size:
        return False
    magic, _, _, _, members, directory, _, comment = _END.unpack_from(content, len(content) - _END.size)
    zip64 = b"PK\6\7" in content[-_END.size - 20 : -_END.size]
    plain = magic == b"PK\5\6" and not comment and not zip64
    return plain and members <= MOST_MEMBERS and directory <= MOST_MEMBERS * _LONGEST_ENTRY


def _delete_oldest(folder: Path) -> None:
    stored = [path for path in folder.iterdir() if _STORED.fullmatch(path.name)]
    for path in sorted(stored, key=lambda one: one.stat().st_mtime)[:-MOST_STORED]:
        path.unlink(missing_ok=True)
