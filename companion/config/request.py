"""Defines how the supervisor, which may not write the configuration, asks root's helper to change it.

The supervisor lays `REQUEST` into its runtime directory; systemd starts the helper, which takes it away and
leaves `ANSWER` in its own. Who reads either must not trust it: `read_request`, `read_answer`.

A companion that starts again sees nothing for some seconds, and the file may be written long after the
request. So the helper starts it again only by `LEAVE`, which the supervisor lays down once it has heard the
answer, renews, and takes back where the vehicle is armed by then.
"""

from __future__ import annotations

import os
import shutil
import stat
import time
from pathlib import Path

import msgspec

from anytraverse.regular_file import open_regular

REQUEST = "config-request.json"
ANSWER = "answer.json"
LEAVE = "config-leave.json"
ANSWERS = Path("/run/anytraverse-config")
"""The runtime directory of the helper."""
_LARGEST = 1 << 16
_MOST_CHANGES = 64

LONGEST = 20.0
"""Seconds for which a request may be good."""
LEAVE_LASTS = 0.8
"""Seconds for which the leave to start the companion again is good, unless it is renewed."""

Value = bool | int | float | str | list[bool | int | float | str] | dict[str, float | str] | None


def clock() -> float:
    """Return seconds of the clock that all processes share, which nobody sets, and which goes on in sleep."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


class ConfigRequestError(ValueError):
    """A request or an answer is not as it must be; the message says why."""


class ConfigRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Asks for changes of the configuration file.

    id: of the request, hex digits. sha256: of the file that the changes were made for. asked_from: the
    address of who asked, as the supervisor says, for the log alone. changes: as of `propose`. until: s of
    `clock`, after which nothing is to be done: the supervisor will have said that nothing was written.
    """

    id: str
    sha256: str
    asked_from: str
    changes: dict[str, Value]
    until: float


class ConfigAnswer(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Says what became of a request. id: its id, "" for one that was not readable. text: what, or why not.

    restarts: whether the helper waits for leave to start the companion again.
    """

    id: str
    written: bool
    text: str
    restarts: bool = False


class RestartLeave(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Lets the helper start the companion again after the request `id`, until so many seconds of `clock`."""

    id: str
    until: float


def read_request(folder: Path, user: int) -> ConfigRequest:
    """Read the request in `folder`, and take it away. Raises ConfigRequestError, OSError.

    user: the user id that it must be of: whoever else writes there is not the supervisor.
    """
    path = folder / REQUEST
    try:
        raw = _read(path, user)
    finally:
        _take_away(path)
    try:
        request = msgspec.json.decode(raw, type=ConfigRequest)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ConfigRequestError(f"the request cannot be read: {error}") from error
    if not request.id.isalnum() or len(request.id) > 32:
        raise ConfigRequestError("the request's id is no id")
    if not 0 < len(request.changes) <= _MOST_CHANGES:
        raise ConfigRequestError(f"{len(request.changes)} changes, from 1 to {_MOST_CHANGES} are taken")
    return request


def read_answer(folder: Path = ANSWERS) -> ConfigAnswer | None:
    """Return the newest answer, None without one or where it cannot be read."""
    try:
        return msgspec.json.decode(_read(folder / ANSWER, None), type=ConfigAnswer)
    except (OSError, ConfigRequestError, msgspec.DecodeError, UnicodeDecodeError):
        return None


def has_leave(folder: Path, user: int, request_id: str, now: float) -> bool:
    """Whether the companion may be started again now. user: as of `read_request`. now: s of `clock`."""
    try:
        leave = msgspec.json.decode(_read(folder / LEAVE, user), type=RestartLeave)
    except (OSError, ConfigRequestError, msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return False
    return leave.id == request_id and 0.0 < leave.until - now <= LEAVE_LASTS


def _read(path: Path, user: int | None) -> bytes:
    with os.fdopen(open_regular(path, follow=False), "rb") as file:
        status = os.fstat(file.fileno())
        if user is not None and (status.st_uid, status.st_nlink) != (user, 1):
            raise ConfigRequestError("the request is not the supervisor's")
        if stat.S_IMODE(status.st_mode) & 0o022:
            raise ConfigRequestError("others may write the file")
        raw = file.read(_LARGEST + 1)
    if len(raw) > _LARGEST:
        raise ConfigRequestError(f"the file is larger than {_LARGEST} bytes")
    return raw


def _take_away(path: Path) -> None:
    """Remove whatever lies there: systemd would start the helper again at once."""
    try:
        path.unlink(missing_ok=True)
    except IsADirectoryError:
        shutil.rmtree(path)
