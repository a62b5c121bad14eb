"""Reports that the daemon dies, and holds a vehicle that would drive on with nobody watching the trail."""

from __future__ import annotations

import time

from companion.calls.hold import HoldState
from companion.calls.machine import OperatorCalls
from companion.link.link import Link
from companion.wire import notices
from companion.wire.ids import ALERT, Policy, State

_TICKS, _STEP = 15, 0.02


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
    drives = drives and known and calls.policy is Policy.HOLD
    if report.autopilot is not None and (drives or calls.holding.streams):
        link.modes.command(report.autopilot.rest_mode, now)
    link.set_state(State.FAULT, calls.current_id, calls.policy)
    link.texts.send(notices.dying(), ALERT, time.monotonic())
    # The link sends within its budgets, so that one tick does not send everything.
    for _ in range(_TICKS):
        link.tick(time.monotonic())
        time.sleep(_STEP)
