"""Scenes in which a human acts round a hold: drives on over it, sets a mode as it resumes, says go in vain.

A scene is a kind of its own of this bench, and a row of the fault table.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from random import Random
from typing import NamedTuple

from bench.stopping.humans import READ, SOON, watch
from bench.stopping.jobs import FAST, SLOW, Job
from bench.stopping.serial_device import FAR_BUFFER, SerialDevice
from bench.stopping.stage import Disturbed, Plan, Stage
from companion.link.streams import STUCK
from companion.sim.field.rover import STANDSTILL
from companion.wire.parameters import THR_SCENE

ALWAYS_NEW, NEVER_NEW = 1.0, -1.0
"""Thresholds of the scene: every place is new, or none is."""
_TOLD_FOR = 1.5
"""s after the hold was confirmed in which the human reads it: the mode counts from 1 s on."""
_LASTS, _METRES = 20.0, 10.0
"""What a human's mode accepts of a fault: s and m, whichever comes first."""
_LATE_S, _LATE_M = 1.0, 2.0
"""Allowed beyond, until HOLD is set: positions come every 0.5 s, in which the rover drives 1 m."""
_AROUND = 0.06
"""s after the command to resume within which the human sets the mode."""
_SETTLES = 3.0
_FULL_AFTER = 0.1
"""s after which a stuck device takes nothing. The go follows at once: 1 s later the port is opened anew."""
_KEPT = (0.3, 1.6)
"""s after the go when the human sets the mode: the way back is in the kernel, for less than 1 s or longer."""
_WATCHED = 5.0
"""s after the go in which the rover must stay where it is."""
_COMPLETE_WITHIN = 60.0


class Seen(NamedTuple):
    """What one run showed, as in `RowOutcome`. wrong: "" for nothing."""

    wrong: str = ""
    hold_s: float | None = None
    return_s: float | None = None
    saw: str = ""


class _Missing(Exception):  # noqa: N818 - it is caught here
    """Raised when what must follow a fault did not."""


class StoppingScene(NamedTuple):
    """What is done on one stage. plan: how that is set up. play: what is done on it.

    What must follow is awaited in `follows`.
    """

    plan: Callable[[Job, Random], Plan]
    play: Callable[[Stage, Random], Seen]

    def seen(self, job: Job, random: Random) -> Seen:
        """Plays it on a stage of its own. Raises Disturbed where that comes before what must follow."""
        with job.stage(self.plan(job, random)) as stage:
            try:
                return self.play(stage, random)
            except _Missing as missing:
                return Seen(str(missing))


def with_and_without_script(job: Job, random: Random) -> Plan:
    """Plans a stage whose autopilot runs the script by turns."""
    return replace(job.plan(random), script=job.seed % 2 == 0)


def drives(stage: Stage, random: Random) -> None:
    """Brings the rover to drive at a speed by chance, and lets it drive for up to a second."""
    stage.set_speed(random.uniform(SLOW, FAST))
    stage.wait_until_well()
    stage.drive(random.uniform(0.0, 1.0))


@contextmanager
def follows() -> Iterator[None]:
    """Makes a run wrong, not void, where something does not happen that is awaited in this block."""
    try:
        yield
    except Disturbed as missing:
        raise _Missing(str(missing)) from missing


def wait_for_mode(stage: Stage, mode: str) -> None:
    """Waits until the autopilot is in this mode."""
    stage.wait(f"mode {mode}", lambda: bool(stage.status()["mode"] == mode), SOON)


def sees_again_in_hold(stage: Stage) -> None:
    """Waits for the hold of a frozen camera, and frees the camera: the companion is well again, and holds."""
    wait_for_mode(stage, "HOLD")
    stage.freeze_camera(on=False)
    stage.wait_until_well()


def changed_by(stage: Stage) -> str:
    """Returns who changed the mode last."""
    return str(stage.status()["mode_log"][-1]["by"])


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
        metres = stage.status()["distance"] - from_there
        stage.wait("standstill", lambda: abs(stage.status()["speed"]) < 0.05, SOON)
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
        sees_again_in_hold(stage)
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


def _ends(job: Job, random: Random) -> Plan:
    return replace(job.plan(random), mission=random.uniform(6.0, 12.0))


def _call(stage: Stage) -> int:
    """Makes the place a new one for as long as it takes to call. Returns the call's id."""
    stage.ground.set_parameter(THR_SCENE, ALWAYS_NEW)
    stage.wait("a call", lambda: stage.read_status().get("state") == "calling", SOON)
    stage.ground.set_parameter(THR_SCENE, NEVER_NEW)
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
        call = _call(stage)
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


def _stuck(stage: Stage, random: Random) -> Seen:
    """Stops a serial device as a go is carried out: its kernel keeps the way back; then it takes nothing."""
    assert stage.serial is not None
    seen = _held_up(stage, stage.serial, random, full=False)
    return seen if seen.wrong else _held_up(stage, stage.serial, random, full=True)


def _held_up(stage: Stage, serial: SerialDevice, random: Random, *, full: bool) -> Seen:
    """Lets a human take over before the device takes bytes again; then nothing may drive it on."""
    drives(stage, random)
    stage.freeze_camera(on=True)
    with follows():
        sees_again_in_hold(stage)
        watch(stage, READ)
        serial.full, serial.stuck, asked = full, True, len(stage.wire.commands)
        stage.wait("its buffer", lambda: serial.filled >= FAR_BUFFER, SOON)
        watch(stage, _FULL_AFTER)
        stage.ground.go(int(stage.read_status()["current_id"]))
        if full:
            stage.wait("the device's trouble", lambda: STUCK in stage.log, SOON)
        else:
            watch(stage, random.uniform(*_KEPT))
        earlier = stage.log.count("taken over")
        stage.control.mode("MANUAL")
        stage.wait("the taking over", lambda: stage.log.count("taken over") > earlier, SOON)
        watch(stage, 1.0)
        serial.stuck, free = False, time.monotonic()
        stage.wait_until_well()
        returned = time.monotonic() - free
        watch(stage, _SETTLES)
        late, mode = stage.wire.commands[asked:], stage.status()["mode"]
        wrong = f"commanded {late} when it took bytes again, then {mode}" if late or mode != "MANUAL" else ""
        return Seen(wrong, None, returned, f'log: "{STUCK}"; the way back that was under way never left')


def _on_serial(job: Job, random: Random) -> Plan:
    return replace(with_and_without_script(job, random), serial=True)


SCENES: Mapping[str, StoppingScene] = {
    "driven_on": StoppingScene(Job.plan, _driven_on),
    "mode_at_resume": StoppingScene(with_and_without_script, _in_the_moment),
    "mission_complete": StoppingScene(_ends, _complete),
    "serial_stuck": StoppingScene(_on_serial, _stuck),
}
