"""Runs the link before the first turn, while vision loads, and after the last one, as the daemon dies."""

from __future__ import annotations

import select
import time
from collections.abc import Callable

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.errors import AnyTraverseError
from companion.calls.hold import HoldState
from companion.calls.machine import OperatorCalls
from companion.link.inbound import InboundEvent, ParameterRequest, PolicyRequest, ResetRequest
from companion.link.link import Link
from companion.system.service_manager import ServiceManager
from companion.vision.client import VisionClient
from companion.vision.messages import Ready
from companion.wire import notices
from companion.wire.answers import Acknowledgement, Answer, Via
from companion.wire.ids import ALERT, WARNING, Result, State

_TICK = 0.02
_AGAIN = "starting, send it again"
_TICKS, _STEP = 15, 0.02


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


def report_death(link: Link, calls: OperatorCalls) -> None:
    """Report at once that the daemon dies, to the autopilot's script and to the operator.

    Under the hold policy a vehicle that drives by itself, or was told to drive on, is held. A mode that waits
    to be sent is dropped: it may be a resume.
    """
    link.modes.cancel()
    now, report, vehicle = time.monotonic(), calls.monitor.newest, link.vehicle
    # The error may have kept a report from the state machine: a human may have taken over.
    current = vehicle is not None and (vehicle.custom_mode, vehicle.armed) == (report.mode, report.armed)
    hold, known = calls.hold, current and calls.monitor.known(now)
    drives = report.drives_itself or (hold is not None and hold.state is HoldState.RESUMING)
    drives = drives and known and calls.policy.holds
    if report.autopilot is not None and (drives or calls.holding.streams):
        link.modes.command(report.autopilot.rest_mode, now)
    link.set_state(State.FAULT, calls.current_id, calls.policy)
    link.texts.send(notices.dying(), ALERT, time.monotonic())
    # The link sends within its budgets, so that one tick does not send everything.
    for _ in range(_TICKS):
        link.tick(time.monotonic())
        time.sleep(_STEP)
