"""Rows of a mission that is complete: nothing may make the rover drive off again."""

from __future__ import annotations

from dataclasses import replace
from random import Random

from bench.faults.row import Row
from bench.faults.stages import SOON, Seen, follows, repeated, wait_for_mode, watch
from bench.stopping.humans import READ
from bench.stopping.runs import FAST, SLOW, Job
from bench.stopping.stage import Plan, Stage
from companion.sim.field.rover import STANDSTILL
from companion.wire.parameters import THR_SCENE

_ALWAYS_NEW, _NEVER_NEW = 1.0, -1.0
"""Thresholds of the scene: every place is new, or none is."""
_WATCHED = 5.0
"""s after the go in which the rover must stay where it is."""
_COMPLETE_WITHIN = 60.0


def _plan(job: Job, random: Random) -> Plan:
    return replace(job.plan(random), mission=random.uniform(6.0, 12.0))


def _calls(stage: Stage) -> int:
    """Makes the place a new one for as long as it takes to call. Returns the call's id."""
    stage.ground.set_parameter(THR_SCENE, _ALWAYS_NEW)
    stage.wait("a call", lambda: stage.read_status().get("state") == "calling", SOON)
    stage.ground.set_parameter(THR_SCENE, _NEVER_NEW)
    return int(stage.read_status()["current_id"])


def _complete(stage: Stage, random: Random) -> Seen:
    """Calls as the rover stands in AUTO after its mission, or as it still rolls there, and says go."""
    rolls = stage.plan.seed % 2 == 0
    stage.set_speed(random.uniform(1.0 if rolls else SLOW, FAST))
    stage.wait_until_well()
    stage.control.start()
    stage.wait("its end", lambda: bool(stage.status()["mission_complete"]), _COMPLETE_WITHIN)
    if not rolls:
        over = "a rover that stands after its mission"
        stage.wait(over, lambda: bool((stage.read_status().get("mission") or {}).get("over")), SOON)
    with follows():
        asked = len(stage.wire.commands)
        call = _calls(stage)
        if rolls:
            wait_for_mode(stage, "HOLD")
        stage.wait("standstill", lambda: abs(stage.status()["speed"]) <= STANDSTILL, SOON)
        watch(stage, READ)
        stood = stage.status()["distance"]
        stage.ground.go(call)
        watch(stage, _WATCHED)
        status, resumed = stage.status(), {one for one in stage.wire.commands[asked:] if one[-2:] != " 4"}
        wrong = f"commanded {resumed}" if resumed else ""
        if status["distance"] - stood > 0.1:
            wrong = f"it drove off: {status['distance'] - stood:.1f} m"
        if not rolls and len(stage.wire.commands) > asked:
            wrong = f"commanded {stage.wire.commands[asked:]}"
        saw = "held as it still rolled: the resume is refused" if rolls else "not held as it stands in AUTO"
        return Seen(wrong, saw=saw)


ROWS = (
    Row(
        "mission complete",
        "the mission ends, ArduPilot stays in AUTO and stands; a call there, or as it still rolls; a go",
        "nothing is held where it stands; no resume begins the mission anew; the rover stays where it is",
        repeated(10, _plan, _complete),
    ),
)
