"""Measures process CPU time by named part of a step."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

_Given = ParamSpec("_Given")
_Made = TypeVar("_Made")


class Parts:
    """Adds up the CPU seconds of this process spent in each part, until `take` empties it.

    The time of a part within another part counts only for the inner one.
    """

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}
        self._within: list[float] = []

    @contextmanager
    def time(self, name: str) -> Iterator[None]:
        self._within.append(0.0)
        begun = time.process_time()
        try:
            yield
        finally:
            whole = time.process_time() - begun
            self._seconds[name] = self._seconds.get(name, 0.0) + whole - self._within.pop()
            if self._within:
                self._within[-1] += whole

    def timed(self, name: str, act: Callable[_Given, _Made]) -> Callable[_Given, _Made]:
        """Wraps `act` so that each of its calls counts as this part."""

        def wrapped(*args: _Given.args, **kwargs: _Given.kwargs) -> _Made:
            with self.time(name):
                return act(*args, **kwargs)

        return wrapped

    def take(self) -> dict[str, float]:
        """Returns CPU seconds by part since the last call."""
        taken, self._seconds = self._seconds, {}
        return taken
