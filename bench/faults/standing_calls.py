"""Steps with a call of a standing rover, which several rows of the fault table take."""

from __future__ import annotations

import time

from bench.faults.standing import Standing
from bench.faults.standing_wire import AUTO, HOLD
from companion.wire.ids import Motion, Result, State

APPLIED = (Result.APPLIED, Result.NOT_COVERED)
"""Results of an answer that counts and is on disk."""


def held_call(rover: Standing) -> int:
    """Let the rover be held before an unknown thing, and return the call's id."""
    call = rover.open_call()
    rover.wait("the hold", lambda: rover.wire.mode == HOLD, 5.0)
    return call.id


def still_open(rover: Standing, call: int, when: str, wrong: list[str]) -> None:
    """Check that the call is open and the rover held, by heartbeat and autopilot."""
    beat = rover.client.rovers[1]
    if beat.current_id != call or beat.state not in (State.CALLING, State.HOLDING) or rover.wire.mode != HOLD:
        wrong.append(f"{when}: state {beat.state}, call {beat.current_id}, mode {rover.wire.mode}")


def comes_back(rover: Standing, call: int, began: float) -> float:
    """Wait until the companion says again that this call is open; return s since `began`."""
    beats = rover.client.rovers[1]

    def same() -> bool:
        return beats.silence(time.monotonic()) < time.monotonic() - began and beats.current_id == call

    rover.wait("the same call", same, 30.0)
    return time.monotonic() - began


def drive_on(rover: Standing, call: int, wrong: list[str]) -> None:
    """Take the thing away and give go, again while the companion has not heard the autopilot's mode yet."""
    rover.thing = False
    until = time.monotonic() + 10.0
    while rover.wire.mode != AUTO and time.monotonic() < until:
        given = rover.answer(call, Motion.GO)
        if given.result not in APPLIED:
            wrong.append(f"go was acknowledged as {given.result.name}: {given.text}")
            return
        if "no go" in given.text:
            rover.run(0.5)
        else:
            rover.wait("the way back", lambda: rover.wire.mode == AUTO, 10.0)
    if rover.wire.mode != AUTO:
        wrong.append(f"it did not drive on: {given.text}")
