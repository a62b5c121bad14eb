"""Waiting for what other threads and processes do."""

from __future__ import annotations

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
