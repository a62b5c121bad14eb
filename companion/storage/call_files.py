"""Writes a record and pictures of each call, which the ground can download, and an archive of pictures."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from anytraverse.history import Entry
from companion.system.atomic_write import write_atomically

PATTERN = "[0-9]*.j*"
"""Names of the folder's files that are served."""
MAX_CALLS = 50
"""Calls whose files are stored; the oldest are deleted."""
MAX_REMEMBERED = 256
"""Calls beyond these whose pictures stay for as long as the scene that they taught is remembered."""
SCENES = "scenes"
"""The folder of pictures of scenes that no call of this rover taught."""
SCENE_PATTERN = "[0-9a-f]*.jpg"
ANSWERS = 32
"""Answers in the record of a call, the newest ones."""
_NAME = re.compile(r"\.?([0-9]{1,5})(-large|-raw)?\.(json|jpg)(\.part)?\Z", re.ASCII)
"""Also matches a temporary file that was left because the companion was killed."""


class CallFiles:
    """Writes the files of calls into a folder that `served_files.Folder` serves. Methods raise OSError."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._record: dict[str, Any] = {}
        self._pictured_id = 0
        """Id of the call or hold whose pictures were written last."""
        self._addresses: dict[str, str] = {}
        """The paths of those pictures, by their keys in a record."""

    def write_pictures(
        self, number: int, small: bytes, large: Path, raw: bytes = b"", remembered: Collection[int] = ()
    ) -> None:
        """Write the pictures of a call or hold. small: JPEG sized for a radio. large: file of the archive.

        raw: JPEG of the frame without a mark, b"": there is none. remembered: calls that taught scenes which
        are remembered.
        """
        self._write(f"{number}.jpg", small)
        target = self._folder / f"{number}-large.jpg"
        target.unlink(missing_ok=True)
        try:
            os.link(large, target)
        except OSError:  # a file system without links
            self._write(target.name, large.read_bytes())
        unmarked = self._folder / f"{number}-raw.jpg"
        if raw:
            self._write(unmarked.name, raw)
        else:
            unmarked.unlink(missing_ok=True)
        self._pictured_id = number
        self._addresses = {"picture": address(f"{number}.jpg"), "large": address(target.name)}
        self._addresses |= {"raw": address(unmarked.name)} if raw else {}
        if number == self._record.get("id"):
            self._record.pop("raw", None)
            self._record |= self._addresses
            self._write_record()
        self._prune(number, remembered)

    def begin_record(
        self,
        number: int,
        figures: Mapping[str, Any],
        answers: Sequence[Mapping[str, Any]] = (),
        remembered: Collection[int] = (),
    ) -> None:
        """Write the record of a new call. figures: JSON values. answers: those given before a restart.

        remembered: as above.
        """
        self._record = {
            "id": number,
            **figures,
            **(self._addresses if number == self._pictured_id else {}),
            "outcome": None,
            "closed": None,
            "answers": [dict(answer) for answer in answers][-ANSWERS:],
        }
        self._write_record()
        self._prune(number, remembered)

    def write_scene(self, name: str, picture: bytes, remembered: Collection[str]) -> None:
        """Write the picture of a scene that no call taught, and delete those of scenes that are forgotten.

        name: of `scene_name`. picture: JPEG. remembered: the names of all such scenes.
        """
        folder = self._folder.parent / SCENES
        write_atomically(folder / name, picture)
        for path in folder.glob("*.jpg"):
            if path.name not in remembered:
                path.unlink(missing_ok=True)

    def add_answer(self, call_id: int, answer: Mapping[str, Any]) -> None:
        """Add an answer to the newest call's record."""
        if call_id == self._record.get("id"):
            self._record["answers"] = [*self._record["answers"], dict(answer)][-ANSWERS:]
            self._write_record()

    def close_record(self, call_id: int, end: Mapping[str, Any]) -> None:
        """Write into the newest call's record how it ended. end: JSON values."""
        if call_id == self._record.get("id"):
            self._record |= end
            self._write_record()

    def _write_record(self) -> None:
        self._write(f"{self._record['id']}.json", json.dumps(self._record, separators=(",", ":")).encode())

    def _write(self, name: str, content: bytes) -> None:
        write_atomically(self._folder / name, content)

    def _prune(self, newest: int, remembered: Collection[int]) -> None:
        """Delete the files of all but the newest calls, and all but the pictures of remembered ones.

        Their age is the distance of their 16-bit ids from the newest: the files' times may be wrong, since a
        rover often boots without a clock.
        """
        found: dict[int, list[Path]] = {}
        for path in self._folder.iterdir():
            if named := _NAME.match(path.name):
                found.setdefault(newest - int(named[1]) & 0xFFFF, []).append(path)
        kept = 0
        for age in sorted(found)[MAX_CALLS:]:
            keeps = kept < MAX_REMEMBERED and newest - age & 0xFFFF in remembered
            kept += keeps
            for path in found[age]:
                if not (keeps and path.suffix == ".jpg" and not path.name.startswith(".")):
                    path.unlink(missing_ok=True)


def address(name: str) -> str:
    """Return the path by which the ground reads a file of the folder."""
    return f"/calls/{name}"


def scene_picture(entry: Entry) -> str:
    """Return the path by which the ground reads a remembered scene's picture, if there is one."""
    return address(f"{entry.call_id}.jpg") if entry.call_id else f"/{SCENES}/{scene_name(entry)}"


def scene_name(entry: Entry) -> str:
    """Return the name of a picture in `SCENES`: by the embedding, since ids of calls are a rover's own."""
    return f"{hashlib.sha256(entry.embedding.tobytes()).hexdigest()[:16]}.jpg"


class PictureArchive:
    """Stores at most `keep` pictures in a folder, and deletes the oldest beyond that."""

    def __init__(self, folder: Path, keep: int) -> None:
        self._folder = folder
        self._keep = keep
        self._count = max(map(_number, self._pictures()), default=0)
        for torn in folder.glob(".[0-9]*.part"):
            with contextlib.suppress(OSError):
                torn.unlink()

    @property
    def wanted(self) -> bool:
        """Whether any picture is to be stored."""
        return self._keep > 0

    def add(self, picture: bytes, title: str) -> Path:
        """Store a JPEG, and return its path. Raises OSError."""
        self._count += 1
        slug = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")[:40]
        path = self._folder / f"{self._count:05d}-{slug}.jpg"
        write_atomically(path, picture)
        for old in self._pictures()[: -self._keep]:
            old.unlink(missing_ok=True)
        return path

    def _pictures(self) -> list[Path]:
        """List the pictures, oldest first. Sorts by number, since a sort by name fails beyond 99,999."""
        return sorted((path for path in self._folder.glob("[0-9]*-*.jpg") if _number(path)), key=_number)


def _number(path: Path) -> int:
    number = path.name.partition("-")[0]
    return int(number) if number.isdecimal() else 0
