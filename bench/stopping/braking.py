"""A scene in which something happens in one of the steps of a hold that brakes first."""

from __future__ import annotations

import time
from dataclasses import replace
from random import Random

from bench.stopping.humans import READ, SOON, watch
from bench.stopping.jobs import Job
from bench.stopping.scenes import Seen, StoppingScene, drives, follows, sees_again_in_hold, wait_for_mode
from bench.stopping.stage import Plan, Stage
from companion.sim.field.rover import STANDSTILL

STEPS = ("as it is asked for", "in the brake", "as HOLD is set")
FAULTS = ("a go", "MANUAL by hand", "somebody's target", "kill -9", "lost frames")
_LISTENS = 5.0
"""s after its start in which the script brakes for nothing: somebody may send targets."""
_UNDER_WAY = 0.15
"""s by which the request comes later where something happens as it is asked for."""
_LOST = 0.6
"""s in which frames are lost, by turns to the autopilot and from it."""
_SETTLES = 6.0
"""s after which the longest brake is over, and nothing may come any more."""


def _brakes(job: Job, random: Random) -> Plan:
    return replace(job.plan(random), brakes=True)


def _braking(stage: Stage, random: Random) -> Seen:
    """Freezes the camera, lets the script brake for that, and does something in one step of it."""
    seed = stage.plan.seed
    step, fault = STEPS[seed % len(STEPS)], FAULTS[seed // len(STEPS) % len(FAULTS)]
    watch(stage, _LISTENS)
    drives(stage, random)
    asked = len(stage.wire.commands)
    stage.wire.ordered_now = lambda _order, _at: _UNDER_WAY if step == STEPS[0] else 0.0
    stage.freeze_camera(on=True)
    stage.wait("a request", lambda: len(stage.wire.commands) > asked, SOON)
    if step != STEPS[0]:
        stage.wait("the brake", lambda: stage.status()["mode"] in ("GUIDED", "HOLD"), SOON)
    if step == STEPS[2]:
        stage.wait("its hold", lambda: stage.status()["mode"] == "HOLD", SOON)
    stage.wire.ordered_now = None
    with follows():
        wrong = _do(stage, fault, to_autopilot=seed % 2 == 0)
        modes = [one["mode"] for one in stage.status()["mode_log"]]
        # A request that is late or lost is carried out past the script, and a target forbids the brake.
        how = "braked" if "GUIDED" in modes else "did not brake"
        return Seen(wrong, saw=f"{fault}: {how}, {modes[-1]}")


def _do(stage: Stage, fault: str, *, to_autopilot: bool) -> str:
    """Returns what was wrong, "" for nothing."""
    if fault == "MANUAL by hand":
        stage.control.mode("MANUAL")
        watch(stage, 0.5)
        asked = len(stage.wire.commands)
        watch(stage, _SETTLES)
        late, mode = stage.wire.commands[asked:], stage.status()["mode"]
        return f"commanded {late}, then {mode}" if late or mode != "MANUAL" else ""
    if fault == "somebody's target":
        stage.ground.target()
        watch(stage, _SETTLES)
        stands = stage.status()
        return "" if abs(stands["speed"]) <= STANDSTILL else f"it drives in {stands['mode']}"
    if fault == "kill -9":
        stage.daemon.process.kill()
        until = time.monotonic() + _SETTLES
        while stage.status()["mode"] != "HOLD" and time.monotonic() < until:
            time.sleep(0.05)
        stage.start_daemon()
        stage.freeze_camera(on=False)
        stage.wait_until_well()
        return "" if stage.status()["mode"] == "HOLD" else f"{stage.status()['mode']} after the kill"
    if fault == "lost frames":
        stage.wire.mute, stage.wire.unheard = not to_autopilot, to_autopilot
        watch(stage, _LOST)
        stage.wire.mute = stage.wire.unheard = False
    else:
        stage.ground.go(int(stage.read_status().get("current_id") or 0))
    wait_for_mode(stage, "HOLD")
    watch(stage, _SETTLES)
    if stage.status()["mode"] != "HOLD":
        return f"{stage.status()['mode']} although nothing is seen"
    sees_again_in_hold(stage)
    watch(stage, READ)
    if stage.status()["mode"] == "HOLD":  # the first go may have come before its hold was told
        stage.ground.go(int(stage.read_status()["current_id"]))
    wait_for_mode(stage, "AUTO")
    return ""


BRAKING = StoppingScene(_brakes, _braking)
