"""What can be checked on this computer alone: who runs, perceiver, journal, disk."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

from anytraverse.errors import AnyTraverseError
from anytraverse.pace import Pace
from companion.check.finding import Finding, failed, passed, warned
from companion.config import Config

SERVICE = Path("/var/lib/anytraverse")
"""Where the service keeps what must survive; a shell does not know of its $STATE_DIRECTORY."""
RUNNING = 5.0
"""Seconds that a status file stays young: it is written once a second."""
_LEAST, _LITTLE = 50 << 20, 500 << 20


def state_folder(config: Config, service: Path = SERVICE) -> Path:
    """The folder of the daemon that is meant: the configured one, else the service's where there is one."""
    said = config.journal.folder or os.environ.get("STATE_DIRECTORY")
    return service if not said and service.is_dir() else config.journal.path


def status(folder: Path) -> dict[str, Any] | None:
    """What a daemon that runs there said a moment ago; None where none runs."""
    path = folder / "status.json"
    try:
        if time.time() - path.stat().st_mtime > RUNNING:
            return None
        said = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return said if isinstance(said, dict) and is_alive(said.get("pid")) else None


def is_alive(pid: object) -> bool:
    """Whether that process is there, or nothing is known of it: its file stays young for a while after it."""
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
    """step: s that the perceiver takes for a frame. tile: the worst tile's threshold, None: not judged."""

    finding: Finding
    step: float = 0.0
    tile: float | None = None


def check_perceiver(config: Config) -> Perceives:
    """Loaded and timed as the daemon does it, which takes seconds."""
    from companion.model import Model
    from companion.readiness import get_ready, too_slow

    try:
        ready = get_ready(config, None)
    except AnyTraverseError as error:
        return Perceives(failed("perceiver", str(error)))
    tile = ready.engine.settings.thresholds.tile
    pace = Pace(ready.step, 1.0 / config.camera.rate, config.freshness)
    if not pace.keeps:
        told = failed if config.call.policy == "hold" else warned
        return Perceives(told("perceiver", too_slow(pace)), ready.step, tile)
    what = f"{Model.of(ready.engine.perceiver)}, {1e3 * ready.step:.0f} ms a frame"
    return Perceives(passed("perceiver", what), ready.step, tile)


def check_journal(folder: Path, *, running: bool) -> Finding:
    """Whether the folder can be written, without a trace: whoever types this may be root, the daemon not."""
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
    """Room for journal, pictures and logs."""
    place = next((path for path in (folder, *folder.parents) if path.is_dir()), Path("/"))
    free = shutil.disk_usage(place).free
    what = f"{free >> 20} MiB free at {place}"
    if free < _LEAST:
        return failed("disk", f"{what}: make room, or nothing that it learns is kept")
    if free < _LITTLE:
        return warned("disk", f"{what}: make room, or set [pictures] keep lower")
    return passed("disk", what)
