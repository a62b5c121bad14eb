"""Tests that a human who takes over is left alone, whatever the companion is doing."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Mapping
from random import Random
from typing import Any

from bench.stopping.stage import Disturbed, Stage

SOON = 10.0
FAILED = 20.0
IN_FLIGHT = 0.3
"""Seconds in which a command may still arrive that was sent before the human's mode was received."""
WATCHED = 3.0
READ = 2.2
"""Seconds after an announcement from which an answer to it counts."""


def _mode(stage: Stage) -> Any:
    return stage.status()["mode"]


def _requested(stage: Stage, random: Random) -> str:
    """Brings the companion to command a hold that the autopilot does not receive."""
    stage.wire.deaf = True
    stage.freeze_camera(on=True)
    stage.wait("a hold that is asked for", lambda: bool(stage.wire.commands), SOON)
    watch(stage, random.uniform(0.0, 4.0))
    return random.choice(["MANUAL", "RTL"])


def _standing(stage: Stage, random: Random) -> str:
    """Brings the companion to hold: it sees again, but no go was given."""
    stage.freeze_camera(on=True)
    stage.wait("a hold", lambda: _mode(stage) == "HOLD", SOON)
    watch(stage, random.uniform(0.0, 2.0))
    stage.freeze_camera(on=False)
    stage.wait_until_well()
    return random.choice(["MANUAL", "AUTO", "GUIDED", "RTL"])


def _resuming(stage: Stage, random: Random) -> str:
    """Brings the companion, after a go, to command AUTO, which the autopilot does not receive."""
    _standing(stage, random)
    watch(stage, READ)
    stage.wire.deaf = True
    asked = len(stage.wire.commands)
    stage.ground.go(int(stage.read_status()["current_id"]))
    stage.wait("the way back", lambda: len(stage.wire.commands) > asked, SOON)
    watch(stage, random.uniform(0.0, 1.5))
    return random.choice(["MANUAL", "RTL"])


def _asleep(stage: Stage, random: Random) -> str:
    """Stops the companion's process; when it wakes, the first frames that it reads are old."""
    stage.daemon.process.send_signal(signal.SIGSTOP)
    watch(stage, random.uniform(1.5, 4.0))
    return random.choice(["MANUAL", "RTL"])


STATES: Mapping[str, Callable[[Stage, Random], str]] = {
    "requested": _requested,
    "standing": _standing,
    "resuming": _resuming,
    "asleep": _asleep,
}


def take_over(stage: Stage, state: str, random: Random) -> str:
    """Brings the companion to a state, takes over by hand, returns what it commanded then ("": nothing)."""
    mode = STATES[state](stage, random)
    if state == "standing" and _mode(stage) != "HOLD":
        raise Disturbed("it did not stand")
    stage.control.mode(mode)
    if state == "asleep":
        watch(stage, random.uniform(0.5, 1.5))
        asked = len(stage.wire.commands)
        stage.daemon.process.send_signal(signal.SIGCONT)
    else:
        watch(stage, IN_FLIGHT)
        asked = len(stage.wire.commands)
    stage.wire.deaf = False
    watch(stage, WATCHED)
    wrong = stage.wire.commands[asked:]
    if wrong or _mode(stage) != mode:
        return f"{state}, {mode} by hand: {', '.join(wrong) or _mode(stage)}"
    return ""


def watch(stage: Stage, seconds: float) -> None:
    """Lets time pass while companion and field run."""
    until = time.monotonic() + seconds
    stage.wait("time", lambda: time.monotonic() >= until, seconds + SOON)
