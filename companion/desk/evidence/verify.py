"""Checks a file of evidence that may come from anybody: its bytes, its members' sums, and the signature."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

from anytraverse.regular_file import read_regular
from companion.desk.evidence.package import (
    DATA,
    LARGEST,
    MEMBERS,
    SIGNATURE,
    SIGNED,
    SIGNERS,
    SUMS,
    pack,
    sums_of,
)
from companion.desk.evidence.signature import SignatureError, check
from companion.wire.json_values import mapping_of, text_of
from companion.wire.packing import clean

_PACKED = "it is packed otherwise than evidence is: something may be hidden in it"


class NotEvidenceError(Exception):
    """A file is no evidence, or is not whole. The text says what differs."""


class Verified(NamedTuple):
    """What a good file says of itself. made: when, in ISO 8601. fingerprint: of the key that signed it."""

    rover: str
    made: str
    fingerprint: str


def verify(path: Path) -> Verified:
    """Check a file. Raises NotEvidenceError with all that differs, EvidenceError, OSError."""
    content = read_regular(path, LARGEST + 1)
    if len(content) > LARGEST:
        raise NotEvidenceError(f"it is larger than {LARGEST // 1_000_000} MB: no evidence is")
    members = _members(content)
    if changed := _changed(members):
        raise NotEvidenceError("; ".join(f"{name} has changed since it was signed" for name in changed))
    fingerprint = check(members[SIGNERS], members[SIGNATURE], members[SUMS])
    told = _read(members[DATA])
    if told.get("key") != fingerprint:
        raise SignatureError(f"{fingerprint} signed it, and {DATA} names another key")
    return Verified(clean(text_of(told.get("rover"))), clean(text_of(told.get("made_at"))), fingerprint)


def _members(content: bytes) -> dict[str, bytes]:
    """Read the members. A zip can show every program another one: the bytes must be those that we write."""
    try:
        with zipfile.ZipFile(BytesIO(content)) as packed:
            entries = packed.infolist()
            names = [entry.filename for entry in entries]
            if sorted(names) != sorted(MEMBERS):
                raise NotEvidenceError(_of_names(names))
            if sum(entry.file_size for entry in entries) > len(content):
                raise NotEvidenceError(_PACKED)
            members = {entry.filename: packed.read(entry) for entry in entries}
    except NotEvidenceError:
        raise
    except Exception as error:  # a hostile zip leads zipfile anywhere
        raise NotEvidenceError(f"it is damaged ({clean(str(error))[:100]})") from error
    if pack(members) != content:
        raise NotEvidenceError(_PACKED)
    return members


def _of_names(names: list[str]) -> str:
    told = [f"{name} missing" for name in MEMBERS if name not in names]
    told += [f"{name[:80]!a} is in it: no evidence has it" for name in names[:9] if name not in MEMBERS]
    return "; ".join(told) or "a member is in it twice"


def _changed(members: Mapping[str, bytes]) -> list[str]:
    """Name the members whose sums are not those that are listed."""
    now = sums_of({name: members[name] for name in SIGNED}).splitlines(keepends=True)
    if b"".join(now) == members[SUMS]:
        return []
    listed = members[SUMS].splitlines(keepends=True)
    return [name for name, line in zip(SIGNED, now, strict=True) if line not in listed] or [SUMS]


def _read(content: bytes) -> Mapping[str, object]:
    try:
        return mapping_of(json.loads(content))
    except (ValueError, RecursionError):
        return {}
