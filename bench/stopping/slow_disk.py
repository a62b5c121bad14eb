"""Slows down a companion's disk: a shim for fsync and fdatasync, which is compiled when it is needed."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping
from pathlib import Path

_SOURCE = Path(__file__).with_suffix(".c")


class SlowDisk:
    """Slows down the processes that are started with `environment`; `delay` acts from their next write on."""

    def __init__(self, folder: Path) -> None:
        """Compiles the shim into `folder` with the compiler `cc`. Raises RuntimeError if that fails."""
        self._library = folder / "slow_disk.so"
        self._seconds = folder / "slow_disk.seconds"
        command = ["cc", "-shared", "-fPIC", "-O1", "-o", str(self._library), str(_SOURCE), "-ldl"]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise RuntimeError(f"no slow disk without a C compiler ({error}): install gcc, as cc") from error
        if done.returncode:
            raise RuntimeError(f"{_SOURCE.name} does not compile: {done.stderr.strip()}")

    @property
    def environment(self) -> Mapping[str, str]:
        """The variables to add to a process's environment."""
        others = os.environ.get("LD_PRELOAD", "")
        preloaded = f"{self._library} {others}".strip()
        return {"LD_PRELOAD": preloaded, "SLOW_DISK": str(self._seconds)}

    def delay(self, seconds: float) -> None:
        """Makes every sync take so many seconds longer from now on; 0: no longer."""
        part = self._seconds.with_suffix(".part")
        part.write_text(f"{seconds:g}\n", encoding="ascii")
        part.replace(self._seconds)
