"""Rows of the companion's own process, of the link to the autopilot, and of the autopilot."""

from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Callable
from dataclasses import replace
from random import Random
from typing import Any

from bench.faults.row import BACK_WITHIN, HOLD_WITHIN, Row
from bench.faults.stages import SCRIPT_WITHIN, repeated, stops
from bench.stopping.faults import SILENCE, UNHEARD
from bench.stopping.humans import READ, SOON, watch
from bench.stopping.jobs import Job
from bench.stopping.runs import reversing
from bench.stopping.scenes import (
    ALWAYS_NEW,
    NEVER_NEW,
    Seen,
    changed_by,
    drives,
    follows,
    sees_again_in_hold,
    wait_for_mode,
    with_and_without_script,
)
from bench.stopping.stage import READY_WITHIN, RETURN_WITHIN, Plan, Stage
from companion.sim.demo.child import LoggedProcess
from companion.sim.field.rover import STANDSTILL
from companion.wire.ids import State
from companion.wire.parameters import THR_SCENE

_GAP = 4.0
"""s from a cut of the wire until the operator answers, and from then until it is whole again."""
_WATCHED = 10.0
"""s in which the rover of a dead companion is watched."""
_BACKS_WITHIN = 3.0
"""s from driving backwards at 0.3 m/s to the order: a metre at 0.6 m/s, reports every 0.5 s, and 0.8 s."""
_PX4_SPEED = 0.6
_CIRCLES = 40.0
"""s within which a rover that circles back in LOITER stands."""
_NOT_WELL = "not well again"
_TO_HOLD = "COMMAND_LONG 176 1 4"


class _Events:
    """The events of the operator's terminal, with when each was read, monotonic s."""

    def __init__(self, operator: LoggedProcess) -> None:
        self._operator = operator
        self._all: list[tuple[float, dict[str, Any]]] = []

    def first(
        self, fits: Callable[[dict[str, Any]], bool], since: float = 0.0
    ) -> tuple[float, dict[str, Any]] | None:
        """Returns the first event since then that fits; None: none yet."""
        self._all += [(at, json.loads(line)) for at, line in self._operator.lines()]
        return next(((at, one) for at, one in self._all if at >= since and fits(one)), None)

    def wait(
        self, stage: Stage, what: str, fits: Callable[[dict[str, Any]], bool], since: float = 0.0
    ) -> tuple[float, dict[str, Any]]:
        """Waits until there is such an event. Raises Disturbed."""
        stage.wait(what, lambda: self.first(fits, since) is not None, SOON)
        found = self.first(fits, since)
        assert found is not None
        return found


def _call_open(stage: Stage, random: Random) -> Seen:
    """Cuts the wire while a call is open and before its hold has arrived, and makes it whole again."""
    operator = stage.start_operator()
    events = _Events(operator)
    drives(stage, random)
    stage.wire.deaf = True
    stage.ground.set_parameter(THR_SCENE, ALWAYS_NEW)
    _, call = events.wait(stage, "a call", lambda one: one["event"] == "call")
    stage.ground.set_parameter(THR_SCENE, NEVER_NEW)
    watch(stage, 0.3)  # until that has arrived
    with follows():
        stage.wire.mute = stage.wire.unheard = True
        wait_for_mode(stage, "HOLD")
        stop = stage.status()
        held_at = stop["monotonic"] - stop["t"] + stop["mode_log"][-1]["t"]
        believed, by = stage.wire.believed(held_at), changed_by(stage)
        watch(stage, _GAP)
        in_gap = stage.plan.seed % 2 == 1
        if in_gap:
            operator.type(f"{call['id']} go")
            watch(stage, _GAP)
        stage.wire.mute = stage.wire.unheard = stage.wire.deaf = False
        whole = time.monotonic()
        if not in_gap:
            told = f"C{call['id']} "
            events.wait(
                stage,
                "the call again",
                lambda one: one["event"] in ("text", "call", "call_changed") and told in json.dumps(one),
                whole,
            )
            watch(stage, READ)
            operator.type(f"{call['id']} go")
        at, ack = events.wait(stage, "an acknowledgement", lambda one: one["event"] == "ack", whole)
        refused = "no go" in ack["text"]  # it came before the autopilot was heard again
        if refused:
            stage.wait_until_well()
            operator.type(f"{call['id']} go")
        wait_for_mode(stage, "AUTO")
        closed = events.wait(stage, "the closing", lambda one: one["event"] == "closed", whole)[1]
        right = ack["result"] == "applied" and ack["target"] == closed["id"] == call["id"]
        wrong = "" if right else f"{ack}, {closed}"
        saw = "answered in the gap" if in_gap else "answered when the call came again"
        saw += ': told "no go: disarmed, or no autopilot", and drove after another go' if refused else ""
        return Seen(wrong, held_at - (believed or 0.0), at - whole, f"held by {by}, {saw}")


def _reboots(stage: Stage, random: Random) -> tuple[str, float | None]:
    """Reboots the autopilot. Returns what was wrong, and s from its first heartbeat until all was well.

    While it is silent, HOLD may be asked for: the rover stops, and its pictures stand still.
    """
    asked, seconds = len(stage.wire.commands), random.uniform(4.0, 8.0)
    begun = time.monotonic()
    stage.control.ask("reboot", seconds=seconds)
    stage.wait("a fault", lambda: stage.wire.beats[-1].state is State.FAULT, SOON)
    noticed = time.monotonic() - begun
    watch(stage, max(0.0, seconds - noticed))
    before = len(stage.wire.commands)
    returned = stage.returned(begun + seconds)
    watch(stage, 2.0)
    commanded = [*(set(stage.wire.commands[asked:before]) - {_TO_HOLD}), *stage.wire.commands[before:]]
    if commanded:
        return f"commanded {commanded}", returned
    return (_NOT_WELL if returned is None else ""), returned


def _drives_by_hand(stage: Stage) -> str:
    """Lets a person arm and set AUTO, and returns what was wrong; a new hold for a thing ahead is not."""
    asked = len(stage.wire.commands)
    stage.control.start()
    watch(stage, 3.0)
    commanded, mode = stage.wire.commands[asked:], stage.status()["mode"]
    if mode == "AUTO" and not commanded:
        stage.wait("a status without a hold", lambda: stage.read_status().get("held_by") is None, SOON)
        return ""
    log = (stage.out / "daemon.log").read_text(encoding="utf-8")
    reasons = re.findall(r"WARNING companion.daemon.call_texts: hold \d+: (.+)", log)
    thing = reasons and "fault" not in reasons[-1]
    return "" if thing else f"a person was overruled: {commanded}, {mode}, {reasons}"


def _reboot_while_held(stage: Stage, random: Random) -> Seen:
    """Reboots the autopilot in our hold, then lets a person set AUTO and arm it, or arm it and set AUTO."""
    drives(stage, random)
    stage.freeze_camera(on=True)
    with follows():
        sees_again_in_hold(stage)
        wrong, returned = _reboots(stage, random)
        begun, asked = time.monotonic(), len(stage.wire.commands)
        if stage.plan.seed % 2 == 0:
            wrong = wrong or _drives_by_hand(stage)
            return Seen(wrong, None, returned, "armed in HOLD, and AUTO set: taken over")
        stage.control.mode("AUTO")
        watch(stage, 2.0)
        if stage.wire.commands[asked:]:
            wrong = f"commanded while it was not armed: {stage.wire.commands[asked:]}"
        armed = time.monotonic()
        stage.control.ask("arm", on=True)
        wait_for_mode(stage, "HOLD")
        by, ordered = changed_by(stage), stage.wire.ordered(begun) or time.monotonic()
        stage.wait_until_well()
        watch(stage, READ)
        stage.ground.go(int(stage.read_status()["current_id"]))
        wait_for_mode(stage, "AUTO")
        return Seen(wrong, ordered - armed, returned, f"armed in AUTO: held again by {by} until a go")


def _reboot_while_driving(stage: Stage, random: Random) -> Seen:
    """Reboots the autopilot as it drives. A person arms it and sets AUTO again: nothing may hold it."""
    drives(stage, random)
    with follows():
        wrong, returned = _reboots(stage, random)
        saw = "drives again when a person sets AUTO"
        if returned is None:  # it stood while it was thought to drive: its picture counts as frozen
            stage.control.ask("arm", on=True)
            stage.control.mode("MANUAL")
            stage.control.ask("throttle", throttle=0.5)
            stage.wait_until_well()
            wrong = wrong.removeprefix(_NOT_WELL)
            saw = "drives again in AUTO after it was moved by hand: its still picture counted as frozen"
        wrong = wrong or _drives_by_hand(stage)
        return Seen(wrong, None, returned, f"says: autopilot silent; {saw}")


def _reboot_into_auto(stage: Stage, random: Random) -> Seen:
    """Reboots an autopilot that then arms itself in AUTO, as it drives.

    By turns it has no script, and the companion is dead.
    """
    lives = not stage.plan.script
    for name, value in (("ARMING_REQUIRE", 3.0), ("INITIAL_MODE", 10.0), ("ATS_NEED", 1.0)):
        stage.ground.set_of_autopilot(name, value)
    drives(stage, random)
    seconds, checks = random.uniform(4.0, 8.0), random.choice((0.0, random.uniform(0.5, 3.0)))
    with follows():
        if not lives:
            stage.daemon.process.kill()
            stage.daemon.process.wait(SOON)
        armed = time.monotonic() + seconds + checks
        stage.control.ask("reboot", seconds=seconds, checks=checks)
        watch(stage, seconds + checks) if lives else time.sleep(seconds + checks)
        before = stage.status()["distance"]
        if lives:
            wait_for_mode(stage, "HOLD")
        else:
            time.sleep(_WATCHED)
        ordered = stage.wire.ordered(armed) if lives else None
        status = stage.status()
        if status["mode"] != "HOLD" or status["distance"] - before > 2.0:
            return Seen(f"it moved: {status['mode']}, {status['distance'] - before:.1f} m")
        by = changed_by(stage)
        begun = time.monotonic()
        if not lives:
            stage.start_daemon()
        stage.wait_until_well()
        returned = time.monotonic() - begun
        watch(stage, READ)
        if not lives:
            wrong = "" if stage.status()["mode"] == "HOLD" else "it drove on by itself"
            return Seen(wrong, None, returned, f"companion dead: held by {by}")
        stage.ground.go(int(stage.read_status()["current_id"]))
        wait_for_mode(stage, "AUTO")
        hold = None if ordered is None else ordered - armed
        return Seen("", hold, returned, f"held by {by} until a go")


def _reversed(stage: Stage, random: Random) -> Seen:
    """Reverses the mission while the rover drives, and lets it drive on forward."""
    stop = reversing(stage, random)
    if not stop.stands or stop.returned is None:
        return Seen(_NOT_WELL if stop.stands else "not stopped", stop.hold)
    with follows():
        wait_for_mode(stage, "AUTO")
    return Seen("", stop.hold, stop.returned, f"held by {stop.by} until a go, says: drives backwards")


def _px4(job: Job, random: Random) -> Plan:
    return replace(job.plan(random), speed=_PX4_SPEED, autopilot="px4", script=False)


def _dead_on_px4(stage: Stage, random: Random) -> Seen:
    """Kills the companion of a PX4 rover in MISSION, and watches what it does."""
    events = _Events(stage.start_operator())
    stage.wait_until_well()
    stage.drive(random.uniform(0.0, 1.0))
    with follows():
        before, killed = stage.status(), time.monotonic()
        stage.daemon.process.kill()
        stage.daemon.process.wait(SOON)
        while time.monotonic() < killed + _WATCHED:
            time.sleep(0.1)
        after = stage.status()
        drives_on = after["mode"] == "MISSION" and after["speed"] > 0.9 * _PX4_SPEED
        text = events.first(lambda one: "mission computer lost" in one.get("text", ""), killed)
        lost = events.first(lambda one: one["event"] == "link" and not one["up"], killed)
        begun = time.monotonic()
        stage.start_daemon()
        stage.wait("a companion that sees", lambda: stage.wire.well_again(begun) is not None, READY_WITHIN)
        if text is None or lost is None or not drives_on:
            return Seen(f"it did not drive on, or nobody said so: {after['mode']}, {text}, {lost}")
        metres = after["distance"] - before["distance"]
        saw = f"DRIVES ON ({metres:.0f} m in {_WATCHED:g} s); PX4 and the operator's terminal say so"
        return Seen("", None, stage.wire.well_again(begun), saw)


def _guarded_px4(job: Job, random: Random) -> Plan:
    return replace(_px4(job, random), deadman=True)


def _awaited(fits: Callable[[], bool], limit: float) -> bool:
    """Waits for at most `limit` s while no companion runs. Returns whether it came true."""
    until = time.monotonic() + limit
    while not fits():
        if time.monotonic() > until:
            return False
        time.sleep(0.02)
    return True


def _stands(stage: Stage) -> bool:
    before = stage.status()["distance"]
    time.sleep(1.0)
    return bool(stage.status()["distance"] - before < STANDSTILL)


def _dead_on_guarded_px4(stage: Stage, random: Random) -> Seen:
    """Kills the companion of a PX4 rover in MISSION, which streams sticks. The hold counts from the kill."""
    stage.wait_until_well()
    stage.drive(random.uniform(0.0, 1.0))
    stage.wait("its stream", lambda: stage.read_status().get("px4_deadman") == "on", SOON)
    with follows():
        before, killed = stage.status(), time.monotonic()
        stage.daemon.process.kill()
        stage.daemon.process.wait(SOON)
        if not _awaited(lambda: bool(stage.status()["mode"] == "LOITER"), SOON):
            return Seen("it drives on")
        stop = stage.status()
        held_at = stop["monotonic"] - stop["t"] + stop["mode_log"][-1]["t"]
        stood = _awaited(lambda: _stands(stage), _CIRCLES)
        metres = stage.status()["distance"] - before["distance"]
        begun = time.monotonic()
        stage.start_daemon()
        stage.wait("a companion that sees", lambda: stage.wire.well_again(begun) is not None, READY_WITHIN)
        watch(stage, 2.0)
        mode = stage.status()["mode"]
        wrong = "" if stood and mode == "LOITER" else f"stood: {stood}, then {mode}"
        saw = f"LOITER by the {changed_by(stage)}; stood after {math.ceil(metres)} m from {_PX4_SPEED} m/s"
        return Seen(wrong, held_at - killed, stage.wire.well_again(begun), saw)


ROWS = (
    Row(
        "companion killed while driving",
        "SIGKILL; it is started again when the rover stands",
        "script holds",
        stops(SILENCE["kill_9"], 5),
        SCRIPT_WITHIN,
        BACK_WITHIN,
    ),
    Row(
        "main loop stopped",
        "SIGSTOP of the companion, as if it hung, and SIGCONT when the rover stands",
        "script holds",
        stops(SILENCE["sigstop"], 5),
        SCRIPT_WITHIN,
        BACK_WITHIN,
    ),
    Row(
        "link lost",
        "nothing passes between companion and autopilot, both ways",
        "script holds",
        stops(SILENCE["dead_link"], 5),
        SCRIPT_WITHIN,
        BACK_WITHIN,
    ),
    Row(
        "link lost with a call open",
        "the same after a call was announced, before its hold arrived; it is answered in the gap or after it",
        "script holds; the call can be answered",
        repeated(6, Job.plan, _call_open),
        SCRIPT_WITHIN,
        BACK_WITHIN,
    ),
    Row(
        "companion does not hear the autopilot",
        "nothing passes from the autopilot to the companion",
        "fault after 3 s; script holds",
        stops(SILENCE["one_way_wire"], 5),
        SCRIPT_WITHIN,
        BACK_WITHIN,
    ),
    Row(
        "autopilot does not hear the companion",
        "nothing passes from the companion to the autopilot",
        "script holds",
        stops(UNHEARD, 5),
        SCRIPT_WITHIN,
        BACK_WITHIN,
    ),
    Row(
        "autopilot reboots while it is held",
        "it is deaf and silent for 4 to 8 s, then disarmed in HOLD; a person sets AUTO and arms, or reverse",
        "no command until armed; armed in AUTO: held",
        repeated(6, Job.plan, _reboot_while_held),
        HOLD_WITHIN,
        BACK_WITHIN,
    ),
    Row(
        "autopilot reboots while it drives",
        "it is deaf and silent for 4 to 8 s, then disarmed in HOLD; a person arms it and sets AUTO again",
        "it stands; a person drives on",
        repeated(5, Job.plan, _reboot_while_driving),
        None,
        RETURN_WITHIN,
    ),
    Row(
        "autopilot reboots armed in AUTO",
        "ARMING_REQUIRE 3, INITIAL_MODE 10: deaf and silent for 4 to 8 s, it arms itself in AUTO up to 3 s "
        "later; by turns it has no script, and the companion is dead with ATS_NEED 1",
        "held as soon as it is armed",
        repeated(6, with_and_without_script, _reboot_into_auto),
        HOLD_WITHIN,
        BACK_WITHIN,
    ),
    Row(
        "drives backwards in AUTO",
        "DO_SET_REVERSE while it drives at 0.6 to 1.5 m/s; undone when it stands, and a go",
        "held",
        repeated(5, Job.plan, _reversed),
        _BACKS_WITHIN,
        BACK_WITHIN,
    ),
    Row(
        "companion dead on PX4",
        "SIGKILL of the companion of a PX4 rover in MISSION",
        "it drives on",
        repeated(3, _px4, _dead_on_px4),
        exception="px4_deadman, which is off as shipped, has PX4 stop it at a price: docs/autopilots.md",
    ),
    Row(
        "companion dead on PX4, with px4_deadman",
        "the same, with the stream of sticks and the parameters that it needs, and no transmitter",
        "PX4 holds within 1 s",
        repeated(5, _guarded_px4, _dead_on_guarded_px4),
        1.0,
        BACK_WITHIN,
    ),
)
