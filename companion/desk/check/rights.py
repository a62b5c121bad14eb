"""Checks that the service's users may use their files and devices, and that no other process may."""

from __future__ import annotations

import grp
import os
import pwd
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from anytraverse.bundle.manifest import MANIFEST, read_manifest
from anytraverse.errors import BundleError
from companion.cameras import CameraError, split_source
from companion.config.link_settings import LinkSettingError
from companion.config.reading import SERVICE
from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, failed, passed, skipped, warned
from companion.system.computer import is_folder
from companion.vision.network_limit import OF_PATHS, is_limited, needs_of

RIGHTS, REACH = "rights", "reach"
_UNIFIED = Path("/sys/fs/cgroup/cgroup.controllers")
"""Only there systemd can limit which addresses a process reaches."""
_BY_NUMBER = "write the camera's numeric address into [camera] source"
_TO_LIMIT = {
    "oak": 'with one OAK, on USB, write "oak:" into [camera] source; one on a network cannot be limited',
    "pipe": 'what its program reaches is not known: if you can, write "v4l2:" or "rtsp://ADDRESS/PATH"',
}
"""What to do where it is not known which networks a camera of this kind needs."""


class _User(NamedTuple):
    name: str
    id: int
    groups: frozenset[int]


_READ, _WRITE, _ENTER = 4, 2, 1
_HOMES = ("/home/", "/root/", "/run/user/")
"""What ProtectHome=yes of the unit hides."""


def check_rights(rover: CheckedRover) -> list[CheckFinding]:
    """Check that the user that runs the companion may use its files and devices, as far as they exist."""
    try:
        user = _user_of(rover.folder)
        sees = _vision_user() if _is_service(rover) else user
    except OSError as error:
        return [skipped(RIGHTS, f"not known: {error}")]
    used = [(user, *one) for one in _used(rover)] + [(sees, *one) for one in _used_by_vision(rover)]
    files = [(sees, path, _READ) for path in _bundle_files(rover)]
    bad = [_refused(*one) for one in used + files if not _is_absent(one[1]) and not _may(*one)]
    if not _is_service(rover):
        apart = "its processes are not kept apart: docs/security.md"
        return bad or [passed(RIGHTS, f"user {user.name} may use its files and devices; {apart}")]
    bad += [
        failed(RIGHTS, f"the service does not see {path}: move it out of the home folder, e.g. to /opt")
        for _, path, _ in used
        if str(path).startswith(_HOMES)
    ]
    return bad or [
        passed(RIGHTS, f"user {user.name} may use its files and devices, {sees.name} the camera's")
    ]


def check_reach(rover: CheckedRover) -> list[CheckFinding]:
    """Check how much of the network whoever breaks into the vision process by a picture would reach."""
    if not _is_service(rover):
        return [skipped(REACH, "not limited: it is no service")]
    try:
        needs = needs_of(rover.config.camera.source)
    except CameraError:  # told by the row of the configuration
        return []
    if not needs.any:
        return [passed(REACH, "the vision process has no network")]
    all_of_it = "the vision process reaches the whole network"
    if needs.networks is None:
        kind = rover.config.camera.source.partition(":")[0]
        return [warned(REACH, f"{all_of_it}: {_TO_LIMIT.get(kind, _BY_NUMBER)}")]
    if not (_UNIFIED.exists() and is_limited(needs)):
        return [warned(REACH, f"{all_of_it}: this system does not limit it; see docs/security.md")]
    reached = ", ".join(needs.networks) or "nothing"
    return [passed(REACH, f"of the network systemd lets the vision process reach {reached}")]


def _is_service(rover: CheckedRover) -> bool:
    """Whether systemd starts the companion's processes, each as a user of its own."""
    return rover.folder == SERVICE or bool((rover.running or {}).get("service"))


def _is_absent(path: Path) -> bool:
    try:
        return not path.exists()
    except OSError:  # a folder above it may not be entered, which is told
        return False


def _used(rover: CheckedRover) -> Iterator[tuple[Path, int]]:
    """Yield what the companion opens, and how."""
    config = rover.config
    if rover.file:
        yield Path(rover.file).absolute(), _READ
    yield rover.folder, _READ | _WRITE | _ENTER
    for named in (config.link.signing_key, config.camera.calibration):
        if named is not None:
            yield Path(named), _READ
    try:
        for one in config.link.settings().connections().values():
            if one.address().scheme == "serial":
                yield Path(one.address().place), _READ | _WRITE
    except LinkSettingError:  # told by the row of the configuration
        return


def _used_by_vision(rover: CheckedRover) -> Iterator[tuple[Path, int]]:
    """Yield what the vision process opens, and how."""
    config = rover.config
    bundle = Path(config.perceiver.name.partition(":")[2])
    if bundle.is_absolute():
        yield bundle, _READ | (_ENTER if is_folder(bundle) else 0)
    try:
        kind, where = split_source(config.camera.source)
    except CameraError:  # told by the row of the configuration
        return
    if kind in OF_PATHS:
        place = (SERVICE if _is_service(rover) else Path()) / where
        yield place, _READ | (_ENTER if is_folder(place) else 0)


def _bundle_files(rover: CheckedRover) -> Iterator[Path]:
    """Yield the files of the perceiver's bundle, as far as its manifest can be read."""
    bundle = Path(rover.config.perceiver.name.partition(":")[2])
    if bundle.is_absolute():
        yield bundle / MANIFEST
        with suppress(BundleError):  # told by the row of the perceiver
            yield from (bundle / name for name in read_manifest(bundle).files)


def _vision_user() -> _User:
    """Return the user that systemd makes for the vision process: of its groups only the cameras' counts."""
    try:
        groups = frozenset((grp.getgrnam("video").gr_gid,))
    except KeyError:
        groups = frozenset()
    return _User("anytraverse-vision", -1, groups)


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


def _refused(user: _User, path: Path, rights: int) -> CheckFinding:
    verb = "read and write" if rights & _WRITE else "read"
    text = f"user {user.name} may not {verb} {path}"
    if user.id < 0:
        return failed(
            RIGHTS, f"{text}: let the group video, or everybody, use it, and enter the folders above"
        )
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
