"""Runs the contestants in turn, frame by frame, so that other load on the machine affects all alike."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from types import TracebackType
from typing import TypeVar

from bench.clipseg.contestants import WARM_UP, ContestantPlan, Request, Sample, serve

Case = tuple[tuple[int, int], int]
"""Frame size and number of prompts."""
Samples = dict[tuple[str, tuple[int, int], int], list[Sample]]
"""Contestant, frame size, number of prompts -> one sample a round, in order."""

_Answer = TypeVar("_Answer")

LOADING = 300.0
STEPPING = 120.0
LEAVING = 5.0
"""Deadlines in seconds."""


class ContestantError(Exception):
    """Raised when a contestant failed, died or hung."""


class Running:
    """A contestant in a process of its own."""

    def __init__(self, plan: ContestantPlan) -> None:
        self.name = plan.name
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs, plan), name=plan.name, daemon=True)
        self._process.start()
        theirs.close()

    def __enter__(self) -> Running:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(OSError):  # it may have gone already
            self._connection.send(None)
        self._connection.close()
        self._process.join(LEAVING)
        if self._process.is_alive():
            self._process.kill()
            self._process.join(LEAVING)

    @property
    def alive(self) -> bool:
        return self._process.is_alive()

    def wait_ready(self, deadline: float = LOADING) -> None:
        """Waits until it is ready. Raises ContestantError when that takes more than `deadline` seconds."""
        self._receive(deadline)

    def step(self, request: Request, deadline: float = STEPPING) -> Sample:
        """Runs one step. Raises ContestantError when it fails, dies or hangs."""
        try:
            self._connection.send(request)
        except OSError:
            raise ContestantError(f"{self.name} has ended") from None
        answer = self._receive(deadline)
        if not isinstance(answer, Sample):
            raise ContestantError(str(answer))
        return answer

    def _receive(self, deadline: float) -> object:
        try:
            if not self._connection.poll(deadline):
                raise ContestantError(f"{self.name} has not answered for {deadline:g} s")
            answer = self._connection.recv()
        except (EOFError, OSError):
            raise ContestantError(f"{self.name} died: is there enough memory?") from None
        if isinstance(answer, str) and answer != "ready":
            raise ContestantError(answer)
        return answer


def measure(
    plans: Sequence[ContestantPlan], cases: Sequence[Case], rounds: int, say: Callable[[str], None]
) -> tuple[Samples, dict[str, str]]:
    """Measures every contestant; returns the samples, and the reasons why some have none.

    For each case it runs one step of each that does not count, then `rounds` times one step of each, in an
    order that rotates from round to round. A contestant that fails is left out from there on. Raises
    ContestantError when the first one fails.
    """
    samples: Samples = {}
    with ExitStack() as stack:
        entered = _Entered([stack.enter_context(Running(plan)) for plan in plans], say)
        entered.wait_ready()
        for size, count in cases:
            begun = time.monotonic()
            for turn in range(WARM_UP, WARM_UP + rounds + 1):
                for name in entered.order(turn):
                    sample = entered.step(name, Request(size, count, turn))
                    if sample is not None and turn != WARM_UP:
                        samples.setdefault((name, size, count), []).append(sample)
            say(f"{size[0]}x{size[1]}, {count} prompts: {time.monotonic() - begun:.0f} s")
    return {key: taken for key, taken in samples.items() if key[0] not in entered.failed}, entered.failed


class _Entered:
    """Keeps the contestants that still run, and why the others do not."""

    def __init__(self, contestants: Sequence[Running], say: Callable[[str], None]) -> None:
        self.failed: dict[str, str] = {}
        self._running = {contestant.name: contestant for contestant in contestants}
        self._indispensable = contestants[0].name
        self._say = say

    def order(self, turn: int) -> list[str]:
        names = list(self._running)
        shift = turn % len(names)
        return names[shift:] + names[:shift]

    def wait_ready(self) -> None:
        for name in self.order(0):
            self._attempt(name, Running.wait_ready)

    def step(self, name: str, request: Request) -> Sample | None:
        return self._attempt(name, partial(Running.step, request=request))

    def _attempt(self, name: str, act: Callable[[Running], _Answer]) -> _Answer | None:
        try:
            return act(self._running[name])
        except ContestantError as error:
            if name == self._indispensable:
                raise
            self.failed[name] = str(error)
            self._say(f"left out: {error}")
            del self._running[name]
            return None
