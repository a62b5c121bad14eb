"""Finds the processes that a program has started."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path


def children(pid: int) -> dict[int, list[str]]:
    """Return the processes that the threads of `pid` have started: process id -> its command line.

    One that has ended and was not waited for has an empty one.
    """
    found: dict[int, list[str]] = {}
    for thread in Path(f"/proc/{pid}/task").glob("*"):
        with suppress(OSError):  # a thread that has just ended
            for child in map(int, (thread / "children").read_text().split()):
                with suppress(OSError):
                    found[child] = Path(f"/proc/{child}/cmdline").read_bytes().decode().split("\0")
    return found


def child_of(pid: int, module: str) -> int:
    """Return the id of the process that `pid` has started to run this module, 0 without one."""
    return next((child for child, command in children(pid).items() if module in command), 0)
