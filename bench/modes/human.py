"""Plays the human who sets a mode at a chosen moment round a command of the companion."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import closing

from bench.modes.judging import PRESSED, ModeTrial
from bench.stopping.ground import SecondPort
from bench.stopping.stage import Stage

EXPECTED = {"hold": 1.1, "resume": 0.9}
"""s from what causes the command until it leaves, before one was measured."""
MODES = {"hold": (4,), "resume": (10, 15)}


class Human:
    """Waits for the first command of the trial's kind on the wire, and sets the mode at the trial's moment.

    A moment after the command has left is exact. One before the command arrives, but after the wire's delay,
    is exact too: the wire keeps the command for longer. One before it leaves is predicted, from what the
    earlier commands took, and measured: `latency`.
    left_at: when the command left the companion. set_at: when the mode was set, both in monotonic s.
    """

    def __init__(self, stage: Stage, trial: ModeTrial, latency: float) -> None:
        self._stage, self._trial = stage, trial
        arrives = trial.moment == "arrives"
        self._lead = trial.offset + (stage.plan.delay if arrives else 0.0) + trial.kept
        self._latency = latency
        self._timer: threading.Timer | None = None
        self._failed: Exception | None = None
        self._done = threading.Event()
        self.caused_at = 0.0
        self.left_at: float | None = None
        self.set_at: float | None = None

    @property
    def predicts(self) -> bool:
        """Whether the moment lies before the command leaves."""
        return self._lead < 0.0

    def begin(self, cause: Callable[[], None]) -> None:
        """Watches the wire, and causes the command."""
        self._stage.wire.ordered_now = self._ordered
        self.caused_at = time.monotonic()
        cause()
        if self.predicts:
            self._act_at(self.caused_at + max(self._latency + self._lead, 0.0))

    def done(self) -> bool:
        """Whether the mode was set. Raises what went wrong."""
        if self._failed is not None:
            raise self._failed
        return self._done.is_set()

    def end(self) -> None:
        """Watches the wire no more."""
        self._stage.wire.ordered_now = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer.join(2.0)

    def _ordered(self, order: str, at: float) -> float:
        if self.left_at is not None or int(order.rsplit(" ", 1)[-1]) not in MODES[self._trial.command]:
            return 0.0
        self.left_at = at
        if not self.predicts:
            self._act_at(at + self._lead)
        return self._trial.kept

    def _act_at(self, moment: float) -> None:
        self._timer = threading.Timer(max(moment - time.monotonic(), 0.0), self._act)
        self._timer.daemon = True
        self._timer.start()

    def _act(self) -> None:
        try:
            if self._trial.mode in PRESSED:
                with closing(SecondPort(self._stage.gcs)) as ground:
                    ground.press(self._trial.mode)
                self.set_at = time.monotonic()
            else:
                self.set_at = time.monotonic()
                self._stage.hand.mode(self._trial.mode)
        except Exception as reason:
            self._failed = reason
        self._done.set()
