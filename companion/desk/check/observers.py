"""Checks what shows and records what the companion does: page, video, recorder, live view."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Mapping
from typing import Any

from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, Verdict, passed, skipped, warned
from companion.observers.live.live import missing as missing_for_live
from companion.observers.page.page import missing as missing_for_page
from companion.observers.recording.recorder import missing as missing_for_recording
from companion.observers.recording.ring import FOLDER
from companion.observers.video.rtsp_server import BINDINGS, elements
from companion.observers.video.video import PACKAGES
from companion.pages.listen import read_listen
from companion.system.computer import existing

PAGE = "page"
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
RECORDING = "recording"
OFF = "[recording] size = 0 ends it"
LIVE = "live view"


def check_page(rover: CheckedRover) -> list[CheckFinding]:
    """Check that the page can be shown, and say who may see it."""
    if rover.config.web.address is None:
        return [passed(PAGE, 'off: [web] listen is ""')]
    if why := missing_for_page():
        return [warned(PAGE, f'{why}, or set [web] listen = ""')]
    whose = (
        "whoever knows the token, who may answer calls on it"
        if rover.config.web.token
        else "programs on this computer"
    )
    return [served(rover, PAGE, rover.config.web.listen, rover.told("web"), f"to {whose}", "[web] listen")]


def served(
    rover: CheckedRover, name: str, where: str, told: Mapping[str, Any], whose: str, setting: str
) -> CheckFinding:
    """Check what is served at "address:port": by the companion that runs, or that the port is free for it.

    told: what the companion that runs says of it. whose: to whom it is shown. setting: where to mend it.
    """
    if rover.running is not None:
        if told.get("trouble") == "starting":
            return skipped(name, "not known yet: it is starting")
        if told.get("trouble"):
            return warned(name, f"it {told['trouble']}, and is tried again: see {setting}, and the log")
        if not told.get("url"):
            return skipped(name, "not known: the companion that runs does not say where it is")
        return passed(name, f"{told['url']} shows it {whose}")
    try:
        listen = read_listen(where)
        assert listen is not None
        listen.bind().close()
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        return warned(name, f"{where} cannot be had ({why}): set another {setting}")
    return passed(name, f"{where} is free, and will show it {whose}")


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


def check_recording(rover: CheckedRover) -> list[CheckFinding]:
    """Check that recordings can be written, and say how many there are."""
    size, folder = rover.config.recording.size, rover.folder / FOLDER
    if not size:
        return [passed(RECORDING, "off: [recording] size is 0")]
    if why := missing_for_recording():
        what = f"{why}, or set [recording] size = 0"
        return [warned(RECORDING, what)]
    if rover.running is None:
        free = shutil.disk_usage(existing(rover.folder)).free // 1_000_000
        if free < size:
            what = f"{free} MB are free, and [recording] size is {size}: it stops before the disk is full"
            return [warned(RECORDING, what)]
        what = f"records pictures, positions and the log into {folder}: {size} MB at most, {free} MB are free"
        return [passed(RECORDING, f"{what}; {OFF}")]
    told = rover.told("recording")
    trouble, lost = told.get("trouble"), told.get("lost")
    if trouble == "starting" or not told:
        return [skipped(RECORDING, "not known yet: it is starting")]
    if trouble:
        return [warned(RECORDING, f"{trouble}: nothing is recorded until that is mended")]
    what = f"{told_recordings(told)} of {size} MB in {folder}"
    if lost:
        return [warned(RECORDING, f"{what}; lower [recording] rate, or take a better card")]
    return [passed(RECORDING, f"{what}; {OFF}")]


def told_recordings(told: object) -> str:
    """Say in a few words what a companion tells of its recordings, whatever that is."""
    figures = told if isinstance(told, dict) else {}
    files, size, lost = (figures.get(name) for name in ("files", "bytes", "lost"))
    if not isinstance(files, int) or not isinstance(size, int):
        return "not known"
    return f"{files} files, {size / 1e6:.0f} MB{f', {lost} messages lost' if lost else ''}"


def check_live(rover: CheckedRover) -> list[CheckFinding]:
    """Check that the live view can be served, and say who may see it."""
    settings = rover.config.live
    if settings.address is None:
        return [passed(LIVE, 'off: [live] listen is ""')]
    if why := missing_for_live():
        return [warned(LIVE, f'{why}, or set [live] listen = ""')]
    loopback = settings.address.loopback
    whose = "to programs on this computer" if loopback else "to whoever reaches that port: it has no password"
    found = served(rover, LIVE, settings.listen, rover.told("live"), whose, "[live] listen")
    return [found if loopback or found.verdict is not Verdict.PASS else warned(LIVE, found.text)]
