"""Waiting for what other threads and processes do, and pipes that make them wait."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import TypeVar

Found = TypeVar("Found")


def wait_for(what: Callable[[], Found | None], seconds: float = 30.0, why: Callable[[], str] = str) -> Found:
    """What it is, once it is. why: said where it never comes."""
    deadline = time.monotonic() + seconds
    while not (found := what()):
        assert time.monotonic() < deadline, f"not within {seconds:g} s {why()}"
        time.sleep(0.01)
    return found


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
