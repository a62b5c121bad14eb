"""Checks the files of a bundle against their sizes and hashes."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

from anytraverse.errors import BundleError


@dataclass(frozen=True)
class FileEntry:
    """Holds a file's size in bytes and its SHA-256 in hexadecimal."""

    size: int
    sha256: str


def check_size(folder: Path, name: str, entry: FileEntry) -> None:
    """Raise BundleError for a file that is missing, has another size, or is a link out of the folder."""
    path = folder / name
    try:
        inside = path.resolve(strict=True).is_relative_to(folder.resolve())
        size = path.stat().st_size if path.is_file() else None
    except (OSError, RuntimeError):  # RuntimeError: a loop of symbolic links, before Python 3.13
        raise BundleError(f"{path} is missing: copy the bundle again, the whole folder") from None
    if not inside:
        raise BundleError(f"{path} leads out of the bundle: copy the bundle again, with its links resolved")
    if size != entry.size:
        came = "no file" if size is None else f"{size} bytes"
        raise BundleError(f"{path} is torn: {came}, expected {entry.size} bytes: copy the bundle again")


def check_contents(folder: Path, name: str, entry: FileEntry) -> None:
    """Raise BundleError for a file whose size or hash is not that of the entry."""
    check_size(folder, name, entry)
    path = folder / name
    try:
        digest = sha256_of(path)
    except PermissionError:
        raise BundleError(f"{path} may not be read by this user: chmod -R a+rX {folder}") from None
    except OSError as error:
        raise BundleError(f"{path} cannot be read ({error.strerror}): copy the bundle again") from error
    if digest != entry.sha256:
        raise BundleError(
            f"{path} is torn: its SHA-256 begins with {digest[:12]}, expected {entry.sha256[:12]}: "
            "copy the bundle again"
        )


def sha256_of(path: Path) -> str:
    """Calculate a file's SHA-256 in hexadecimal; reads it in pieces."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()


def replace_text(path: Path, text: str, mode: int | None = None) -> None:
    """Write a file at once or not at all. mode: its permissions; None: the usual ones. Raises OSError."""
    part = path.with_suffix(".part")
    with part.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    if mode is not None:
        part.chmod(mode)
    part.replace(path)
