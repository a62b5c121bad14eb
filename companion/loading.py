"""Loading, which may take a while, with a link that says so meanwhile."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TypeVar

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.errors import AnyTraverseError
from companion.link.heard import (
    AnswerRequest,
    Heard,
    ParameterRequest,
    PolicyRequest,
    ResetRequest,
    WordsRequest,
)
from companion.link.link import Link
from companion.wire import notices
from companion.wire.answers import Acknowledgement
from companion.wire.ids import Outcome, Reasons, Result, Stage

Loaded = TypeVar("Loaded")

_TICK = 0.05
_AGAIN = "starting, send it again"
_WARNING = 4


def load(make: Callable[[], Loaded], link: Link, stop: Callable[[], bool]) -> Loaded | None:
    """What `make` makes in a thread, while the link tells that we are starting.

    None when `stop()` came first. Raises AnyTraverseError when it cannot be made.
    """
    loaded: list[Loaded] = []
    failed: list[Exception] = []

    def run() -> None:
        try:
            loaded.append(make())
        except Exception as error:
            failed.append(error)

    thread = threading.Thread(target=run, name="loading", daemon=True)
    thread.start()
    while thread.is_alive() and not stop():
        now = time.monotonic()
        for heard in link.poll(now):
            _put_off(heard, link, now)
        link.tick(now)
        thread.join(_TICK)
    if failed:
        raise _told(failed[0]) from failed[0]
    return loaded[0] if loaded else None


def _told(error: Exception) -> AnyTraverseError:
    if isinstance(error, AnyTraverseError):
        return error
    if isinstance(error, MemoryError):
        return AnyTraverseError(
            "the perceiver does not fit into memory: stop other programs, "
            "or take an int8 bundle or one of a smaller --size"
        )
    return AnyTraverseError(f"the perceiver failed to load: {error!r}")


def _put_off(heard: Heard, link: Link, now: float) -> None:
    """Whoever wants something is told to ask again."""
    match heard:
        case AnswerRequest():
            link.acknowledge(heard, _starting(heard), now)
            return
        case PolicyRequest() | ResetRequest():
            link.acknowledge_command(heard, mavlink.MAV_RESULT_TEMPORARILY_REJECTED, now)
        case WordsRequest():
            link.acknowledge_words(heard, now, accepted=False)
        case ParameterRequest():
            link.keep_parameter(heard.name, now)
        case _:
            return
    link.say(notices.refused(_AGAIN), _WARNING, now)


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
        text=_AGAIN,
    )
