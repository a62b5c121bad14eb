"""Plays trials, one after another on a stage, for one setting."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from random import Random

from bench.modes.human import EXPECTED, Human
from bench.modes.judging import (
    DRIVING,
    STATION,
    ModeOutcome,
    ModeSetting,
    ModeTrial,
    drove,
    since_human,
)
from bench.stopping.stage import Disturbed, Plan, Stage
from companion.sim.field.trail import Trail

SPEED = 0.6
SOON = 10.0
EARLY, LATE = -0.2, 0.2
WATCHED = 2.6
"""s beside the round trip in which modes are watched: a command is tried again after one."""
ENDS_WITHIN = 6.0
SETTLED = 0.3
TAKEN_OVER = ": taken over"
TRIES_HERE, TRIES = 4, 12
"""Void trials in a row after which a stage, and a setting, is given up."""
HUMANS = "MANUAL", "LOITER", "STEERING", "RTL"
IN_BRAKE, AT_ITS_END = (LATE, 0.9), (0.9, 1.4)
"""s after the request arrives: at 0.6 m/s the brake takes 1.1 s, until HOLD."""


def draw(random: Random, setting: ModeSetting) -> ModeTrial:
    """Draws a trial. HOLD inside our HOLD is pressed only where the script runs, which alone sees it."""
    if setting.brakes:
        early, late = random.choice([(EARLY, LATE), IN_BRAKE, AT_ITS_END])
        offset = random.uniform(early, late)
        kept = max(-setting.delay - offset, 0.0)
        mode = random.choice([*HUMANS, "GUIDED"])
        return ModeTrial("hold", mode, "arrives", round(offset, 3), round(kept, 3))
    command = random.choice(["hold", "resume"])
    modes = (*HUMANS, "HOLD") if command == "resume" and setting.script else HUMANS
    moment, offset = random.choice(["leaves", "arrives"]), random.uniform(EARLY, LATE)
    kept = max(-setting.delay - offset, 0.0) if moment == "arrives" else 0.0
    return ModeTrial(command, random.choice(modes), moment, round(offset, 3), round(kept, 3))


def play_all(
    setting: ModeSetting, number: int, seed: int, out: Path, cancelled: threading.Event
) -> Iterator[ModeOutcome | str]:
    """Plays so many trials; yields each outcome, or why a trial was void.

    Raises Disturbed after `TRIES` void ones in a row.
    """
    randoms = [Random(f"{seed} {setting} {trial}") for trial in range(number)]
    trials = [draw(random, setting) for random in randoms]
    latencies = {kind: seconds + 2 * setting.delay * (kind == "resume") for kind, seconds in EXPECTED.items()}
    stages = void = 0
    while trials and void < TRIES:
        stages, here = stages + 1, 0
        at = Random(f"{seed} {setting} {stages}").uniform(0.0, Trail(seed).length)
        plan = Plan(
            seed,
            at,
            SPEED,
            script=setting.script,
            delay=setting.delay,
            breakable=True,
            brakes=setting.brakes,
        )
        with Stage(out / str(stages), plan, cancelled) as stage:
            stage.break_perceiver("same")  # the frames are not what is measured
            while trials and here < TRIES_HERE:
                found = _play_or_why(stage, setting, trials[0], latencies)
                yield found
                if isinstance(found, str):
                    here, void = here + 1, void + 1
                else:
                    trials, here, void = trials[1:], 0, 0
    if trials:
        raise Disturbed(f"{void} void trials in a row: {setting}")


def _play_or_why(
    stage: Stage, setting: ModeSetting, trial: ModeTrial, latencies: dict[str, float]
) -> ModeOutcome | str:
    try:
        return play(stage, setting, trial, latencies)
    except Disturbed as why:
        return str(why)


def play(stage: Stage, setting: ModeSetting, trial: ModeTrial, latencies: dict[str, float]) -> ModeOutcome:
    """Plays one trial. latencies: s from the cause of each command until it leaves; it updates them."""
    stage.freeze_camera(on=False)
    stage.control.mode("MANUAL")
    stage.wait_until_well()
    if stage.read_status().get("hold_refused"):
        raise Disturbed("it may not hold: the computer is too slow")
    stage.drive(SETTLED)
    begun, earlier = stage.status()["t"], stage.log.count(TAKEN_OVER)
    human = Human(stage, trial, latencies[trial.command])
    if trial.command == "resume":
        stage.freeze_camera(on=True)
        stage.wait("a hold", lambda: bool(stage.status()["mode"] == "HOLD"), SOON)
        stage.freeze_camera(on=False)
        stage.wait_until_well()
        _pass(stage, SETTLED)
        number = int(stage.read_status()["current_id"])
        cause = lambda: stage.ground.go(number)  # noqa: E731
    else:
        cause = lambda: stage.freeze_camera(on=True)  # noqa: E731
    try:
        human.begin(cause)
        stage.wait("the human", human.done, SOON)
        _pass(stage, 2 * setting.delay + trial.kept + WATCHED)
        if stage.status()["mode"] in DRIVING:
            _wait_for_end(stage)
        return _judged(stage, setting, trial, human, begun, earlier)
    finally:
        human.end()
        if human.left_at is not None:
            taken = human.left_at - human.caused_at
            latencies[trial.command] = 0.7 * latencies[trial.command] + 0.3 * taken


def _judged(
    stage: Stage, setting: ModeSetting, trial: ModeTrial, human: Human, begun: float, earlier: int
) -> ModeOutcome:
    """earlier: how often the companion had logged before the trial that a human took over."""
    status = stage.status()
    assert human.set_at is not None
    log = status["mode_log"]
    after = since_human(log, trial.mode, begun)
    if after is None:
        raise Disturbed(f"{trial.mode} was not set: {log[-3:]}")
    ours = [row["mode"] for row in log[: len(log) - len(after)] if row["by"] != STATION]
    inside = [mode for mode in ours if mode != trial.mode or trial.mode == "GUIDED"][-1]
    # Out of GUIDED it is held anew, as out of AUTO, while a fault stands that was told for less than 1 s.
    again = trial.mode == "GUIDED" and bool(after) and stage.log.count(TAKEN_OVER) > earlier
    longest, ended = drove(after, status["t"])
    measured = None if human.left_at is None else round(human.set_at - human.left_at, 3)
    changes = tuple(f"{row['mode']} by {row['by']}" for row in after)
    return ModeOutcome(
        setting, trial, measured, changes, longest, ended, inside if setting.brakes else "", again
    )


def _wait_for_end(stage: Stage) -> None:
    until = time.monotonic() + ENDS_WITHIN
    stage.wait(
        "the end of an override",
        lambda: stage.status()["mode"] not in DRIVING or time.monotonic() >= until,
        ENDS_WITHIN + SOON,
    )


def _pass(stage: Stage, seconds: float) -> None:
    until = time.monotonic() + seconds
    stage.wait("time", lambda: time.monotonic() >= until, seconds + SOON)
