"""Directs the demo: follows field, daemon and operator over real UDP and prints what happens."""

from __future__ import annotations

import contextlib
import json
import math
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from companion.sim.demo.answers import AutoOperator
from companion.sim.demo.child import LoggedProcess
from companion.sim.demo.onlooker import Onlooker, Shown
from companion.sim.demo.story import Story
from companion.sim.demo.tally import DemoTally, missing, missing_guided
from companion.sim.field.control import FieldControl

LIMIT = 170.0
"""Seconds after which the scripted demo gives up."""
READY_WITHIN = 30.0
SLOW_FOR = 8.0
"""Seconds for which hold must have been refused before the computer counts as too slow for it."""
STEP = 0.1
ACROSS = 31.0
"""m from the start, in the meadow: where a log lies across the path in the demo of guiding."""
BEHIND = 8.0
"""m behind it at which that demo ends."""
BEYOND_RETURN = 12.0
"""Metres that the rover must drive into the known meadow without a call for the place."""
TAKE_OVER_AFTER = 4.0
"""Seconds that a rover stands blocked, with nothing ahead of it, before a human takes over."""
STANDS = 0.2
"""m/s below which a rover in HOLD counts as standing: HOLD takes two seconds for the last centimetres."""
REMOVE_AFTER = 1.5
"""Seconds that a named thing must have kept the rover standing before a person takes it away."""


@dataclass
class Stage:
    """Holds the demo's processes and the folder `out` that they write to."""

    out: Path
    trail: LoggedProcess
    daemon: LoggedProcess
    operator: LoggedProcess
    control: FieldControl
    started: float = field(default_factory=time.monotonic)

    def daemon_status(self) -> dict[str, Any]:
        """Reads the daemon's status file; empty while there is none."""
        with contextlib.suppress(OSError, ValueError):
            status = json.loads((self.out / "state" / "status.json").read_text(encoding="utf-8"))
            return status if isinstance(status, dict) else {}
        return {}

    def close(self) -> None:
        """Ends all processes, the operator first."""
        for child in (self.operator, self.daemon):
            child.stop()
        with contextlib.suppress(Exception):
            self.control.stop()
            self.control.close()
        self.trail.stop()


class Director:
    """Follows field and operator; in the scripted demo it also answers calls and takes named things away."""

    def __init__(
        self, stage: Stage, story: Story, *, auto: bool, speed: float = 1.0, guide: bool = False
    ) -> None:
        """speed: of the rover, as a share of the usual one. guide: it ends behind the log across the path."""
        self._guide = guide
        self._stage = stage
        self._story = story
        self._limit = LIMIT / speed
        self._auto = AutoOperator() if auto else None
        self._onlooker = Onlooker(stage.control)
        self._shown: dict[int, Shown] = {}
        """Id of a call or hold -> what it is about."""
        self._named: set[str] = set()
        """Ids of the things that the scripted operator has named as not drivable."""
        self._tally = DemoTally()
        self._open: dict[int, dict[str, Any]] = {}
        self._blocked_since: float | None = None
        self._left_meadow = False
        self._calls_at_return: int | None = None
        self._returned_at = 0.0
        self._seconds = 0.0
        self.status: dict[str, Any] = {}

    def play(self) -> dict[str, Any]:
        """Runs until the rover is back in the known meadow, `LIMIT` is over or the operator quits.

        Returns the figures. Raises ChildError when the field or the daemon fails.
        """
        self._stage.control.start()
        started = time.monotonic()
        try:
            while not self._over(time.monotonic() - started):
                self._follow(time.monotonic())
                time.sleep(STEP)
        except KeyboardInterrupt:
            if self._auto is not None:
                raise  # for a person Ctrl-C is another way to quit, so that the figures are still wanted
        self._seconds = time.monotonic() - started
        self._stage.daemon.stop()
        self._read_events()
        return self._tally.figures(self.status, self._stage.daemon_status(), self._seconds)

    def wait_until_ready(self) -> str:
        """Waits until the daemon sees and may hold. Returns why it may not hold, as it says, "" where it may.

        Raises ChildError when it sees nothing that it knows.
        """
        deadline, refused_at, refused = time.monotonic() + READY_WITHIN, math.inf, ""
        while time.monotonic() < deadline and self._stage.daemon.running:
            status, now = self._stage.daemon_status(), time.monotonic()
            refused = str(status.get("hold_refused", ""))
            refused_at = min(refused_at, now) if refused else math.inf
            if status.get("state") == "ok" and not refused:
                return ""
            if now - refused_at >= SLOW_FOR:
                return refused
            time.sleep(STEP)
        raise self._stage.daemon.error("saw nothing that it knows")

    def _over(self, seconds: float) -> bool:
        if self._auto is None:
            return not self._stage.operator.running
        held = bool(self.status) and self.status["mode"] == "HOLD"
        behind = self._guide and self._tally.kept_off > 0 and self.status["distance"] > ACROSS + BEHIND
        shown = behind or self._tally.returned_without_call
        return (shown and not held) or seconds >= self._limit

    def _follow(self, now: float) -> None:
        for child in (self._stage.trail, self._stage.daemon):
            if not child.running:
                raise child.error("ended")
        self.status = self._stage.control.status()
        self._story.field(self.status, self._clock(now))
        self._read_events()
        self._take_away(now)
        self._watch_return()
        if self._auto is not None:
            for call in list(self._open.values()):
                self._answer(self._auto, call, now)

    def _read_events(self) -> None:
        lines = self._stage.operator.lines()
        with (self._stage.out / "logs" / "events.jsonl").open("a", encoding="utf-8") as log:
            log.writelines(line + "\n" for _, line in lines)
        for at, line in lines:
            with contextlib.suppress(ValueError):
                self._handle_event(json.loads(line), at)

    def _handle_event(self, event: dict[str, Any], now: float) -> None:
        self._tally.event(event, now)
        if self._auto is not None:
            self._story.event(event, self._clock(now))
        else:  # the operator's own terminal prints the rest
            self._story.picture(event, self._stage.out, self._clock(now))
        if event.get("event") == "summary":
            self._onlooker.summary(event, now)
        elif event.get("event") in {"call", "call_changed"}:
            self._open[event["id"]] = event
            self._look_at(event)
        elif event.get("event") == "closed":
            self._open.pop(event["id"], None)

    def _look_at(self, event: dict[str, Any]) -> None:
        """Looks at what a call or hold is about, and counts it."""
        number, shown = event["id"], self._onlooker.about(event)
        if shown is not None:
            self._shown[number] = shown
        if event["event"] == "call" and event["kind"] == "call" and shown is not None:
            asked = self._tally.asked_about(event, shown, self.status["distance"])
            if self._auto is not None:  # a person is to look at the picture
                self._story.log(self._clock(time.monotonic()), asked)

    def _answer(self, operator: AutoOperator, call: dict[str, Any], now: float) -> None:
        shown = self._shown.get(call["id"])
        if shown is None:
            self._look_at({**call, "event": "call"})
            return
        line = operator.answer(call, shown, now)
        if line is not None:
            self._story.log(self._clock(now), f"operator types: {call['id']} {line}")
            self._tally.typed(line)
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
            if now - self._blocked_since >= TAKE_OVER_AFTER:
                self._take_over(now)
        elif now - self._blocked_since >= REMOVE_AFTER:
            self._stage.control.remove(thing["id"])
            self._tally.kept_off += 1
            self._blocked_since = None
            self._story.log(
                self._clock(now),
                f"somebody takes the {thing['kind']} away, {thing['distance']:.1f} m before the rover",
            )

    def _take_over(self, now: float) -> None:
        self._stage.control.mode("AUTO")
        self._tally.taken_over += 1
        self._blocked_since = None
        self._story.log(self._clock(now), "nothing is in the way: a human takes over and sets AUTO by hand")

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
        return now - self._stage.started


def verdict(figures: dict[str, Any], story: Story, *, guide: bool = False) -> int:
    """Prints what was not shown, or that all was; returns the exit code."""
    left = (missing_guided if guide else missing)(figures)
    story.plain()
    for name in left:
        story.plain(f"NOT SHOWN: {name}")
    if not left:
        story.plain("All of the job was shown.")
    return 1 if left else 0


def summary(figures: dict[str, Any]) -> str:
    """Returns one line with the totals of a demo that a person answered."""
    return (
        f"{figures['calls']} calls, {figures['holds']} holds, {figures['resumes']} resumes, "
        f"{figures['history_matches']} places known again, {figures['collisions']} things driven into."
    )
