"""Describes the machine on which the figures were measured."""

from __future__ import annotations

import os
import platform
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from anytraverse.bundle.machine import this_machine
from bench.commit import commit_of

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("torch", "transformers", "onnxruntime", "numpy")


def describe_run() -> dict[str, str]:
    """Returns commit and date. Called before a benchmark measures: the checkout may change meanwhile."""
    today = datetime.now(timezone.utc).date().isoformat()
    return {"commit": commit_of(ROOT) or "unknown", "date": today}


def describe_machine() -> dict[str, Any]:
    """Returns the CPU, its flags that matter to networks, the usable cores and the versions."""
    machine = this_machine()
    described: dict[str, Any] = {
        "cpu": machine.cpu,
        "cpu_flags": list(machine.flags),
        "architecture": machine.architecture,
        "cores": len(os.sched_getaffinity(0)),
        "python": platform.python_version(),
    }
    for package in PACKAGES:
        described[package] = _version(package)
    return described


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
