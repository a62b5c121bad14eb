"""A rover that has driven: a daemon in virtual time, with what it recorded, logged and stored."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from bench.virtual_time import virtual_time
from companion.cameras.newest import CameraState
from companion.observers.recording.foxglove import NS
from companion.observers.recording.ring import FOLDER
from companion.observers.recording.ring_writer import RingWriter
from companion.storage.log_file import FOLDER as LOGS
from companion.storage.log_file import NAME as LOG
from companion.wire.ids import Motion, Policy
from tests.anytraverse.conftest import HEIGHT, WIDTH
from tests.companion.daemon.rig import Rig

SECRETS = ("sesame-open-sesame", "hunter2", "s3cretkey", "ntfy-topic-of-mine", "page-token-in-a-link")
_CONFIG = """
[camera]
source = "rtsp://admin:hunter2@camera.local/stream"
[vehicle]
file = ""
[link]
url = "udpout:127.0.0.1:9"
signing_key = "signing.key"
[journal]
folder = "state"
[web]
listen = "127.0.0.1:0"
token = "sesame-open-sesame"
[alert]
url = "https://ntfy.sh/ntfy-topic-of-mine"
link = "https://rover.local/?token=page-token-in-a-link"
[words]
grass = 1.0
"""
BEGAN = 1_790_000_000.0
ANSWERED_AFTER = 4.0
SILENT_FOR = 6.0
"""Seconds."""


def configured(folder: Path) -> Path:
    """A configuration with a secret wherever one can stand."""
    path = folder / "companion.toml"
    path.write_text(_CONFIG)
    path.chmod(0o600)
    (folder / "signing.key").write_text("s3cretkey")
    (folder / "signing.key").chmod(0o600)
    return path


class _InVirtualTime(logging.Handler):
    """Writes lines as the companion's log has them, at the times that the recordings have."""

    def __init__(self, path: Path, rig: Rig) -> None:
        super().__init__()
        self._path, self._rig = path, rig

    def emit(self, record: logging.LogRecord) -> None:
        at = self._rig.daemon.recording._ns(time.monotonic()) / NS
        stamp = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(at))
        with self._path.open("a") as file:
            file.write(
                f"{stamp},{int(at % 1 * 1000):03d} {record.levelname} {record.name}: {record.getMessage()}\n"
            )


@contextmanager
def _logged(path: Path, rig: Rig) -> Iterator[None]:
    path.parent.mkdir(exist_ok=True)
    handler, root = _InVirtualTime(path, rig), logging.getLogger()
    before = root.level
    root.addHandler(handler)
    root.setLevel(logging.INFO)
    try:
        logging.getLogger("companion.run").info("ready: policy hold")
        yield
    finally:
        root.removeHandler(handler)
        root.setLevel(before)


def drive(state: Path) -> None:
    """Drive: a drum, a call with its hold, an answer after `ANSWERED_AFTER`, a camera that is lost."""
    state.mkdir()
    with virtual_time() as clock:
        rig = Rig(state, clock, Policy.HOLD)
        rig.daemon.position.clock._wall = lambda: BEGAN + clock.now
        rig.daemon.recording._offset = BEGAN
        rig.daemon.recording.listeners = (1,)

        def seconds(count: float, thing: str = "") -> None:
            for _ in range(round(count)):
                rig.see(1.0, thing)
                rig.camera.status = replace(rig.camera.status, read=rig.frame_id, width=WIDTH, height=HEIGHT)
                rig.wait(0.1)
                rig.daemon.write_status(web={})

        try:
            with _logged(state / LOGS / LOG, rig):
                seconds(5)
                while not rig.calls.current_id:
                    rig.see(0.1, "drum")
                opened = clock.now
                while clock.now - opened < ANSWERED_AFTER:
                    rig.see(0.1, "drum")
                rig.word(rig.calls.current_id, "drum", 1.0, Motion.GO)
                seconds(6, "drum")
                rig.camera.status = replace(rig.camera.status, state=CameraState.FAILED, reason="unplugged")
                for _ in range(round(SILENT_FOR)):
                    rig.wait(1.0)
                    rig.daemon.write_status(web={})
                rig.camera.status = replace(rig.camera.status, state=CameraState.DELIVERING, reason="")
                seconds(8)
                messages = rig.daemon.recording.take()
                rig.wait(0.1)
        finally:
            rig.kill()
    os.utime(state / "status.json", (BEGAN, BEGAN))  # no companion runs
    ring = RingWriter(state / FOLDER, 20_000_000)
    ring.begin(0.0)
    for number, one in enumerate(messages):
        ring.write(one, number / 1e6)
    ring.finish(1.0)
