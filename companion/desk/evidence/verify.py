"""Checks a file of evidence that may come from anybody: its members, their sums, and the signature."""

from __future__ import annotations

import json
import os
import re
import zipfile
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO, NamedTuple

from anytraverse.regular_file import open_regular
from companion.desk.evidence.package import DATA, LARGEST, SIGNATURE, SIGNED, SIGNERS, SUMS, sums_of
from companion.desk.evidence.signature import check
from companion.wire.json_values import mapping_of, text_of
from companion.wire.packing import clean

_MOST_MEMBERS = 32
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", re.ASCII)
_LINE = re.compile(r"([0-9a-f]{64})  (\S+)", re.ASCII)
_END = b"PK\x05\x06"
_OF_END = 22
"""Bytes of the end of a zip that has no comment."""
_ENCRYPTED = 1


class NotEvidenceError(Exception):
    """A file is no evidence, or is not whole. The text says what differs."""


class Verified(NamedTuple):
    """What a good file says of itself. made: when, in ISO 8601. fingerprint: of the key that signed it."""

    rover: str
    made: str
    fingerprint: str


def verify(path: Path) -> Verified:
    """Check a file. Raises NotEvidenceError with all that differs, SignatureError, NoToolError, OSError."""
    with os.fdopen(open_regular(path), "rb") as file:
        members = _members(file)
    differs = _differing(members)
    if differs:
        raise NotEvidenceError("; ".join(differs))
    fingerprint = check(members[SIGNERS], members[SIGNATURE], members[SUMS])
    told = _read(members[DATA])
    return Verified(clean(text_of(told.get("rover"))), clean(text_of(told.get("made_at"))), fingerprint)


def _members(file: BinaryIO) -> dict[str, bytes]:
    """Read all members: few, small, and each of another plain name."""
    size = file.seek(0, os.SEEK_END)
    if size > LARGEST:
        raise NotEvidenceError(f"it is larger than {LARGEST // 1_000_000} MB: no evidence is")
    file.seek(max(0, size - _OF_END))
    if not file.read(_OF_END).startswith(_END):
        raise NotEvidenceError("it is no zip of ours, or it was cut off, or something was added at its end")
    file.seek(0)
    try:
        with zipfile.ZipFile(file) as packed:
            entries = packed.infolist()
            _check_entries(entries)
            return {entry.filename: _content(packed, entry) for entry in entries}
    except NotEvidenceError:
        raise
    except Exception as error:  # a hostile zip leads zipfile anywhere
        raise NotEvidenceError(f"it is damaged ({clean(str(error))[:100]})") from error


def _check_entries(entries: list[zipfile.ZipInfo]) -> None:
    if len(entries) > _MOST_MEMBERS:
        raise NotEvidenceError(f"it has {len(entries)} members: no evidence has")
    for name, times in Counter(entry.filename for entry in entries).items():
        if not _NAME.fullmatch(name):
            raise NotEvidenceError(f"a member is called {name[:80]!a}: no evidence has such a name")
        if times > 1:
            raise NotEvidenceError(f"{name} is in it {times} times")
    if any(entry.flag_bits & _ENCRYPTED for entry in entries):
        raise NotEvidenceError("a member is encrypted")
    if any(entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for entry in entries):
        raise NotEvidenceError("a member is compressed in a way that ours are not")
    if sum(entry.file_size for entry in entries) > LARGEST:
        raise NotEvidenceError(f"unpacked it is larger than {LARGEST // 1_000_000} MB: no evidence is")
    if min((entry.header_offset for entry in entries), default=0) != 0:
        raise NotEvidenceError("something stands before its first member")


def _content(packed: zipfile.ZipFile, entry: zipfile.ZipInfo) -> bytes:
    try:
        with packed.open(entry) as member:
            content = member.read(entry.file_size + 1)
    except Exception as error:
        raise NotEvidenceError(f"{entry.filename} is damaged") from error
    if len(content) != entry.file_size:
        raise NotEvidenceError(f"{entry.filename} is damaged")
    return content


def _differing(members: Mapping[str, bytes]) -> list[str]:
    """Say what is missing, what is too much, and which members have changed."""
    missing = [name for name in (*SIGNED, SUMS, SIGNATURE) if name not in members]
    if missing:
        return [f"{', '.join(missing)} missing"]
    lines = members[SUMS].decode("ascii", "replace").splitlines()
    sums = {found[2]: found[1] for line in lines if (found := _LINE.fullmatch(line))}
    if len(sums) != len(lines) or any(name not in sums for name in SIGNED):
        return [f"{SUMS} is damaged"]
    told = [f"{ascii(name)[1:-1]} missing" for name in sums if name not in members]
    told += [f"{name} is not in {SUMS}" for name in members if name not in (*sums, SUMS, SIGNATURE)]
    listed = {name: members[name] for name in sums if name in members}
    now = dict(line.split("  ", 1)[::-1] for line in sums_of(listed).decode().splitlines())
    return told + [f"{name} has changed since it was signed" for name in listed if now[name] != sums[name]]


def _read(content: bytes) -> Mapping[str, object]:
    try:
        return mapping_of(json.loads(content))
    except (ValueError, RecursionError):
        return {}
