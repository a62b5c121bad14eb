"""Checks the video of the MAVLink camera."""

from __future__ import annotations

import subprocess

from companion.desk.check.page import served
from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, passed, warned
from companion.observers.video.rtsp_server import BINDINGS, elements
from companion.observers.video.video import PACKAGES

VIDEO = "video"
_WITHIN = 30.0
_PROBE = """
import sys, gi
for name in sys.argv[1].split():
    gi.require_version(name, "1.0")
from gi.repository import Gst, GstRtspServer
Gst.init(None)
print(" ".join(name for name in sys.argv[2:] if Gst.ElementFactory.find(name) is None))
"""


def check_video(rover: CheckedRover) -> list[CheckFinding]:
    """Check that the video can be served, and say where."""
    settings = rover.config.video
    if settings.address is None:
        return [passed(VIDEO, 'off: [video] listen is "", and the companion is no MAVLink camera')]
    if rover.running is None and (missing := missing_of(settings.python, settings.encoder)):
        return [warned(VIDEO, f"{missing}: sudo apt install {PACKAGES}")]
    whose = "to whoever reaches that port"
    return [served(rover, VIDEO, settings.listen, rover.told("video"), whose, "[video] listen")]


def missing_of(python: str, encoder: str) -> str:
    """Say what this Python's GStreamer lacks for the video, "" for nothing. encoder: of `[video]`."""
    try:
        probed = subprocess.run(
            [python, "-I", "-c", _PROBE, " ".join(BINDINGS), *elements(encoder)],
            capture_output=True,
            text=True,
            timeout=_WITHIN,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"{python} cannot be run ({error})"
    if probed.returncode:
        return "GStreamer's RTSP server for Python is not installed"
    return f"no {', '.join(probed.stdout.split())} in GStreamer" if probed.stdout.strip() else ""
