"""Waits until the vision process has loaded, and meanwhile runs the link, which reports the start."""

from __future__ import annotations

import select
import time
from collections.abc import Callable

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.errors import AnyTraverseError
from companion.link.inbound import (
    InboundEvent,
    ParameterRequest,
    PolicyRequest,
    ResetRequest,
)
from companion.link.link import Link
from companion.system.service_manager import ServiceManager
from companion.vision.client import VisionClient
from companion.vision.messages import Ready
from companion.wire import notices
from companion.wire.answers import Acknowledgement, Answer, Via
from companion.wire.ids import WARNING, Result

_TICK = 0.02
_AGAIN = "starting, send it again"


def load(
    vision: VisionClient,
    link: Link,
    stop: Callable[[], bool],
    service: ServiceManager,
    turned: Callable[[float], None] = lambda _now: None,
) -> Ready | None:
    """Wait for the vision process's `Ready`, and run the link meanwhile. None when `stop()` came first.

    turned: called in every turn, with monotonic seconds. A process that dies is started again. Raises
    AnyTraverseError when the perceiver cannot be loaded.
    """
    while not stop():
        now = time.monotonic()
        service.starting(now)
        turned(now)
        for event in link.poll(now):
            _refuse(event, link, now)
        vision.poll(now)
        if vision.failed:
            raise AnyTraverseError(vision.failed)
        if vision.ready is not None:
            return vision.ready
        link.tick(now)
        wait(link, vision, _TICK)
    return None


def wait(link: Link, vision: VisionClient, seconds: float) -> None:
    """Wait until link or vision has data to read, `seconds` at most."""
    descriptor = vision.fileno()
    try:
        select.select([*link.filenos(), *([] if descriptor is None else [descriptor])], [], [], seconds)
    except (OSError, ValueError):  # a device was just unplugged or closed
        time.sleep(seconds)


def _refuse(event: InboundEvent, link: Link, now: float) -> None:
    """Refuse a request, with the text to send it again."""
    match event:
        case Answer():
            busy = Acknowledgement.without_figures(event.transaction, event.target, Result.BUSY, _AGAIN)
            link.answers.acknowledge(event, busy, now)
            if event.via is not Via.TEXT:  # whose acknowledgement has no text
                return
        case PolicyRequest() | ResetRequest():
            link.commands.acknowledge(event, mavlink.MAV_RESULT_TEMPORARILY_REJECTED, now)
        case ParameterRequest():
            link.parameters.echo_in_force(event.name, now)
        case _:
            return
    link.texts.send(notices.refused(_AGAIN), WARNING, now)
