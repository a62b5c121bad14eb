"""Checks the recorder."""

from __future__ import annotations

import shutil

from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, passed, skipped, warned
from companion.observers.recording.recorder import missing
from companion.observers.recording.ring import FOLDER
from companion.system.computer import existing

RECORDING = "recording"
OFF = "[recording] size = 0 ends it"


def check_recording(rover: CheckedRover) -> list[CheckFinding]:
    """Check that recordings can be written, and say how many there are."""
    size, folder = rover.config.recording.size, rover.folder / FOLDER
    if not size:
        return [passed(RECORDING, "off: [recording] size is 0")]
    if why := missing():
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
