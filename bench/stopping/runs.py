"""Does the runs for one seed, group by group; each group sets up its own stage."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from random import Random

from bench.stopping.disturbances import PRESSURES, Pressure
from bench.stopping.faults import BREAKABLE, CAMERA, FAINT, GUIDING, SILENCE, InjectedFault
from bench.stopping.humans import STATES, take_over, watch
from bench.stopping.jobs import FAST, SLOW, TRIES, Job, Run, retried, verdict
from bench.stopping.limits import Limit, script_timeout
from bench.stopping.scenes import SCENES, StoppingScene
from bench.stopping.stage import BEYOND, LOOK, Disturbed, Plan, Stage
from bench.stopping.stops import Stop, stopped
from companion.sim.field.onboard import BY_SCRIPT, COMPANION
from companion.sim.field.rover import STANDSTILL
from companion.sim.field.things import World
from companion.sim.field.trail import LOOP
from companion.wire.ids import Policy, State

RUSH = 5.0
"""m/s of the rover in policy report, in which nothing may hold it."""
LAP_WITHIN = 60.0
WIDE = 2.4
"""m of half the path where a drum on it is driven round."""
RUN_UP = 14.0, 18.0
"""m from the rover to the drum at the start."""
GUIDES_WITHIN, JUST = 20.0, 0.3
"""s within which it guides, and from there to the fault."""
GUIDED_METRES = 3.0
"""m within which a rover that is guided must stand."""
HEALTHY = 4.0
"""Seconds of a disturbance in which nobody may hold the rover."""


def blind(job: Job) -> Iterator[Run]:
    """Runs the faults of the camera, with the companion as it ships."""
    yield from faults(job, CAMERA, job.random("blind"), breakable=False)


def dead(job: Job) -> Iterator[Run]:
    """Runs the faults that silence the companion as it ships; it is killed last."""
    yield from faults(job, SILENCE, job.random("dead"), breakable=False)


def broken(job: Job) -> Iterator[Run]:
    """Runs the faults of a companion whose perceiver breaks."""
    named = {**BREAKABLE, **FAINT} if job.seed % 2 else BREAKABLE
    yield from faults(job, named, job.random("broken"), breakable=True)


def faults(job: Job, named: Mapping[str, InjectedFault], random: Random, *, breakable: bool) -> Iterator[Run]:
    """Causes each fault once, in a random order, on as few stages as possible."""
    kinds = sorted(named, key=lambda _: random.random())
    disturbed = 0
    while kinds:
        plan = replace(job.plan(random), breakable=breakable)
        try:
            with job.stage(plan) as stage:
                while kinds:
                    stop = one_fault(stage, named[kinds[0]], random)
                    kind = kinds.pop(0)
                    yield Run(kind, job.seed, verdict(stop), stop, 0, disturbed)
                    disturbed = 0
                    if named[kind].alone or (kinds and named[kinds[0]].alone):
                        break
        except Disturbed as why:
            disturbed += 1
            if disturbed == TRIES:
                yield Run(kinds.pop(0), job.seed, str(why), disturbed=disturbed)
                disturbed = 0


def one_fault(stage: Stage, fault: InjectedFault, random: Random) -> Stop:
    """Causes a fault while the rover drives, ends it, and waits until the companion is well again."""
    stage.set_speed(random.uniform(SLOW, FAST))
    stage.wait_until_well()
    stage.drive(random.uniform(0.0, 1.5))
    begun = time.monotonic()
    stop = stage.measure(lambda: fault.begin(stage), fault.noticed, silences=fault.silences)
    returned = stage.returned(begun) if fault.returns else None
    ended = time.monotonic()
    fault.end(stage)
    returned = returned if fault.returns else stage.returned(ended)
    return replace(stop, returned=returned, stands=stop.stands and stage.status()["mode"] == "HOLD")


def backwards(job: Job) -> Iterator[Run]:
    """Reverses the mission while the rover drives."""

    def run(random: Random) -> Run:
        with job.stage(job.plan(random)) as stage:
            stop = reversing(stage, random)
            return Run("reversing", job.seed, verdict(stop), stop)

    yield retried(job, "reversing", run)


def reversing(stage: Stage, random: Random) -> Stop:
    """Drives, and then backwards."""
    stage.set_speed(random.uniform(SLOW, FAST))
    stage.wait_until_well()
    stage.drive(random.uniform(0.0, 1.5))
    return stage.measure_reversed()


def pressed(job: Job) -> Iterator[Run]:
    """Disturbs a healthy companion, which must drive on until its camera fails."""
    for kind, pressure in PRESSURES.items():
        yield retried(job, kind, partial(_pressed, job, kind, pressure))


def _pressed(job: Job, kind: str, pressure: Pressure, random: Random) -> Run:
    plan = replace(job.plan(random), listens=kind == "spoofed_peers", slow_disk=kind == "slow_disk")
    with job.stage(plan) as stage:
        stage.set_speed(random.uniform(SLOW, FAST))
        stage.wait_until_well()
        stage.drive(random.uniform(0.0, 1.0))
        with pressure(stage):
            begun, until = time.monotonic(), time.monotonic() + HEALTHY
            stage.wait("driving on", lambda: time.monotonic() >= until, HEALTHY + 1.0)
            status = stage.status()
            if status["mode"] != "AUTO":
                change, reasons = status["mode_log"][-1], stage.held_for()
                if change["by"] == "companion" and reasons and "fault" not in reasons:
                    raise Disturbed(f"it was held for {reasons}: {change}")
                return Run(kind, job.seed, f"held for {reasons or 'nothing said'}: {change}")
            stop = stage.measure(lambda: stage.freeze_camera(on=True))
            stop = replace(stop, gap=stage.wire.longest_gap(begun, time.monotonic()))
        return Run(kind, job.seed, verdict(stop), stop)


def human(job: Job) -> Iterator[Run]:
    """Takes over by hand in one state, by seed; then a fault of the next drive must hold again."""
    state = list(STATES)[job.seed % len(STATES)]

    def run(random: Random) -> Run:
        with job.stage(replace(job.plan(random), script=False)) as stage:
            stage.set_speed(random.uniform(SLOW, FAST))
            stage.wait_until_well()
            stage.drive(random.uniform(0.0, 1.0))
            wrong = take_over(stage, state, random)
            if wrong:
                return Run("human", job.seed, wrong)
            stage.freeze_camera(on=False)
            stage.wait_until_well()
            stage.drive()
            stop = stage.measure(lambda: stage.freeze_camera(on=True))
            return Run("human", job.seed, verdict(stop), stop)

    yield retried(job, "human", run)


def by_hand(job: Job) -> Iterator[Run]:
    """Plays the scenes in which a human acts round a hold, each on a stage of its own."""
    for kind, scene in SCENES.items():
        yield retried(job, kind, partial(_played, job, kind, scene))


def _played(job: Job, kind: str, scene: StoppingScene, random: Random) -> Run:
    seen = scene.seen(job, random)
    return Run(kind, job.seed, seen.wrong, saw=seen.saw)


def alien(job: Job) -> Iterator[Run]:
    """Restarts a companion with another place's journal: it must call, the rover must not get away."""

    def run(random: Random) -> Run:
        zones = list(job.trail.borders.values())
        random.shuffle(zones)
        here, there = (begin + random.uniform(0.35, 0.65) * (end - begin) for begin, end in zones[:2])
        plan = Plan(job.seed, here, random.uniform(SLOW, FAST), quiet=False, brakes=job.brakes)
        out = job.out / f"{job.seed}-alien-{random.random()}"
        with job.stage(plan, out) as stage:
            stage.wait_until_well()
        with job.stage(replace(plan, at=there), out) as stage:
            stage.wait("a companion that sees", lambda: stage.read_status().get("frames", {}) != {}, 60.0)
            return _asks(job, stage)

    yield retried(job, "alien_place", run)


def _asks(job: Job, stage: Stage) -> Run:
    limit = Limit(stage.freshness, script_timeout(), stage.speed)
    stage.control.start()
    before = after = stage.status()
    asks = False
    while after["t"] - before["t"] < limit.seconds + BEYOND:
        after, told = stage.status(), stage.read_status()
        asks = told.get("state") == "calling" and "unknown_scene" in told["reasons"]
        if asks and after["mode"] == "HOLD" and after["speed"] <= STANDSTILL:
            break
        time.sleep(LOOK)
    stop = stopped(before, after, limit)
    return Run("alien_place", job.seed, verdict(stop) if asks else f"no call in the {after['zone']}", stop)


def report(job: Job) -> Iterator[Run]:
    """Drives a lap in report policy, past things without a word, for a while without vision or a link."""

    def run(random: Random) -> Run:
        plan = replace(
            job.plan(random), speed=RUSH, policy="report", quiet=False, surprises=True, script=False
        )
        with job.stage(plan) as stage:
            stage.set_speed(random.uniform(0.8 * RUSH, RUSH))
            stage.wait("a companion that sees", lambda: bool(stage.read_status()), 60.0)
            stage.control.start()
            doings = [*CAMERA.values(), SILENCE["dead_link"]]
            for part, fault in enumerate(doings, start=1):
                _drive_to(stage, job.trail.length * (part - random.random()) / len(doings))
                fault.begin(stage)
                _drive_to(stage, stage.status()["distance"] + 10.0)
                fault.end(stage)
            _drive_to(stage, job.trail.length)
            status = stage.status()
            by_companion = [change for change in status["mode_log"] if change["by"] != "hand"]
            commanded = max(len(stage.wire.commands), len(by_companion))
            wrong = ", ".join(stage.wire.commands) or ("" if commanded == 0 else str(by_companion))
            wrong = wrong or untested(stage.wire.reported)
            return Run("report", job.seed, wrong, None, commanded)

    yield retried(job, "report", run)


def untested(told: set[tuple[State, Policy]]) -> str:
    """Returns why a lap without orders proves nothing, by what the companion reported; "" if it does."""
    if {policy for _, policy in told} - {Policy.REPORT}:
        return "it was not in policy report all the time"
    missing = {State.CALLING, State.FAULT} - {state for state, _ in told}
    return ", ".join(f"it never told {state.name.lower()}" for state in sorted(missing))


def _drive_to(stage: Stage, distance: float) -> None:
    stage.wait(f"{distance:.0f} m driven", lambda: stage.status()["distance"] >= distance, LAP_WITHIN)


def guiding(job: Job) -> Iterator[Run]:
    """Causes each fault as soon as the companion guides the rover, which is then at its fastest."""
    for kind, fault in GUIDING.items():
        yield retried(job, kind, partial(_guided, job, kind, fault))


def _guided(job: Job, kind: str, fault: InjectedFault, random: Random) -> Run:
    world = World(job.seed, course=replace(LOOP, half=WIDE))
    drum = next(thing for thing in world.things.values() if thing.kind == "drum" and thing.surprise)
    at, _ = world.trail.nearest(drum.x, drum.y)
    plan = Plan(job.seed, at - random.uniform(*RUN_UP), job.speed, "guide", breakable=True, quiet=False)
    with job.stage(replace(plan, surprises=True, half=WIDE)) as stage:
        stage.wait_until_well()
        stage.control.start()
        stage.wait("guiding", lambda: stage.status()["mode"] != "AUTO", GUIDES_WITHIN)
        watch(stage, random.uniform(0.0, JUST))
        if any(order.endswith(" 4") for order in stage.wire.commands):  # GUIDED is that of a brake
            raise Disturbed(f"it was held: {stage.held_for()}")
        begun = time.monotonic()
        stop = stage.measure(
            lambda: fault.begin(stage), silences=fault.silences, mode="GUIDED", most=GUIDED_METRES
        )
        status, ordered = stage.status(), stage.wire.ordered(begun)
        # The mode log takes one change of several for the companion's, and a last answer for its order.
        arrives = math.inf if ordered is None or stage.wire.unheard else ordered + stage.wire.delay
        stop = replace(stop, by=COMPANION if arrives <= stop.changed_at else BY_SCRIPT)
        wrong = f"it touched {status['contacts']}" if status["contacts"] else verdict(stop)
        return Run(kind, job.seed, wrong, stop, saw=str(status["mode"]))


GROUPS: Mapping[str, Callable[[Job], Iterator[Run]]] = {
    "blind": blind,
    "dead": dead,
    "broken": broken,
    "backwards": backwards,
    "pressed": pressed,
    "human": human,
    "by_hand": by_hand,
    "alien": alien,
    "report": report,
}
GUIDED: Mapping[str, Callable[[Job], Iterator[Run]]] = {"guiding": guiding}
"""The group of `--guide`, on a path wide enough to drive round things."""
