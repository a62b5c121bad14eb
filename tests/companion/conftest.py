"""What the tests of the companion share."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import pytest

from bench.virtual_time import Clock, virtual_time


@pytest.fixture
def interned(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The texts that Python code interns from now on, as pathlib does with each part of a path."""
    found, intern = list[str](), sys.intern

    def record(text: str) -> str:
        found.append(text)
        return intern(text)

    monkeypatch.setattr(sys, "intern", record)
    return found


@pytest.fixture
def clock() -> Iterator[Clock]:
    """What `time.monotonic` says."""
    with virtual_time() as clock:
        yield clock
