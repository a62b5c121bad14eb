"""Checks this computer: whether a companion runs, camera, perceiver, journal and disk."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from anytraverse.errors import AnyTraverseError
from anytraverse.pace import Pace
from companion.cameras import CameraError, without_credentials
from companion.config import Config
from companion.preflight.cameras import newest_capture
from companion.preflight.rules import Finding, failed, passed, warned

CHECK = "camera"
_ASPECT_OFF = 0.02


def check_camera(config: Config, running: Mapping[str, Any] | None) -> Finding:
    """Wait up to 5 s for a first picture. running: the status of a running companion, None without one.

    A running companion owns the camera, so that only its status is looked at.
    """
    if running is not None:
        return _camera_of_running(running.get("camera") or {})
    try:
        height, width, _ = newest_capture(config.camera.source, config.camera_options).image.shape
    except CameraError as error:
        return failed(CHECK, without_credentials(str(error)))
    what = f"{without_credentials(config.camera.source)}, {width} x {height}"
    aspect = config.mount.aspect
    if config.mount.height is not None and abs(width / height / aspect - 1.0) > _ASPECT_OFF:
        return warned(
            CHECK,
            f"{what}, and [mount] aspect is {aspect:g}: "
            f"set it to {width / height:.3f}, or the row stopping is wrong",
        )
    return passed(CHECK, what)


def _camera_of_running(camera: Mapping[str, Any]) -> Finding:
    state, reason = str(camera.get("state", "unknown")), str(camera.get("reason") or "")
    what = f"{state}, with the companion that runs"
    if state == "delivering":
        return passed(CHECK, what)
    if state in ("failed", "ended"):
        return failed(CHECK, f"{what}: {reason}" if reason else what)
    return warned(CHECK, f"{what}: wait, then type this again")


SERVICE = Path("/var/lib/anytraverse")
"""The service's state folder. systemd sets $STATE_DIRECTORY for the service, but not in a person's shell."""
RUNNING = 5.0
"""Seconds after which a status file is outdated. A running companion writes it once a second."""
_LEAST, _LITTLE = 50 << 20, 500 << 20


def state_folder(config: Config, service: Path = SERVICE) -> Path:
    """Return the state folder of the companion: the configured one, else the service's if it exists."""
    said = config.journal.folder or os.environ.get("STATE_DIRECTORY")
    return service if not said and service.is_dir() else config.journal.path


def status(folder: Path) -> dict[str, Any] | None:
    """Read the status of a companion that runs with this folder; None when none runs."""
    path = folder / "status.json"
    try:
        if time.time() - path.stat().st_mtime > RUNNING:
            return None
        said = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return said if isinstance(said, dict) and is_alive(said.get("pid")) else None


def is_alive(pid: object) -> bool:
    """Whether this process exists. True, too, when that cannot be known.

    Without this check a companion that has just ended would seem to run, until its status file is outdated.
    """
    if not isinstance(pid, int) or pid <= 0:
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass
    return True


class Perceives(NamedTuple):
    """Holds the result of checking the perceiver.

    step: seconds for a frame. tile: the threshold of the worst tile, None: tiles are not judged.
    """

    finding: Finding
    step: float = 0.0
    tile: float | None = None


def check_perceiver(config: Config) -> Perceives:
    """Load the perceiver and measure its time for a frame, as the daemon does. Takes seconds."""
    from companion.vision.messages import Model
    from companion.vision.warm_up import load_and_warm_up, too_slow

    try:
        ready = load_and_warm_up(config, None)
    except AnyTraverseError as error:
        return Perceives(failed("perceiver", str(error)))
    tile = ready.engine.settings.thresholds.tile
    pace = Pace(ready.step, 1.0 / config.camera.rate, config.freshness)
    if not pace.keeps:
        make_finding = failed if config.call.policy == "hold" else warned
        return Perceives(make_finding("perceiver", too_slow(pace)), ready.step, tile)
    what = f"{Model.of(ready.engine.perceiver)}, {1e3 * ready.step:.0f} ms a frame"
    return Perceives(passed("perceiver", what), ready.step, tile)


def check_journal(folder: Path, *, running: bool) -> Finding:
    """Check that the folder can be written, and leave no file there.

    A file of root's would keep out the daemon, which runs as another user.
    """
    if running:
        return passed("journal", f"{folder}, in use by the companion that runs")
    place = next((path for path in (folder, *folder.parents) if path.exists()), Path("/"))
    try:
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        return failed(
            "journal", f"{place} cannot be written ({why}): check [journal] folder, and who owns it"
        )
    what = f"{folder} can be written" if place == folder else f"{folder} can be made"
    if os.geteuid() == 0 and place.stat().st_uid != 0:
        what += f" by root; the service runs as {_owner(place)}"
    return passed("journal", what)


def _owner(path: Path) -> str:
    try:
        return path.owner()
    except KeyError:
        return f"user {path.stat().st_uid}"


def check_disk(folder: Path) -> Finding:
    """Check that the disk has room for journal, pictures and logs."""
    place = next((path for path in (folder, *folder.parents) if path.is_dir()), Path("/"))
    free = shutil.disk_usage(place).free
    what = f"{free >> 20} MiB free at {place}"
    if free < _LEAST:
        return failed("disk", f"{what}: make room, or nothing that it learns is kept")
    if free < _LITTLE:
        return warned("disk", f"{what}: make room, or set [pictures] keep lower")
    return passed("disk", what)
