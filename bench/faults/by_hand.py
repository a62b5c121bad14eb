"""Rows in which a human sets a mode: over a hold for a fault, and in the moment of a resume."""

from __future__ import annotations

import time
from random import Random

from bench.faults.row import BACK_WITHIN, Row
from bench.faults.stages import (
    SOON,
    Seen,
    changed_by,
    drives,
    follows,
    repeated,
    wait_for_mode,
    watch,
    with_and_without_script,
)
from bench.stopping.humans import READ
from bench.stopping.runs import Job
from bench.stopping.stage import Stage

_TOLD_FOR = 1.5
"""s after the hold was confirmed in which the human reads it: the mode counts from 1 s on."""
_LASTS, _METRES = 20.0, 10.0
"""What a human's mode accepts of a fault: s and m, whichever comes first."""
_LATE_S, _LATE_M = 1.5, 3.0
"""Allowed beyond: positions come every 0.5 s, and the rover must stop."""
_AROUND = 0.06
"""s after the command to resume within which the human sets the mode."""
_SETTLES = 3.0


def _driven_on(stage: Stage, random: Random) -> Seen:
    """Freezes the camera, and lets a human drive on in AUTO over the hold."""
    drives(stage, random)
    stage.freeze_camera(on=True)
    with follows():
        wait_for_mode(stage, "HOLD")
        watch(stage, _TOLD_FOR)
        stage.control.mode("AUTO")
        begun, from_there = time.monotonic(), stage.status()["distance"]
        watch(stage, 2.0)
        if stage.status()["mode"] != "AUTO":
            return Seen(f"held again at once by {changed_by(stage)}")
        stage.wait("its hold", lambda: stage.status()["mode"] == "HOLD", _LASTS + SOON)
        seconds, by = time.monotonic() - begun, changed_by(stage)
        stage.wait("standstill", lambda: abs(stage.status()["speed"]) < 0.05, SOON)
        metres = stage.status()["distance"] - from_there
        stage.freeze_camera(on=False)
        free = time.monotonic()
        stage.wait_until_well()
        wrong = seconds > _LASTS + _LATE_S or metres > _METRES + _LATE_M
        told = f"after {seconds:.1f} s and {metres:.1f} m"
        return Seen(
            f"held {told}" if wrong else "",
            None,
            time.monotonic() - free,
            f"drives, and is held again by {by}",
        )


def _in_the_moment(stage: Stage, random: Random) -> Seen:
    """Sets MANUAL about when the command to resume arrives."""
    drives(stage, random)
    stage.freeze_camera(on=True)
    with follows():
        wait_for_mode(stage, "HOLD")
        stage.freeze_camera(on=False)
        stage.wait_until_well()
        watch(stage, READ)
        asked = len(stage.wire.commands)
        stage.ground.go(int(stage.read_status()["current_id"]))
        until = time.monotonic() + SOON
        while len(stage.wire.commands) == asked and time.monotonic() < until:
            time.sleep(0.001)
        time.sleep(random.uniform(0.0, _AROUND))
        stage.control.mode("MANUAL")
        watch(stage, _SETTLES)
        mode = stage.status()["mode"]
        script = "with the script" if stage.plan.script else "without it"
        held_again = not stage.plan.script and mode == "HOLD"
        wrong = "" if mode == "MANUAL" or held_again else f"{script}: MANUAL by hand, then {mode}"
        return Seen(wrong, saw=f"{script}: {'held again' if held_again else mode}")


ROWS = (
    Row(
        "driven on over a fault",
        "the camera is frozen; 1.5 s after its hold was confirmed a human sets AUTO",
        "drives on for 20 s or 10 m at most, whichever comes first; then it is held again",
        repeated(5, Job.plan, _driven_on),
        None,
        BACK_WITHIN,
    ),
    Row(
        "a human's mode in the moment of a resume",
        "a go; MANUAL is set up to 60 ms after the command to resume has left; by turns with and without the "
        "script",
        "the rover stays in MANUAL; without the script it may be held again",
        repeated(10, with_and_without_script, _in_the_moment),
    ),
)
