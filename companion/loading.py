"""Loading the perceiver, which may take a while, with a link that says so meanwhile."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np

from anytraverse.errors import AnyTraverseError
from anytraverse.perception import Perceiver
from companion.link.heard import AnswerRequest
from companion.link.link import Link
from companion.wire.answers import Acknowledgement
from companion.wire.ids import Outcome, Reasons, Result, Stage

_WARM_UP = np.zeros((240, 320, 3), dtype=np.uint8)
_TICK = 0.05


def load_perceiver(make: Callable[[], Perceiver], link: Link, stop: Callable[[], bool]) -> Perceiver | None:
    """The perceiver, made and warmed up in a thread while the link tells that we are starting.

    None when `stop()` came first. Raises AnyTraverseError when it cannot be made.
    """
    loaded: list[Perceiver] = []
    failed: list[Exception] = []

    def load() -> None:
        try:
            perceiver = make()
            perceiver.embed(perceiver.encode(_WARM_UP))
            loaded.append(perceiver)
        except Exception as error:
            failed.append(error)

    thread = threading.Thread(target=load, name="loading", daemon=True)
    thread.start()
    while thread.is_alive() and not stop():
        now = time.monotonic()
        for heard in link.poll(now):
            if isinstance(heard, AnswerRequest):
                link.acknowledge(heard, _starting(heard), now)
        link.tick(now)
        thread.join(_TICK)
    if failed:
        if isinstance(failed[0], AnyTraverseError):
            raise failed[0]
        raise AnyTraverseError(f"the perceiver failed to load: {failed[0]!r}") from failed[0]
    return loaded[0] if loaded else None


def _starting(request: AnswerRequest) -> Acknowledgement:
    return Acknowledgement(
        transaction=request.transaction or 0,
        target=request.target,
        result=Result.BUSY,
        stage=Stage.CLOSED,
        outcome=Outcome.NONE,
        roi_uncertainty=None,
        worst_tile=None,
        reasons=Reasons.NONE,
        words=0,
        text="starting: send it again",
    )
