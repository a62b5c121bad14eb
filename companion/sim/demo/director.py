"""Directs the demo: follows field, daemon and operator over real UDP and prints what happens."""

from __future__ import annotations

import contextlib
import json
import math
import time
from typing import Any

from companion.sim.demo.animation import Moment
from companion.sim.demo.answers import AutoOperator
from companion.sim.demo.onlooker import Onlooker, Shown
from companion.sim.demo.pace import SPEED, DemoPace
from companion.sim.demo.readiness import SLOW_FOR, Readiness
from companion.sim.demo.stage import ACROSS, DemoStage
from companion.sim.demo.story import Story, reasons_of
from companion.sim.demo.tally import DemoTally

DRIVES_FOR, JUDGES_FOR = 170.0, 60.0
"""Seconds of driving at `SPEED`, and pictures, after which the scripted demo gives up."""
STEP = 0.1
BESIDE = 3.0
"""m before a thing at which a rover in GUIDED drives round it."""
CLOSE = 5.0
"""m within which a thing is in the way of a go: farther from it, the rover goes on and stops for it again."""
BEHIND = 8.0
"""m behind it at which that demo ends."""
BEYOND_RETURN = 12.0
"""Metres that the rover must drive into the known meadow without a call for the place."""
TAKE_OVER_AFTER, TAKE_OVER_PICTURES = 4.0, 10.0
"""Seconds, and pictures, that a rover stands blocked, with nothing ahead of it, before a human takes over."""
STANDS = 0.2
"""m/s below which a rover in HOLD counts as standing: HOLD takes two seconds for the last centimetres."""
LOG_ACROSS = "log-across"
DRIVES_ROUND_WITHIN = 30.0
"""Seconds that a rover which guides has to find its way round what leaves room."""
REMOVE_AFTER = 1.5
"""Seconds that a named thing must have kept the rover standing before a person takes it away."""


class Director:
    """Follows field and operator; in the scripted demo it also answers calls and takes named things away."""

    def __init__(self, stage: DemoStage, story: Story, *, auto: bool) -> None:
        self._guide = stage.setup.guide
        self._stage = stage
        self._story = story
        self._readiness = Readiness(stage, story)
        self._too_busy = ""
        """Why this pace cannot be kept any more."""
        self._driving = False
        self._spent = 0.0
        """Share of the time that the demo may take."""
        self._auto = AutoOperator() if auto else None
        self._onlooker = Onlooker(stage.control)
        self._shown: dict[int, Shown] = {}
        """Id of a call or hold -> what it is about."""
        self._named: set[str] = set()
        """Ids of the things that the scripted operator has named as not drivable."""
        self._beside: set[str] = set()
        self._removed: set[str] = set()
        """Ids of the things that it drives round, and that were taken away."""
        self._tally = DemoTally()
        self._open: dict[int, dict[str, Any]] = {}
        self._blocked_since: float | None = None
        self._script_since: float | None = None
        self._left_meadow = False
        self._calls_at_return: int | None = None
        self._returned_at = 0.0
        self._seconds = 0.0
        self.moments: list[Moment] = []
        """What an animation tells."""
        self.status: dict[str, Any] = {}

    def play(self) -> dict[str, Any]:
        """Runs until the rover is back in the known meadow, its time is over or the operator quits.

        Returns the figures. Raises ChildError when the field or the daemon fails, sees nothing that it knows,
        or cannot hold at any pace.
        """
        self._readiness.get_ready()
        self.status = self._stage.control.status()
        self._read_events()
        self._too_busy, self._driving = "", True
        self._stage.control.start()
        started = last = time.monotonic()
        try:
            while not self._over():
                now = time.monotonic()
                self._spent += (now - last) / allowed(self._stage.pace, self._stage.speed)
                last = now
                self._follow(now)
                if self._is_to_slow_down():
                    self._slow_down()
                    last = time.monotonic()  # that was none of the demo's time
                time.sleep(STEP)
        except KeyboardInterrupt:
            if self._auto is not None:
                raise  # for a person Ctrl-C is another way to quit, so that the figures are still wanted
        self._seconds = time.monotonic() - started
        self._stage.daemon.stop()
        self._read_events()
        figures = self._tally.figures(self.status, self._stage.daemon_status(), self._seconds)
        # What was refused for some frames only, and held all the same, is no failure.
        refused = self._readiness.refused if self._readiness.refused_for(SLOW_FOR, time.monotonic()) else ""
        return {**figures, "speed": self._stage.speed, "hold_refused": refused}

    def _is_to_slow_down(self) -> bool:
        """Whether this computer has become too busy for the pace, and the rover stands."""
        now = time.monotonic()
        if not self._too_busy and self._readiness.refused_for(SLOW_FOR, now):
            self._too_busy = "this computer has become busier"
            self._story.log(self._clock(now), self._readiness.refusal())
        stands = self.status["mode"] == "HOLD" and self.status["speed"] < STANDS
        return bool(self._too_busy) and stands and self._readiness.slower() is not None

    def _slow_down(self) -> None:
        now, after = time.monotonic(), self._readiness.slower()
        assert after is not None
        judging = self._readiness.meter.judging(now)
        measured = f": it judges {judging}" if judging is not None else ""
        why = self._too_busy + measured
        self._story.log(
            self._clock(now), f"{why}; from now on the rover drives at {self._readiness.speed(after)}"
        )
        self._story.doing = "the daemon starts again"
        self._stage.change_pace(after)
        self._readiness.wait_at_pace(driving=True)
        self._tally.slowed_down += 1
        self._tally.received.clear()  # frames are counted from 1 again
        self._too_busy, self._onlooker = "", Onlooker(self._stage.control)
        self._read_events()
        if self._auto is not None:  # what was answered and not done is answered again
            self._auto = AutoOperator()

    def _over(self) -> bool:
        if self._auto is None:
            return not self._stage.operator.running
        held = bool(self.status) and self.status["mode"] == "HOLD"
        behind = self._guide and self._tally.kept_off > 0 and self.status["distance"] > ACROSS + BEHIND
        shown = behind or self._tally.returned_without_call
        return (shown and not held) or self._spent >= 1.0

    def _follow(self, now: float) -> None:
        for child in (self._stage.trail, self._stage.daemon):
            if not child.running:
                raise child.error("ended")
        before, self.status = self.status["mode"], self._stage.control.status()
        if before == "HOLD" and self.status["mode"] == "AUTO":
            self.moments.append(Moment(now, "drives on", "the rover drives on"))
        self._story.field(self.status, self._clock(now))
        self._story.doing = self._doing()
        self._readiness.look(now)
        self._read_events()
        self._take_away(now)
        self._end_script_hold(now)
        self._watch_detours()
        self._watch_return()
        if self._auto is not None:
            for call in list(self._open.values()):
                self._answer(self._auto, call, now)

    def _doing(self) -> str:
        """Says what is going on; nothing while a person is to answer, who may be typing."""
        if self._auto is None and self._open:
            return ""
        judging = self._readiness.meter.judging(time.monotonic())
        judged = "" if judging is None else f", {judging.rate:.1f} pictures judged a second"
        return f"{self.status['mode']}, {self.status['speed']:.1f} m/s{judged}"

    def _read_events(self) -> None:
        lines = self._stage.operator.lines()
        with (self._stage.out / "logs" / "events.jsonl").open("a", encoding="utf-8") as log:
            log.writelines(line + "\n" for _, line in lines)
        for at, line in lines:
            with contextlib.suppress(ValueError):
                self._handle_event(json.loads(line), at)

    def _handle_event(self, event: dict[str, Any], now: float) -> None:
        self._tally.event(event, now)
        if not self._driving:
            pass  # while all was loaded nothing could be seen
        elif self._auto is not None:
            self._story.event(event, self._clock(time.monotonic()))
        else:  # the operator's own terminal prints the rest
            self._story.picture(event, self._stage.out, self._clock(time.monotonic()))
        if event.get("event") == "state" and event["state"] == "fault" and self.status:
            self._too_busy = self._too_busy or "this computer has become busier"
        if event.get("event") == "summary":
            self._onlooker.summary(event, now)
        elif event.get("event") in {"call", "call_changed"}:
            self._open[event["id"]] = event
            if event["event"] == "call" and event["kind"] == "call":
                self.moments.append(Moment(now, "call", reasons_of(event)))
            self._look_at(event)
        elif event.get("event") == "ack" and self._auto is not None:
            self._auto.heard(event["target"], event["result"])
        elif event.get("event") == "closed":
            self._open.pop(event["id"], None)

    def _look_at(self, event: dict[str, Any]) -> None:
        """Looks at what a call or hold is about, and counts it."""
        number, shown = event["id"], self._onlooker.about(event)
        before = self._shown.get(number)
        if before is not None and self._stands_ahead(before.thing):
            shown = before  # it is still about that, whichever part of the picture it points at now
        if shown is not None:
            self._shown[number] = shown
        if event["event"] == "call" and event["kind"] == "call" and shown is not None:
            asked = self._tally.asked_about(event, shown, self.status["distance"])
            if self._auto is not None:  # a person is to look at the picture
                self._story.log(self._clock(time.monotonic()), asked)

    def _stands_ahead(self, thing: str | None, within: float = math.inf) -> bool:
        return any(
            one["id"] == thing and one["surprise"] and one["distance"] < within
            for one in self.status["things_ahead"]
        )

    def _answer(self, operator: AutoOperator, call: dict[str, Any], now: float) -> None:
        shown = self._shown.get(call["id"])
        if shown is None:
            self._look_at({**call, "event": "call"})
            return
        # What leaves room a rover that guides may be let go on before: it drives round it.
        in_the_way = not self._guide or shown.thing == LOG_ACROSS
        stands = in_the_way and self._stands_ahead(shown.thing, within=CLOSE)
        line = operator.answer(call, shown, now, stands_there=stands)
        if line is not None:
            self._story.log(self._clock(now), f"operator types: {call['id']} {line}")
            self._tally.typed(line)
            plain = " ".join(word for word in line.split() if not word.startswith("0."))  # without the box
            box = shown.outline or call.get("worst_tile_box")
            self.moments.append(Moment(now, "answer", f"operator: {plain}", box))
            self._tally.answered(call, shown, self.status["distance"])
            if shown.thing is not None and line.startswith("tap "):
                self._named.add(shown.thing)
            self._stage.operator.type(f"{call['id']} {line}")

    def _thing_in_the_way(self) -> dict[str, Any] | None:
        """Returns the thing on the path that was named, else one that the rover's picture shows."""
        ahead = [thing for thing in self.status["things_ahead"] if thing["surprise"]]
        named = [thing for thing in ahead if thing["id"] in self._named]
        if not named and self._open:
            shown = self._onlooker.ahead(next(iter(self._open.values()))["roi"])
            named = [thing for thing in ahead if shown is not None and thing["id"] == shown.thing]
        return min(named, key=lambda thing: float(thing["distance"]), default=None)

    def _take_away(self, now: float) -> None:
        """Takes a named thing away once it has kept the rover standing for `REMOVE_AFTER` s.

        Where the rover stands blocked but nothing is ahead, the perceiver took ground for a named thing: then
        a human takes over by hand.
        """
        standing = self.status["speed"] < STANDS and self.status["mode"] == "HOLD"
        unknown = any(
            call["stage"] == "open" and "unknown_object" in call["reasons"] for call in self._open.values()
        )
        blocked = self._tally.state == "blocked" and not unknown
        if not (standing and blocked):
            self._blocked_since = None
        elif self._blocked_since is None:
            self._blocked_since = now
        elif (thing := self._thing_in_the_way()) is None:
            if now - self._blocked_since >= TAKE_OVER_AFTER + TAKE_OVER_PICTURES / self._stage.pace.rate:
                self._take_over(now)
        elif now - self._blocked_since >= self._removed_after(thing["id"]):
            self._stage.control.remove(thing["id"])
            self._removed.add(thing["id"])
            self._tally.kept_off += 1
            self._blocked_since = None
            told = f"somebody takes the {thing['kind']} away"
            self.moments.append(Moment(now, "told", told))
            self._story.log(self._clock(now), f"{told}, {thing['distance']:.1f} m before the rover")

    def _removed_after(self, thing: str) -> float:
        """Return the seconds that a thing must have kept the rover standing: one that leaves room, longer."""
        return DRIVES_ROUND_WITHIN if self._guide and thing != LOG_ACROSS else REMOVE_AFTER

    def _end_script_hold(self, now: float) -> None:
        """Sets AUTO by hand where the script on the autopilot holds, and nobody is asked for a go."""
        log = self.status["mode_log"]
        held = self.status["mode"] == "HOLD" and bool(log) and log[-1]["by"] == "script"
        if not held or self._open or self.status["speed"] >= STANDS or self._tally.state == "fault":
            self._script_since = None
            return
        self._script_since = self._script_since or now
        if now - self._script_since >= TAKE_OVER_AFTER + TAKE_OVER_PICTURES / self._stage.pace.rate:
            self._script_since = None
            self._stage.control.mode("AUTO")
            told = "the script held, since the computer was late: a human sets AUTO by hand"
            self._story.log(self._clock(now), told)

    def _take_over(self, now: float) -> None:
        self._stage.control.mode("AUTO")
        self._tally.taken_over += 1
        self._blocked_since = None
        self._story.log(self._clock(now), "nothing is in the way: a human takes over and sets AUTO by hand")

    def _watch_detours(self) -> None:
        """Counts the things that are passed in GUIDED, untouched and unmoved."""
        status = self.status
        ahead = {one["id"]: one["distance"] for one in status["things_ahead"] if one["surprise"]}
        if status["mode"] == "GUIDED" and status["mode_log"][-1]["by"] == "companion":
            self._beside |= {thing for thing, distance in ahead.items() if distance < BESIDE}
        passed = self._beside - set(ahead)
        self._beside -= passed
        self._tally.driven_round += len(passed - self._removed - {one["id"] for one in status["contacts"]})

    def _watch_return(self) -> None:
        status = self.status
        if status["zone"] != "meadow":
            self._left_meadow, self._calls_at_return = True, None
            return
        if not self._left_meadow:
            return
        if self._calls_at_return is None:
            self._calls_at_return, self._returned_at = self._tally.calls_for_places, status["distance"]
        if self._tally.calls_for_places > self._calls_at_return:
            return
        if status["distance"] - self._returned_at >= BEYOND_RETURN and self._tally.history_matches:
            if not self._tally.returned_without_call:
                self._story.log(
                    self._clock(time.monotonic()), "back in the meadow, and nobody was asked about it"
                )
            self._tally.returned_without_call = True

    def _clock(self, now: float) -> float:
        return now - self._story.began


def allowed(pace: DemoPace, speed: float) -> float:
    """Return the seconds that the scripted demo may take at a pace."""
    return DRIVES_FOR * SPEED / speed + JUDGES_FOR / pace.rate
