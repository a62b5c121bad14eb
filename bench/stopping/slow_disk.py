"""Slows down a companion's disk: a shim for fsync and fdatasync, which is compiled when it is needed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from bench.shim import compile_shim, preloading
from companion.system.atomic_write import write_atomically


class SlowDisk:
    """Slows down the processes that are started with `environment`; `delay` acts from their next write on."""

    def __init__(self, folder: Path) -> None:
        """Compiles the shim into `folder`. Raises RuntimeError if that fails."""
        self._library = compile_shim(Path(__file__).with_suffix(".c"), folder)
        self._seconds = folder / "slow_disk.seconds"

    @property
    def environment(self) -> Mapping[str, str]:
        """The variables to add to a process's environment."""
        return {**preloading(self._library), "SLOW_DISK": str(self._seconds)}

    def delay(self, seconds: float) -> None:
        """Makes every sync take so many seconds longer from now on; 0: no longer."""
        write_atomically(self._seconds, f"{seconds:g}\n".encode(), sync=False)
