"""Sums up the runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from bench.bounds import told as told_bound
from bench.stopping.jobs import Run
from bench.stopping.scenes import SCENES

NEVER_STOPS = ("report", *SCENES)
"""Kinds without a stop to be measured."""
SILENCED = ("sigstop", "kill_9")
"""Kinds in which the companion itself is stopped, so that its heartbeat says nothing."""


def line(run: Run) -> str:
    """Formats one run as a line for a reader."""
    told = f"{run.kind:14} seed {run.seed:3}"
    if run.stop is not None:
        stop = run.stop
        told += (
            f"  {stop.speed:.1f} m/s in the {stop.zone:6}  {stop.seconds:5.2f} s of {stop.limit.seconds:.2f}"
            f"  {stop.metres:5.2f} m of {stop.limit.metres:.2f}  by {stop.by or 'nobody'}"
        )
        told += f"  ordered after {stop.hold:.2f} s" if stop.hold is not None else ""
        told += f"  well after {stop.returned:.2f} s" if stop.returned is not None else ""
    told += f"  {run.saw}" if run.saw else ""
    if run.disturbed:
        told += f"  (begun anew {run.disturbed} x)"
    return told + (f"  WRONG: {run.wrong}" if run.wrong else "")


def figures(runs: Sequence[Run]) -> dict[str, Any]:
    """Sums up the runs that had to stop. Seconds, metres: the worst; limits: the longest."""
    due = [run for run in runs if run.kind not in NEVER_STOPS]
    return {
        "runs": len(due),
        "stopped": sum(run.stop is not None and run.stop.stopped for run in due),
        **_worst(due),
        "limit_seconds": _most(run.stop.limit.seconds for run in due if run.stop is not None),
        "limit_metres": _most(run.stop.limit.metres for run in due if run.stop is not None),
        "worst_heartbeat_gap_s": _most(run.stop.gap for run in due if run.stop and run.kind not in SILENCED),
        "worst_hold_s": _most(run.stop.hold for run in due if run.stop and run.stop.hold is not None),
        "worst_return_s": _most(run.stop.returned for run in due if run.stop and run.stop.returned),
        "commanded_in_report_policy": sum(run.commanded for run in runs),
        "kinds": {kind: _of_kind(runs, kind) for kind in dict.fromkeys(run.kind for run in runs)},
    }


def good(runs: Sequence[Run]) -> bool:
    """Whether every run ended as it should."""
    return bool(runs) and not any(run.wrong or run.commanded for run in runs)


def _of_kind(runs: Sequence[Run], kind: str) -> dict[str, Any]:
    own = [run for run in runs if run.kind == kind]
    wrong = sum(bool(run.wrong) for run in own)
    counted = {"runs": len(own), "wrong": wrong, "fails_in": told_bound(len(own), wrong)}
    disturbed = sum(run.disturbed for run in own)
    told = {**counted, "begun_anew": disturbed} if disturbed else counted
    saw = Counter(run.saw for run in own if run.saw)
    told |= {"saw": dict(saw)} if saw else {}
    stops = [run.stop for run in own if run.stop is not None]
    returns = [stop.returned for stop in stops if stop.returned is not None]
    back = {"returns": len(returns), "worst_return": _most(returns)} if returns else {}
    holds = [stop.hold for stop in stops if stop.hold is not None]
    back |= {"worst_hold": _most(holds)} if holds else {}
    gap = _most(stop.gap for stop in stops)
    return (
        {**told, "worst_gap": gap, **back, **_worst(own), "by": dict(Counter(stop.by for stop in stops))}
        if stops
        else told
    )


def _worst(runs: Sequence[Run]) -> dict[str, float]:
    stops = [run.stop for run in runs if run.stop is not None]
    return {
        "worst_seconds": _most(stop.seconds for stop in stops),
        "worst_metres": _most(stop.metres for stop in stops),
    }


def _most(values: Any) -> float:
    return round(max(values, default=0.0), 2)
