"""The whole companion in processes of its own, with painted eyes, and the configuration that it takes.

`tests.companion.daemon.rig` runs the same daemon in virtual time instead.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2

from anytraverse.frame import Image
from bench.processes import child_of
from companion.desk.check.here import read_status
from tests.companion.daemon.rig import picture
from tests.waiting import wait_for

ROOT = Path(__file__).resolve().parents[2]
PATIENCE = 20.0
TO_A_DRUM = [picture(), *[picture("drum")] * 29]
"""A frame of grass, and 29 of a drum without a word."""
_SCRIPT = """
import sys
from tests.companion.vision.painted import COMMAND, register
register()
from companion.cli import main
sys.exit(main(["run", sys.argv[1]], vision=COMMAND))
"""
_CONFIG = """
{top}
[camera]
source = "folder:{folder}/frames"
loop = true
{camera}
[perceiver]
{perceiver}
[web]
{web}
[recording]
size = {recorded}
rate = 5
[vehicle]
file = ""
[link]
url = "udpout:127.0.0.1:{port}"
{link}
[journal]
folder = "{folder}/state"
[words]
grass = 1.0
{more}
"""
_SHORTEST = {"perceiver": 'name = "painted"', "web": 'listen = ""', "recorded": "0"}
_SHORTEST |= dict.fromkeys(("top", "camera", "link", "more"), "")


def painted_config(folder: Path, port: int, pictures: Sequence[Image] = TO_A_DRUM, **lines: str) -> Path:
    """Writes the pictures and a configuration, which it returns. port: of the ground on 127.0.0.1.

    lines: top, camera, perceiver, web and link: at the top and of these sections; recorded: MB of them all;
    more: what follows the first line of [words].
    """
    (folder / "frames").mkdir()
    for number, image in enumerate(pictures):
        cv2.imwrite(str(folder / "frames" / f"{number:02}.png"), image[..., ::-1])
    config = folder / "companion.toml"
    config.write_text(_CONFIG.format(**{**_SHORTEST, **lines}, folder=folder, port=port))
    config.chmod(0o600)  # it may hold a token
    return config


class Companion:
    """`companion run` on a `painted_config`. `ground` is a radio that only listens."""

    def __init__(
        self,
        folder: Path,
        pictures: Sequence[Image] = TO_A_DRUM,
        stderr: int = subprocess.DEVNULL,
        **lines: str,
    ) -> None:
        self.ground = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.ground.bind(("127.0.0.1", 0))
        self.state, self._stderr = folder / "state", stderr
        self.config = painted_config(folder, self.ground.getsockname()[1], pictures, **lines)
        self.start()

    def start(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", _SCRIPT, str(self.config)],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stderr=self._stderr,
        )

    def told(self) -> dict[str, Any]:
        """The status file."""
        return read_status(self.state)[1]

    def child(self, module: str) -> int:
        """The id of the process that runs this module, 0 without one."""
        return child_of(self.process.pid, module)

    def until(self, fits: Callable[[], object], what: str = "") -> None:
        """Wait for it. Nothing but SIGKILL may end the companion meanwhile."""

        def fitting() -> object:
            assert self.process.poll() in (None, -signal.SIGKILL), what
            return fits()

        wait_for(fitting, PATIENCE, lambda: (what, self.told()))

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self.ground.close()


def heard(radio: socket.socket) -> bytes:
    """All that came over the air."""
    found = b""
    try:
        while True:
            found += radio.recv(300)
    except TimeoutError:
        return found
