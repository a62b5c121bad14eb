"""Waiting for the vision process to load, which may take a while, with a link that says so meanwhile."""

from __future__ import annotations

import select
import time
from collections.abc import Callable

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.errors import AnyTraverseError
from companion.link.inbound import (
    AnswerRequest,
    InboundEvent,
    ParameterRequest,
    PolicyRequest,
    ResetRequest,
    WordsRequest,
)
from companion.link.link import Link
from companion.vision.client import Vision
from companion.vision.messages import Ready
from companion.wire import notices
from companion.wire.answers import Acknowledgement
from companion.wire.ids import Outcome, Reasons, Result, Stage

_TICK = 0.02
_AGAIN = "starting, send it again"
_WARNING = 4


def load(vision: Vision, link: Link, stop: Callable[[], bool]) -> Ready | None:
    """What the vision process says once it is ready, while the link tells that we are starting.

    A process that dies is started again. None when `stop()` came first. Raises AnyTraverseError when the
    perceiver cannot be made.
    """
    while not stop():
        now = time.monotonic()
        for heard in link.poll(now):
            _put_off(heard, link, now)
        vision.poll(now)
        if vision.failed:
            raise AnyTraverseError(vision.failed)
        if vision.ready is not None:
            return vision.ready
        link.tick(now)
        wait(link, vision, _TICK)
    return None


def wait(link: Link, vision: Vision, seconds: float) -> None:
    """Until one of them has something to be heard, `seconds` at most."""
    descriptor = vision.fileno()
    try:
        select.select([*link.filenos(), *([] if descriptor is None else [descriptor])], [], [], seconds)
    except (OSError, ValueError):  # a device that has just gone
        time.sleep(seconds)


def _put_off(heard: InboundEvent, link: Link, now: float) -> None:
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
