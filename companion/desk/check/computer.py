"""Checks this computer: installed packages, the service, disk, clock, heat and load."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from platform import python_version

from anytraverse.release import own_version, to_install
from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, failed, passed, skipped, warned
from companion.storage.writer import SLOW
from companion.system.computer import HOT, WARM, existing, is_synchronised
from companion.vehicle.state import is_set

VERSIONS, SERVICE, SPACE, SPEED = "versions", "service", "disk", "disk speed"
CLOCK, HEAT, LOAD = "clock", "heat", "load"
_NEEDED = ("numpy", "pymavlink")
_ONE_OF = (
    ("cv2", ("opencv-python-headless", "opencv-python", "opencv-contrib-python")),
    ("onnxruntime", ("onnxruntime", "onnxruntime-gpu", "onnxruntime-openvino")),
)
"""Module -> the packages that contain it. Two of them overwrite each other's files."""


def _installed(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def check_versions(rover: CheckedRover) -> list[CheckFinding]:
    """Check that the packages are installed, each module by one package, and which version runs."""
    own, told = own_version(), (rover.running or {}).get("version")
    if isinstance(told, str) and told != own:
        again = "sudo systemctl restart companion"
        return [warned(VERSIONS, f"{told} runs, and {own} is installed: restart the companion ({again})")]
    found = [(name, _installed(name)) for name in _NEEDED]
    for module, packages in _ONE_OF:
        there = [(name, number) for name in packages if (number := _installed(name))]
        if len(there) > 1:
            names, again = " and ".join(name for name, _ in there), to_install("rover")
            return [failed(VERSIONS, f"{names} overwrite each other: pip uninstall both, then {again}")]
        found += there or [(module, None)]
    missing = [name for name, number in found if number is None]
    if missing:
        return [failed(VERSIONS, f"{', '.join(missing)} not installed: {to_install('rover')}")]
    listed = ", ".join(f"{name} {number}" for name, number in found)
    return [passed(VERSIONS, f"companion {own}, Python {python_version()}, {listed}")]


UNIT = "companion.service"
_PATIENCE = 5.0


def check_service(rover: CheckedRover) -> list[CheckFinding]:
    """Check that systemd starts the companion at boot, and that it did not fail."""
    if rover.inside:
        if (rover.running or {}).get("service"):
            return [passed(SERVICE, "started by systemd")]
        if os.environ.get("container"):  # noqa: SIM112  # so systemd and podman call it
            return [skipped(SERVICE, "in a container: what runs it has to start it at boot")]
        return [warned(SERVICE, "started by hand: nothing starts it at boot: sudo sh systemd/install.sh")]
    told = _unit()
    if told is None:
        return [skipped(SERVICE, "no systemd answers here: see to it that something starts the companion")]
    state, enabled = told.get("ActiveState", ""), told.get("UnitFileState", "")
    if told.get("LoadState") != "loaded":
        return [warned(SERVICE, "not installed: nothing starts it at boot: sudo sh systemd/install.sh")]
    what = f"{state}, {enabled}, started again {told.get('NRestarts', '0')} x"
    if state == "failed":
        return [failed(SERVICE, f"{what}: journalctl -u companion says why")]
    if enabled not in ("enabled", "enabled-runtime", "static", "alias", "generated"):
        return [warned(SERVICE, f"{what}: it does not start at boot: sudo systemctl enable companion")]
    return [passed(SERVICE, what)]


def _unit() -> dict[str, str] | None:
    """Ask systemd about the unit; None where there is no systemd, or it does not answer."""
    names = "--property=LoadState,ActiveState,UnitFileState,NRestarts"
    try:
        ran = subprocess.run(
            ["systemctl", "show", UNIT, names],
            capture_output=True,
            text=True,
            timeout=_PATIENCE,
            check=True,
            errors="replace",
        )
    except (OSError, subprocess.SubprocessError):
        return None
    pairs = (line.partition("=") for line in ran.stdout.splitlines())
    told = {name: value for name, _, value in pairs}
    return told if "LoadState" in told else None


_LEAST, _LITTLE = 50 << 20, 500 << 20


def check_space(folder: Path) -> CheckFinding:
    """Check that the disk has room for journal, pictures and logs."""
    place = existing(folder)
    free = shutil.disk_usage(place).free
    what = f"{free >> 20} MiB free at {place}"
    if free < _LEAST:
        return failed(SPACE, f"{what}: make room, or nothing that it learns is kept")
    if free < _LITTLE:
        return warned(SPACE, f"{what}: make room, or set [pictures] keep lower")
    return passed(SPACE, what)


_WRITES, _BLOCK = 8, 64 << 10
_SLOWISH = 0.5
"""Seconds for a write that reaches the disk beyond which it is slow, but not yet too slow."""


def check_speed(rover: CheckedRover) -> list[CheckFinding]:
    """Check how long a write takes until it is on the disk: 64 KiB, the slowest of eight."""
    disk = rover.told("disk")
    if rover.running is not None:
        if disk.get("failing"):
            return [failed(SPEED, f"writes fail, or take over {SLOW:g} s: check the disk, and its room")]
        failures = disk.get("errors") or disk.get("dropped")
        if failures:
            return [
                warned(SPEED, f"writes failed or were left out since the start ({failures}): see its log")
            ]
        return [passed(SPEED, f"the companion that runs writes, each within {SLOW:g} s")]
    try:
        slowest = _slowest(existing(rover.folder))
    except OSError as error:
        return [
            skipped(SPEED, f"not measured: {(error.strerror or str(error)).lower()}: see the row journal")
        ]
    what = f"64 KiB are on the disk after {1e3 * slowest:.0f} ms, the slowest of {_WRITES}"
    if slowest > SLOW:
        return [
            failed(SPEED, f"{what}: answers count as not remembered after {SLOW:g} s: take a better card")
        ]
    if slowest > _SLOWISH:
        return [warned(SPEED, f"{what}: take a better card, or find what else writes")]
    return [passed(SPEED, what)]


def _slowest(folder: Path) -> float:
    slowest = 0.0
    with tempfile.TemporaryFile(dir=folder) as file:
        for _ in range(_WRITES):
            began = time.monotonic()
            file.write(os.urandom(_BLOCK))
            file.flush()
            os.fsync(file.fileno())
            slowest = max(slowest, time.monotonic() - began)
            if slowest > SLOW:
                break
    return slowest


_RTC = Path("/sys/class/rtc/rtc0")


def check_clock(rover: CheckedRover) -> list[CheckFinding]:
    """Check that the clock was set, and whether it goes on without power."""
    now = time.time()
    shown = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(now))
    battery = (
        ""
        if _RTC.exists()
        else "; it has no battery: after a start, times come from network or autopilot (GNSS)"
    )
    if is_set(now):
        by = ", set by the network" if is_synchronised() else ""
        return [passed(CLOCK, f"{shown}{by}{battery}")]
    signed = rover.config.link.signing_key is not None
    silent = ", and with a signing key it sends nothing until a signed frame tells the time" if signed else ""
    return [warned(CLOCK, f"{shown}, never set: let network or autopilot (GNSS) tell the time{silent}")]


def check_heat(rover: CheckedRover) -> list[CheckFinding]:
    """Check temperature, throttling and supply."""
    told = rover.computer
    degrees, throttled, low = (told.get(name) for name in ("temperature", "throttled", "under_voltage"))
    if low:
        return [warned(HEAT, "the supply's voltage is too low: take a better supply and a shorter cable")]
    if degrees is None:
        if throttled:
            return [warned(HEAT, "the CPU is slowed down: cool it, or check its supply")]
        return [skipped(HEAT, "not known: this computer has no temperature in /sys/class/thermal")]
    what = f"{degrees:.0f} C{', the CPU is slowed down' if throttled else ''}"
    if degrees >= HOT:
        return [failed(HEAT, f"{what}: it is about to switch off: cool it")]
    if degrees >= WARM or throttled:
        return [warned(HEAT, f"{what}: cool it, since a slow computer sees late")]
    return [passed(HEAT, what)]


_BUSY_ALONE, _BUSY = 0.5, 0.97
"""Share of the CPU in use: without a companion, and with one, beyond which there is too much to do."""
_SCARCE = 150
"""MiB of free memory below which the kernel may soon end the vision process."""


def check_load(rover: CheckedRover) -> list[CheckFinding]:
    """Check CPU and memory, and whether frames are judged as often as configured."""
    told, judging = rover.computer, rover.told("judging")
    cpu, total, free = (told.get(name) for name in ("cpu", "memory", "memory_free"))
    parts = [] if cpu is None else [f"CPU {100 * cpu:.0f} %"]
    if total is not None and free is not None:
        parts.append(f"{free} of {total} MiB memory free")
        if free < _SCARCE:
            return [warned(LOAD, f"{', '.join(parts)}: end other programs, or take a smaller model")]
    if judging.get("lowered_by"):
        parts.append(f"judges {judging.get('rate')} frames/s of {judging.get('configured')}")
        remedy = "`top` shows which program: end it, cool the computer, or lower [camera] rate"
        return [warned(LOAD, f"{', '.join(parts)} ({judging['lowered_by']}): {remedy}")]
    if not parts:
        return [skipped(LOAD, "this computer tells neither CPU nor memory")]
    what = ", ".join(parts)
    if cpu is not None and cpu > (_BUSY if rover.running is not None else _BUSY_ALONE):
        return [warned(LOAD, f"{what}: `top` shows which program: end it, or lower [camera] rate")]
    return [passed(LOAD, what)]
