"""Starts what stands in for cameras: servers of RTSP and HTTP MJPEG, and a writer of raw pictures."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).parents[2]
SYSTEM_PYTHON = "/usr/bin/python3"
STARTS_WITHIN = 20.0
_NEEDS = """
import gi
gi.require_version("Gst", "1.0")
gi.require_version("GstRtspServer", "1.0")
from gi.repository import Gst, GstRtspServer
Gst.init(None)
assert Gst.ElementFactory.find("x264enc")
"""


def rtsp_missing() -> str:
    """Say what is missing for the RTSP server, "" for nothing."""
    try:
        subprocess.run([SYSTEM_PYTHON, "-c", _NEEDS], check=True, capture_output=True, timeout=STARTS_WITHIN)
    except (OSError, subprocess.SubprocessError):
        return "needs sudo apt install gir1.2-gst-rtsp-server-1.0 gstreamer1.0-plugins-ugly python3-gi"
    return ""


class CameraServer:
    """Runs a server in a process of its own, and can freeze, kill and start it again at the same port."""

    def __init__(self, script: str, *arguments: str, env: Mapping[str, str] | None = None) -> None:
        python = SYSTEM_PYTHON if script.startswith("rtsp") else sys.executable
        self._command = (python, "-m", f"bench.cameras.{script}")
        self._arguments, self._env = arguments, {**os.environ, "PYTHONPATH": str(ROOT), **(env or {})}
        self.port = 0
        self.start()

    def start(self) -> None:
        """Start it, and wait until it listens."""
        self.process = subprocess.Popen(
            [*self._command, str(self.port), *self._arguments],
            env=self._env,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert self.process.stdout is not None
        self.port = int(self.process.stdout.readline())

    def freeze(self) -> None:
        """Stop it as SIGSTOP does."""
        self.process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """Let it go on."""
        self.process.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        """Kill it, frozen or not."""
        self.process.kill()
        self.process.wait(STARTS_WITHIN)
        assert self.process.stdout is not None
        self.process.stdout.close()


@contextlib.contextmanager
def serving(script: str, *arguments: str, env: Mapping[str, str] | None = None) -> Iterator[CameraServer]:
    """Run a server until the block ends."""
    server = CameraServer(script, *arguments, env=env)
    try:
        yield server
    finally:
        server.kill()


def writer(*arguments: object) -> str:
    """Return the command of a program that writes raw pictures; arguments: see raw_writer."""
    return " ".join(
        ["env", f"PYTHONPATH={ROOT}", sys.executable, "-m", "bench.cameras.raw_writer", *map(str, arguments)]
    )


def installed(*programs: str) -> bool:
    """Whether all these programs are on PATH."""
    return all(shutil.which(program) for program in programs)
