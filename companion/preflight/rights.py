"""Checks that the service's user may use its files and devices."""

from __future__ import annotations

import grp
import os
import pwd
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from companion.cameras import CameraError, split_source
from companion.config.link_settings import LinkError
from companion.config.reading import SERVICE
from companion.preflight.rover import Rover
from companion.preflight.rules import Finding, failed, passed, skipped
from companion.system.computer import is_folder

RIGHTS = "rights"


class _User(NamedTuple):
    name: str
    id: int
    groups: frozenset[int]


_READ, _WRITE, _ENTER = 4, 2, 1
_HOMES = ("/home/", "/root/", "/run/user/")
"""What ProtectHome=yes of the unit hides."""
_PATHS = ("v4l2", "video", "folder")
"""Kinds of camera whose place is a path. Others may hold a password, which must not be shown."""


def check_rights(rover: Rover) -> list[Finding]:
    """Check that the user that runs the companion may use its files and devices, as far as they exist."""
    try:
        user = _user_of(rover.folder)
    except OSError as error:
        return [skipped(RIGHTS, f"not known: {error}")]
    bad = [
        _refused(user, path, rights)
        for path, rights in _used(rover)
        if not _is_absent(path) and not _may(user, path, rights)
    ]
    if rover.folder == SERVICE:
        bad += [
            failed(RIGHTS, f"the service does not see {path}: move it out of the home folder, e.g. to /opt")
            for path, _ in _used(rover)
            if str(path).startswith(_HOMES)
        ]
    return bad or [passed(RIGHTS, f"user {user.name} may use its files and devices")]


def _is_absent(path: Path) -> bool:
    try:
        return not path.exists()
    except OSError:  # a folder above it may not be entered, which is told
        return False


def _used(rover: Rover) -> Iterator[tuple[Path, int]]:
    """Yield what the companion opens, and how."""
    config = rover.config
    if rover.file:
        yield Path(rover.file).absolute(), _READ
    yield rover.folder, _READ | _WRITE | _ENTER
    if config.link.signing_key is not None:
        yield Path(config.link.signing_key), _READ
    bundle = Path(config.perceiver.name.partition(":")[2])
    if bundle.is_absolute():
        yield bundle, _READ | (_ENTER if is_folder(bundle) else 0)
    try:
        kind, where = split_source(config.camera.source)
        place = Path(where)
        if kind in _PATHS and place.is_absolute():
            yield place, _READ | (_ENTER if is_folder(place) else 0)
        for one in config.link.settings().connections().values():
            if one.address().scheme == "serial":
                yield Path(one.address().place), _READ | _WRITE
    except (CameraError, LinkError):  # told by the row of the configuration
        return


def _user_of(folder: Path) -> _User:
    """Return the user who owns the state folder: the service's. Without a folder, the present one."""
    number = folder.stat().st_uid if folder.is_dir() else os.geteuid()
    own = frozenset((os.getegid(), *os.getgroups())) if number == os.geteuid() else None
    try:
        known = pwd.getpwuid(number)
    except KeyError:
        return _User(str(number), number, own or frozenset())
    return _User(known.pw_name, number, own or frozenset(os.getgrouplist(known.pw_name, known.pw_gid)))


def _may(user: _User, path: Path, rights: int) -> bool:
    """Whether the user may use a file or folder. What cannot be looked at on the way to it counts as shut."""
    if user.id == 0:
        return True
    if user.id == os.geteuid():
        return os.access(path, rights)
    try:
        whole = path.resolve()
        return _has(user, whole, rights) and all(_has(user, one, _ENTER) for one in whole.parents)
    except OSError:
        return False


def _has(user: _User, path: Path, rights: int) -> bool:
    status = path.stat()
    if status.st_uid == user.id:
        granted = status.st_mode >> 6
    else:
        granted = status.st_mode >> 3 if status.st_gid in user.groups else status.st_mode
    return granted & rights == rights


def _refused(user: _User, path: Path, rights: int) -> Finding:
    verb = "read and write" if rights & _WRITE else "read"
    text = f"user {user.name} may not {verb} {path}"
    if str(path).startswith("/dev/"):
        group = _group(path)
        return failed(RIGHTS, f"{text}: sudo usermod --append --groups {group} {user.name}, and restart it")
    return failed(RIGHTS, f"{text}: sudo chown {user.name} {path}, and let it enter the folders above")


def _group(path: Path) -> str:
    number = path.stat().st_gid
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)
