"""Reads the signing key from its file, which only its owner may access."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from companion.wire.signing import KEY_BYTES, SigningKey

_LARGEST = 256
_OTHERS = 0o077
_NOT_OURS = "the signing key {path} belongs to another user: chown it to the user who runs this program"


class SigningKeyError(ValueError):
    """A key file cannot be used; the message says what to do, and does not quote the file."""


def read_key(path: Path) -> SigningKey:
    """Read the key in `path`: 32 raw bytes or 64 hex digits. Raises SigningKeyError."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    except FileNotFoundError:
        raise SigningKeyError(f"there is no signing key {path}: make one, or take the setting out") from None
    except PermissionError:
        raise SigningKeyError(_NOT_OURS.format(path=path)) from None
    except OSError as error:
        raise SigningKeyError(f"signing key {path}: {(error.strerror or str(error)).lower()}") from None
    try:
        _check_rights(path, os.fstat(descriptor))
        return _parse(path, os.read(descriptor, _LARGEST))
    finally:
        os.close(descriptor)


def _check_rights(path: Path, status: os.stat_result) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise SigningKeyError(f"signing key {path} is no file")
    if status.st_mode & _OTHERS:
        raise SigningKeyError(f"others may open the signing key {path}: chmod 600 {path}")
    if os.geteuid() != 0 and status.st_uid not in (0, os.geteuid()):
        raise SigningKeyError(_NOT_OURS.format(path=path))


def _parse(path: Path, content: bytes) -> SigningKey:
    if len(content) == KEY_BYTES:
        secret = content
    else:
        try:
            secret = bytes.fromhex(content.decode("ascii").strip())
        except ValueError:
            secret = b""
    if len(secret) != KEY_BYTES:
        raise SigningKeyError(f"the signing key {path} is neither 32 bytes nor 64 hex digits: make it again")
    if not any(secret):
        raise SigningKeyError(f"the signing key {path} is all zeros, which means no signing: make another")
    return SigningKey(secret)
