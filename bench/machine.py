"""Describes what a benchmark measured, and on which machine."""

from __future__ import annotations

import os
import platform
from contextlib import suppress
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from anytraverse.bundle.machine import this_machine
from bench.commit import commit_of

ROOT = Path(__file__).resolve().parents[1]
_PACKAGES = ("numpy", "onnxruntime", "opencv-python-headless", "torch", "transformers")
_GOVERNOR = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")


def describe_run() -> dict[str, Any]:
    """Return commit, time (UTC), load and machine. Call it before measuring: both may change meanwhile.

    cpu_flags: those that matter to networks. cores: those that this process may use. memory_mb: 10^6 bytes.
    governor: of the first core. load: processes that ran or waited, over the last minute. A governor that the
    kernel does not tell, and packages that are not installed, are left out.
    """
    machine = this_machine()
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return {
        "commit": commit_of(ROOT) or "unknown",
        "when": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "load": round(os.getloadavg()[0], 1),
        "cpu": machine.cpu,
        "cpu_flags": list(machine.flags),
        "architecture": machine.architecture,
        "cores": len(os.sched_getaffinity(0)),
        "memory_mb": round(memory / 1e6),
        **_governor(),
        "os": _system(),
        "python": platform.python_version(),
        **_versions(),
    }


def _governor() -> dict[str, str]:
    with suppress(OSError):
        return {"governor": _GOVERNOR.read_text(encoding="ascii").strip()}
    return {}


def _system() -> str:
    name = platform.system()
    with suppress(OSError):
        name = platform.freedesktop_os_release().get("PRETTY_NAME", name)
    return f"{name}, kernel {platform.release().partition('-')[0]}"


def _versions() -> dict[str, str]:
    found = {}
    for package in _PACKAGES:
        with suppress(PackageNotFoundError):
            found[package] = version(package)
    return found
