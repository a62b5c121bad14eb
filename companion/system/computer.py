"""Reads how this computer does: temperature, throttling, load, memory and disk, from Linux's own files."""

from __future__ import annotations

import os
from glob import glob
from pathlib import Path
from typing import Any

_MOST = 32
"""Sensors, and cooling devices, that are read at most."""
_LONGEST = 4096
"""Bytes of a file that are read at most."""
WARM, HOT = 80.0, 95.0
"""Degrees Celsius: from the first on most boards slow down, from the second on they switch off."""
_HOTTEST, _COLDEST = 150.0, -50.0
"""Degrees Celsius. A sensor that says more or less is not read."""
_COOLING = ("cpufreq", "processor", "cpu")
"""What the names of those cooling devices contain that make the CPU slower."""
_THROTTLED = "sys/devices/platform/soc/soc:firmware/get_throttled"
"""A Raspberry Pi's firmware says here what it limits now."""
_UNDER_VOLTAGE, _CAPPED_OR_THROTTLED = 0b0001, 0b1110
SYNCHRONISED = Path("/run/systemd/timesync/synchronized")
"""systemd-timesyncd makes this file once it has set the clock. Other services of NTP do not."""


def is_synchronised() -> bool:
    """Whether the network has set the clock since the boot; False where nobody says so."""
    return SYNCHRONISED.exists()


class Computer:
    """Measures the computer on which this runs. `newest` may be read by any thread; one thread measures.

    What the computer does not tell is None. Its files are named by text: pathlib interns each part of a path,
    and Python's table of interned texts doubles to 2 MB when some come and go each second for an hour.
    """

    def __init__(self, folder: Path, root: Path = Path("/")) -> None:
        """folder: on the disk whose room counts. root: of the file system to read."""
        self._folder = folder
        self._root = root
        self._ticks: tuple[int, int] | None = None
        self.newest: dict[str, Any] = {}

    def measure(self) -> dict[str, Any]:
        """Measure, and return and store the figures: JSON values.

        temperature: degrees Celsius of the hottest sensor. throttled, under_voltage: now. cpu: share of all
        cores' time that was used since the measurement before, in [0, 1]; None at the first one. memory,
        memory_free, disk, disk_free: MiB. Takes milliseconds, unless the disk hangs.
        """
        throttled, under_voltage = self._limits()
        total, free = self._memory()
        self.newest = {
            "temperature": self._temperature(),
            "throttled": throttled,
            "under_voltage": under_voltage,
            "cpu": self._cpu(),
            "memory": total,
            "memory_free": free,
            **self._disk(),
        }
        return self.newest

    def _temperature(self) -> float | None:
        found = (self._number(f"{zone}/temp") for zone in self._some("thermal_zone*"))
        degrees = [value / 1000.0 for value in found if value is not None]
        return max((round(one, 1) for one in degrees if _COLDEST <= one <= _HOTTEST), default=None)

    def _limits(self) -> tuple[bool | None, bool | None]:
        """Whether the CPU is slowed down now, and whether the supply's voltage is too low now."""
        told = self._text(_THROTTLED)
        try:
            bits = None if told is None else int(told, 16)
        except ValueError:
            bits = None
        states = [
            self._number(f"{device}/cur_state")
            for device in self._some("cooling_device*")
            if any(part in (self._text(f"{device}/type") or "").lower() for part in _COOLING)
        ]
        known = [state > 0 for state in states if state is not None]
        if bits is not None:
            return any(known) or bool(bits & _CAPPED_OR_THROTTLED), bool(bits & _UNDER_VOLTAGE)
        return any(known) if known else None, None

    def _cpu(self) -> float | None:
        try:
            fields = [int(one) for one in (self._text("proc/stat") or "").split("\n")[0].split()[1:9]]
            before, self._ticks = self._ticks, (sum(fields), fields[3] + fields[4])
        except (ValueError, IndexError):
            return None
        if before is None or self._ticks[0] <= before[0]:
            return None
        idle = (self._ticks[1] - before[1]) / (self._ticks[0] - before[0])
        return round(min(1.0, max(0.0, 1.0 - idle)), 3)

    def _memory(self) -> tuple[int | None, int | None]:
        lines = (self._text("proc/meminfo") or "").splitlines()
        kib = {}
        for line in lines:
            name, _, rest = line.partition(":")
            if name in ("MemTotal", "MemAvailable") and rest.split()[:1] and rest.split()[0].isdecimal():
                kib[name] = int(rest.split()[0]) >> 10
        return kib.get("MemTotal"), kib.get("MemAvailable")

    def _disk(self) -> dict[str, int | None]:
        try:
            room = os.statvfs(existing(self._folder))
        except OSError:
            return {"disk": None, "disk_free": None}
        return {"disk": room.f_blocks * room.f_frsize >> 20, "disk_free": room.f_bavail * room.f_frsize >> 20}

    def _some(self, pattern: str) -> list[str]:
        return sorted(glob(f"sys/class/thermal/{pattern}", root_dir=self._root))[:_MOST]

    def _number(self, name: str) -> int | None:
        try:
            return int(self._text(name) or "")
        except ValueError:
            return None

    def _text(self, name: str) -> str | None:
        try:
            with open(f"{self._root}/{name}", "rb") as file:
                return file.read(_LONGEST).decode("ascii", "replace").strip()
        except OSError:  # absent, or a sensor that does not answer now
            return None


def existing(folder: Path) -> Path:
    """Return the folder, or the nearest folder above it that exists."""
    return next((path for path in (folder, *folder.parents) if is_folder(path)), Path("/"))


def is_folder(path: Path) -> bool:
    """Whether this is a folder. False where a folder above it may not be entered."""
    try:
        return path.is_dir()
    except OSError:
        return False
