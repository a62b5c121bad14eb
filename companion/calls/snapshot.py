"""The state machine's share of the journal: what a restarted daemon must know of its open call and its hold.

Times do not survive: a monotonic clock starts anew. Neither do a go and an acceptance: after a restart they
must be given again.
"""

from __future__ import annotations

from typing import Any

from anytraverse.assessment import Reason
from companion.calls.decisions import Call
from companion.calls.hold import Hold, HoldStage
from companion.calls.machine import OperatorCalls


def snapshot(calls: OperatorCalls) -> dict[str, Any]:
    """The state as JSON values."""
    call, hold = calls.call, calls.hold
    return {
        "last_id": calls.last_id,
        "mode": calls.autopilot.mode,
        "call": call
        and {
            "id": call.id,
            "frame_id": call.frame_id,
            "reasons": sorted(reason.value for reason in call.reasons),
            "answered": call.answered,
            "accepted": call.accepted,
            "quiet": call.quiet,
        },
        "hold": hold
        and {
            "id": hold.id,
            "mode_before": hold.mode_before,
            "stage": hold.stage.value,
            "only_fault": hold.only_fault,
        },
    }


def restore(calls: OperatorCalls, saved: dict[str, Any], now: float) -> None:
    """Take up where `saved` ended. Raises KeyError, TypeError or ValueError for anything else."""
    last_id = int(saved["last_id"])
    call, hold = saved["call"], saved["hold"]
    restored_call = call and Call(
        id=int(call["id"]),
        frame_id=int(call["frame_id"]),
        reasons={Reason(value) for value in call["reasons"]},
        opened_at=now,
        seen=None,
        answered=bool(call["answered"]),
        accepted=bool(call["accepted"]),
        quiet=bool(call["quiet"]),
    )
    restored_hold = hold and Hold(
        id=int(hold["id"]),
        mode_before=int(hold["mode_before"]),
        started_at=now,
        stage=HoldStage(hold["stage"]),
        only_fault=bool(hold["only_fault"]),
    )
    calls.last_id = max(calls.last_id, last_id)
    calls.call = restored_call or None
    calls.hold = restored_hold or None
    if calls.hold is not None and calls.hold.stage is HoldStage.RESUMING:
        calls.hold.turn(HoldStage.STANDING)
