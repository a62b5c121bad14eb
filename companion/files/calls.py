"""What each call was, for the ground: N.json, its picture sized for a radio, and the album's.

Copies on the disk of what the journal and the album keep: one that cannot be written is no fault.
"""

from __future__ import annotations

import json
import logging
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from companion.calls.decisions import Call
from companion.durable import write_whole
from companion.journal.records import record_of

log = logging.getLogger(__name__)

PATTERN = "[0-9]*.j*"
"""What may be seen of the folder."""
KEPT = 50
"""Calls whose files are kept; the oldest go."""
ANSWERS = 32
"""Answers told of a call, the newest ones."""
_NAME = re.compile(r"\.?([0-9]{1,5})(-large)?\.(json|jpg)(\.part)?\Z", re.ASCII)
"""Also of one that was never whole, because the companion was killed."""


class CallFiles:
    """A folder that `companion.files.folder.Folder` can serve as it is."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._record: dict[str, Any] = {}

    def opened(self, call: Call, answers: Sequence[Mapping[str, Any]] = ()) -> None:
        """Write all of a call but its pictures. answers: those of before a restart."""
        self._record = {
            "id": call.id,
            **record_of(call),
            "outcome": None,
            "closed": None,
            "answers": [dict(answer) for answer in answers][-ANSWERS:],
        }
        self._write_record()
        self._prune(call.id)

    def drawn(self, number: int, small: bytes, large: Path) -> str:
        """Write the pictures of a call or hold; the small one's path for the ground, "" without one.

        small: JPEG sized for a radio. large: the album's picture.
        """
        pictures = self._pictures(number, small, large)
        if number == self._record.get("id"):
            self._record |= pictures
            self._write_record()
        self._prune(number)
        return pictures.get("picture", "")

    def answered(self, call_id: int, answer: Mapping[str, Any]) -> None:
        """One more answer to the newest call."""
        if call_id == self._record.get("id"):
            self._record["answers"] = [*self._record["answers"], dict(answer)][-ANSWERS:]
            self._write_record()

    def closed(self, call: Call, at: float) -> None:
        """The newest call is over. at: seconds since 1970."""
        if call.id == self._record.get("id"):
            reasons = sorted(reason.value for reason in call.reasons)
            self._record |= {"reasons": reasons, "outcome": call.outcome.name.lower(), "closed": round(at, 2)}
            self._write_record()

    def _pictures(self, number: int, small: bytes, large: Path) -> dict[str, str]:
        names = {"picture": f"{number}.jpg", "large": f"{number}-large.jpg"}
        try:
            if small:
                self._write(names["picture"], small)
            self._copy(large, names["large"])
        except OSError as error:
            log.warning("no picture of %d for the ground: %r", number, error)
        return {what: f"/calls/{name}" for what, name in names.items() if (self._folder / name).is_file()}

    def _copy(self, source: Path, name: str) -> None:
        target = self._folder / name
        target.unlink(missing_ok=True)
        try:
            os.link(source, target)
        except OSError:  # a file system without links
            self._write(name, source.read_bytes())

    def _write_record(self) -> None:
        try:
            content = json.dumps(self._record, separators=(",", ":")).encode()
            self._write(f"{self._record['id']}.json", content)
        except OSError as error:
            log.warning("call %d cannot be told to the ground: %s", self._record["id"], error)

    def _write(self, name: str, content: bytes) -> None:
        write_whole(self._folder / name, content)

    def _prune(self, newest: int) -> None:
        """By their ids, counted back from the newest: a clock may have been wrong."""
        found: dict[int, list[Path]] = {}
        try:
            for path in self._folder.iterdir():
                if named := _NAME.match(path.name):
                    found.setdefault(newest - int(named[1]) & 0xFFFF, []).append(path)
            for age in sorted(found)[KEPT:]:
                for path in found[age]:
                    path.unlink(missing_ok=True)
        except OSError as error:
            log.warning("old calls are not cleared away: %s", error)
