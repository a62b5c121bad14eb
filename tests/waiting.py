"""Waiting for what other threads and processes do, and pipes that make them wait."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

Found = TypeVar("Found")


def wait_for(
    what: Callable[[], Found | None],
    seconds: float = 30.0,
    why: Callable[[], object] = str,
    turn: Callable[[], object] = lambda: time.sleep(0.01),
) -> Found:
    """What it is, once it is. why: said where it never comes. turn: what is done between two looks."""
    deadline = time.monotonic() + seconds
    while not (found := what()):
        assert time.monotonic() < deadline, f"not within {seconds:g} s {why()}"
        turn()
    return found


def is_gone(pid: int) -> bool:
    """Whether the process has ended, reaped or not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in ("Z", "X")
    except OSError:
        return True


def fill(descriptor: int) -> int:
    """Fill a pipe, so that the next write to it blocks. Return the bytes that are in it."""
    os.set_blocking(descriptor, False)
    filled = 0
    try:
        while True:
            filled += os.write(descriptor, b"x" * 4096)
    except BlockingIOError:
        pass
    try:
        while True:
            filled += os.write(descriptor, b"x")
    except BlockingIOError:
        os.set_blocking(descriptor, True)
    return filled
