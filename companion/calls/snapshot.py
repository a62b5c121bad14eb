"""Saves the open call and the hold for the journal, and restores them after a restart.

Times are not saved, since a monotonic clock starts again with each boot. A go and an acceptance are not saved
either: after a restart the operator must give them again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from anytraverse.assessment import Reason
from companion.calls.decisions import Call, CallState
from companion.calls.hold import Hold, HoldState
from companion.calls.machine import OperatorCalls
from companion.calls.mode_monitor import HeldMission
from companion.calls.reason_filter import CALLS_FOR_WORDS
from companion.vehicle.state import Mission, MissionState, read_place
from companion.wire.ids import Policy
from companion.wire.json_values import place_document

_U16 = 0xFFFF
_U32 = 0xFFFFFFFF


def snapshot(calls: OperatorCalls) -> dict[str, Any]:
    """Return the state as JSON values."""
    call, hold = calls.call, calls.hold
    return {
        "last_id": calls.last_id,
        "mode": calls.monitor.newest.mode,
        "call": call
        and {
            "id": call.id,
            "frame_id": call.frame_id,
            "reasons": sorted(reason.value for reason in call.reasons),
            # An acceptance is not saved, so a call that was answered by one is open again.
            "tried": call.state is CallState.NOT_COVERED,
            "answered": call.state is CallState.ANSWERED,
            "learnt": call.learnt,
            "quiet": call.quiet,
            "place": place_document(call.place),
        },
        "hold": hold
        and {
            "id": hold.id,
            "mode": hold.mode,
            "mode_before": hold.mode_before if hold.guided_out_of is None else hold.guided_out_of,
            "stage": hold.state.value,
            "only_fault": hold.only_fault,
            "commanded_as": hold.commanded_as,
            "mission": _mission_figures(hold.interrupted),
        },
    }


def restore(calls: OperatorCalls, saved: Mapping[str, Any], now: float) -> None:
    """Restore what `snapshot` saved. The hold is restored only under the hold policy.

    Raises KeyError, TypeError or ValueError where `saved` is something else; `calls` is then unchanged.
    """
    if not isinstance(saved, Mapping):
        raise TypeError("the saved calls are not a mapping")
    last_id = _whole(saved["last_id"], _U16)
    mode = None if saved["mode"] is None else _whole(saved["mode"], _U32)
    call = None if saved["call"] is None else _call(saved["call"], now)
    hold = None if saved["hold"] is None else _hold(saved["hold"], now)
    if call is not None and hold is not None and call.id != hold.id:
        raise ValueError(f"call {call.id} and hold {hold.id} cannot both be open")
    policy = calls.policy
    calls.restore(last_id, call if policy is not Policy.OFF else None, hold if policy.holds else None, mode)


def _call(saved: Any, now: float) -> Call:
    if not isinstance(saved["reasons"], list):
        raise TypeError("the reasons of a saved call are not a list")
    reasons = {Reason(value) for value in saved["reasons"]}
    if not reasons or not reasons <= CALLS_FOR_WORDS:
        raise ValueError(f"{saved['reasons']} are no reasons for a call")
    tried, answered = _flag(saved["tried"]), _flag(saved["answered"])
    return Call(
        id=_whole(saved["id"], _U16, 1),
        frame_id=_whole(saved["frame_id"], _U32),
        reasons=reasons,
        opened_at=now,
        seen=None,
        state=CallState.ANSWERED if answered else CallState.NOT_COVERED if tried else CallState.OPEN,
        learnt=_flag(saved["learnt"]),
        quiet=_flag(saved["quiet"]),
        place=read_place(saved.get("place")),
    )


def _hold(saved: Any, now: float) -> Hold:
    state = HoldState(saved["stage"])
    return Hold(
        id=_whole(saved["id"], _U16, 1),
        mode=_whole(saved["mode"], _U32),
        mode_before=_whole(saved["mode_before"], _U32),
        started_at=now,
        # The go is gone: what was on its way back holds again until there is a new one.
        state=HoldState.STANDING if state is HoldState.RESUMING else state,
        only_fault=_flag(saved["only_fault"]),
        commanded_as=_whole(saved.get("commanded_as", 0), _U16),
        interrupted=_mission(saved.get("mission")),
    )


def _mission_figures(held: HeldMission) -> dict[str, Any] | None:
    mission = held.before
    if mission is None:
        return None
    return {
        "item": mission.item,
        "total": mission.total,
        "id": mission.id,
        "settled": held.settled,
        "ended": held.ended,
    }


def _mission(saved: Any) -> HeldMission:
    if saved is None:
        return HeldMission()
    mission = Mission(
        item=_whole(saved["item"], _U16),
        total=None if saved["total"] is None else _whole(saved["total"], _U16),
        state=MissionState.UNKNOWN,
        id=_whole(saved["id"], _U32),
        at=-math.inf,
        fresh=False,
    )
    return HeldMission(mission, None, _flag(saved["settled"]), _flag(saved["ended"]))


def _whole(value: Any, highest: int, lowest: int = 0) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError(f"{value!r} is not a whole number")
    if not lowest <= value <= highest:
        raise ValueError(f"{value} is not in {lowest} to {highest}")
    return value


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise TypeError(f"{value!r} is neither true nor false")
    return value
