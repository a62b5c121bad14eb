"""Simulates a trail, a rover and its autopilot in virtual time, for the state machine's tests."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import starmap
from typing import TypeVar

import numpy as np

from anytraverse.answers import AnswerOutcome
from anytraverse.assessment import Assessment, Finding, Maps, Observation, Reason
from anytraverse.findings import find, make_maps, roi_figures
from anytraverse.frame import Frame
from anytraverse.judging import Settings, Thresholds
from anytraverse.operations import SetWord
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from anytraverse.roi import RoiFigures
from companion.calls.decisions import Call, CallClosed, CallOpened, Decision, HoldMoved, HoldStarted, SetMode
from companion.calls.hold import Hold, HoldEvent
from companion.calls.machine import OperatorCalls
from companion.calls.mode_monitor import ModeReport
from companion.calls.numbers import Numbers
from companion.calls.policy import PolicyState
from companion.calls.snapshot import restore, snapshot
from companion.vehicle import Autopilot as KnownAutopilot
from companion.vehicle import ardupilot
from companion.vehicle.state import Mission
from companion.wire.ids import Motion, Outcome, Policy, Result

HEIGHT, WIDTH = 40, 60
STEP = 0.05
PERIOD = 0.1
HOLD, AUTO, GUIDED, MANUAL, RTL, LOITER = 4, 10, 15, 0, 11, 5
PX4_RTL = 0x05040000
AHEAD = Box(0.40, 0.68, 0.52, 0.80)
"""A small thing in the ROI."""
BESIDE = Box(0.58, 0.72, 0.66, 0.86)
"""Another small thing in the ROI, away from `AHEAD`."""
SLIVER = Box(0.4, 0.68, 0.4 + 2 / 60, 0.90)
"""A thing so narrow that half of its width leaves a corridor beside it."""
ASIDE = Box(0.6, 0.68, 0.6 + 2 / 60, 0.90)
"""Another narrow thing, away from `SLIVER`."""
ACROSS = Box(0.30, 0.70, 0.70, 0.85)
"""A thing across the whole way."""
GNOME = "gnome"
"""The word that was taught by a tap, in scenes that use it."""
DecisionKind = TypeVar("DecisionKind", bound=Decision)


def reported(mode: int, at: float | None, kind: KnownAutopilot = ardupilot.ROVER) -> ModeReport:
    """Return an armed autopilot's report of its mode."""
    return ModeReport(mode, armed=True, reported_at=at, autopilot=kind)


@dataclass(frozen=True)
class Thing:
    """A thing on the trail.

    name: the word that explains it. unsure: its uncertainty while that word is not in use.
    mistaken: share of its width, from the left, in which the word `GNOME` has attention 1. blur: attention of
    that word in the rest of it.
    """

    box: Box
    name: str = "drum"
    unsure: float = 0.95
    mistaken: float = 0.0
    blur: float = 0.0


@dataclass(frozen=True)
class View:
    """What a frame shows.

    turned: the embedding's angle in degrees; far from the reference's angle the scene has changed. haze:
    uncertainty of the trail. broken: the maps are NaN. pending: it may still prove to be a remembered scene.
    """

    things: tuple[Thing, ...] = ()
    turned: float = 0.0
    haze: float = 0.0
    broken: bool = False
    pending: bool = False

    def assessed(
        self,
        number: int,
        words: Mapping[str, float],
        judging: Settings,
        at: float,
        age: float,
        reference: float,
    ) -> Assessment:
        """Return the assessment that the engine would make of this view with `words`."""
        frame = Frame(number, at - age, np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8))
        angle = math.radians(self.turned)
        embedding = np.array([math.cos(angle), math.sin(angle)], dtype=np.float32)
        seen = Assessment(
            frame, Preferences.of(words), (), age, observation=Observation(frame, None, embedding)
        )
        found = _judged(replace(self, turned=0.0, pending=False), tuple(words.items()), judging)
        if isinstance(found, Finding):
            return replace(seen, findings=(found,))
        maps, roi = found
        similarity = math.cos(angle - math.radians(reference))
        findings = tuple(find(roi, len(words), similarity, judging))
        seen = replace(seen, findings=findings, maps=maps, roi=roi, similarity=similarity)
        return replace(seen, undecided=self.pending and Reason.UNKNOWN_SCENE in seen.reasons)


@lru_cache(256)
def _judged(
    view: View, words: tuple[tuple[str, float], ...], judging: Settings
) -> tuple[Maps, RoiFigures] | Finding:
    """Return the maps and the ROI's figures of a view; the same view is shown hundreds of times."""
    names = [word for word, _ in words]
    attention = np.zeros((len(names), HEIGHT, WIDTH), dtype=np.float32)
    attention[names.index("trail")] = 1.0 - view.haze
    for thing in view.things:
        inside = thing.box.mask(HEIGHT, WIDTH)
        attention[:, inside] = 0.0
        if thing.name in names:
            attention[names.index(thing.name), inside] = 0.95
        else:
            attention[names.index("trail"), inside] = 1.0 - thing.unsure
        if GNOME in names:
            attention[names.index(GNOME), inside] = thing.blur
            left, width = thing.box.left, thing.box.right - thing.box.left
            seen_as = Box(left, thing.box.top, left + max(1e-6, thing.mistaken * width), thing.box.bottom)
            attention[names.index(GNOME), seen_as.mask(HEIGHT, WIDTH)] = 1.0
    if view.broken:
        attention[:] = np.nan
    maps = make_maps(attention, [weight for _, weight in words], judging)
    if isinstance(maps, Finding):
        return maps
    for one in vars(maps).values():
        one.flags.writeable = False
    roi = roi_figures(maps, WIDTH / HEIGHT, judging)
    assert not isinstance(roi, Finding)
    return maps, roi


CLEAR = View()
DRUM = View((Thing(AHEAD),))
LOG = View((Thing(ACROSS, "log"),))
"""A log across the way, which is known as not drivable from the start: blocked."""
BROKEN = View(broken=True)
ELSEWHERE = View(turned=60.0)


@dataclass
class Autopilot:
    """An autopilot that obeys a mode command after `delay`, unless `deaf`. Its answers take as long.

    It sends a heartbeat at once on a change, else once a second. It refuses a mode that needs setpoints until
    it had them for half a second, and changes to RTL half a second after they end.
    """

    mode: int = AUTO
    armed: bool = True
    delay: float = 0.1
    compares: bool = False
    takes_resume: bool = True
    deaf: bool = False
    silent: bool = False
    travelled: float | None = None
    reboots: int = 0
    mission: Mission | None = None
    stands: bool = False
    brake: float = 0.0
    kind: KnownAutopilot | None = ardupilot.ROVER
    told: tuple[int, bool] | None = None
    beat_at: float = -1.0
    commands: list[tuple[float, int]] = field(default_factory=list)
    streamed_since: float | None = None
    streamed_at: float = -1.0

    def obey(self, now: float) -> None:
        """Change to the commanded modes whose time has come, in order."""
        streamed = self.kind.streamed if self.kind is not None else frozenset()
        while self.commands and self.commands[0][0] <= now:
            mode = self.commands.pop(0)[1]
            fed = self.streamed_since is not None and now - self.streamed_since >= 0.5
            self.mode = mode if fed or mode not in streamed else self.mode
        if self.mode in streamed and now - self.streamed_at > 0.5:
            self.mode = PX4_RTL

    def feed(self, now: float, *, on: bool) -> None:
        """Receive setpoints, or miss them."""
        if on:
            self.streamed_at = now
            self.streamed_since = self.streamed_since or now
        elif now - self.streamed_at > 0.5:
            self.streamed_since = None

    def beats(self, now: float) -> bool:
        """Whether a heartbeat goes out now."""
        if self.silent or (self.told == (self.mode, self.armed) and now - self.beat_at < 1.0):
            return False
        self.told, self.beat_at = (self.mode, self.armed), now
        return True


class Scene:
    """A rover on the trail. `run` lets time pass; `log` records each decision with its time."""

    def __init__(
        self,
        policy: Policy = Policy.REPORT,
        *,
        tile: float | None = 0.25,
        freshness: float = 1.0,
        mode: int = AUTO,
        armed: bool = True,
        fault_ends_hold: bool = False,
        now: float = 1000.0,
        kind: KnownAutopilot | None = ardupilot.ROVER,
        latency: float = 0.05,
    ) -> None:
        judging = Settings(thresholds=Thresholds(tile=tile), freshness=freshness)
        self.now = now
        self.numbers = Numbers(judging=judging, fault_ends_hold=fault_ends_hold)
        self.policy_state = PolicyState(policy)
        self.calls = OperatorCalls(self.numbers, self.policy_state, now)
        self.autopilot = Autopilot(mode, armed, kind=kind)
        self.words = {"trail": 1.0, "log": -1.0}
        self.reference = 0.0
        self.view = CLEAR
        self.camera = True
        self.latency = latency
        """Seconds from a frame's capture until it is judged."""
        self.frames: dict[int, View] = {}
        self.frame = 0
        self.due = now
        self.log: list[tuple[float, Decision]] = []

    def run(self, seconds: float, *views: View) -> list[Decision]:
        """Let time pass, and return the decisions. Frames show `views` in turn, or the last view."""
        before, end = len(self.log), self.now + seconds
        turn = 0
        while self.now < end - 1e-9:
            self.now = round(self.now + STEP, 6)
            self.autopilot.feed(self.now, on=self.calls.holding.streams)
            self.autopilot.obey(self.now)
            if self.autopilot.beats(self.now):
                self.hear()
            if self.camera and self.now >= self.due - 1e-9:
                self.due = self.now + PERIOD
                if views:
                    self.view = views[turn % len(views)]
                    turn += 1
                self.show(self.view)
            self.keep(self.calls.tick(self.now))
        return [decision for _, decision in self.log[before:]]

    def show(self, *views: View) -> list[Decision]:
        """Judge one frame for each view, a period apart, without ticks or heartbeats in between."""
        decisions: list[Decision] = []
        for view in views:
            self.now = round(self.now + (PERIOD if len(views) > 1 else 0.0), 6)
            self.frame += 1
            self.frames[self.frame] = view
            decisions += self.keep(self.calls.assessed(self.judged(self.frame), self.now))
        self.view = views[-1]
        return decisions

    def judged(self, number: int) -> Assessment:
        """Return a frame's assessment with the words in force."""
        return self.frames[number].assessed(
            number, self.words, self.numbers.judging, self.now, self.latency, self.reference
        )

    def hear(self) -> None:
        """Receive the autopilot's heartbeat."""
        pilot = self.autopilot
        report = ModeReport(
            pilot.mode,
            pilot.armed,
            pilot.travelled,
            self.now,
            pilot.kind,
            pilot.delay,
            pilot.compares,
            pilot.takes_resume,
            pilot.reboots,
            pilot.mission,
            pilot.stands,
            pilot.brake,
        )
        self.keep(self.calls.vehicle_reported(report, self.now))

    def human(self, mode: int, *, armed: bool = True) -> None:
        """Set the mode as a human would. The heartbeat reports it at once."""
        self.autopilot.commands.clear()
        self.autopilot.mode, self.autopilot.armed = mode, armed
        self.run(STEP)

    def keep(self, decisions: list[Decision]) -> list[Decision]:
        """Log the decisions, and send the modes to the autopilot."""
        for decision in decisions:
            self.log.append((self.now, decision))
            if isinstance(decision, SetMode) and not self.autopilot.deaf:
                self.autopilot.commands.append((self.now + self.autopilot.delay, decision.mode))
        return decisions

    def answer(
        self,
        motion: Motion = Motion.NONE,
        words: Mapping[str, float] | None = None,
        target: int | None = None,
    ) -> Result:
        """Give an operator's answer, by default to what is open, and apply it as the engine would."""
        call = self.calls.call
        self.words.update(words or {})
        teaches = bool(words) or motion is Motion.GO
        outcome = None
        if call is not None and self.calls.current_id == (target or self.calls.current_id):
            if teaches and self.view.turned == self.frames[call.frame_id].turned:
                self.reference = self.view.turned
            outcome = AnswerOutcome(self.judged(call.frame_id), self.judged(self.frame), remembered=teaches)
        elif words:
            outcome = AnswerOutcome(None, self.judged(self.frame))
        number = self.calls.current_id if target is None else target
        result, decisions = self.calls.apply_answer(
            number, motion, tuple(starmap(SetWord, (words or {}).items())), outcome, self.now
        )
        self.keep(decisions)
        return result

    def go(self, words: Mapping[str, float] | None = None) -> Result:
        """Answer "go", with or without words."""
        return self.answer(Motion.GO, words)

    def policy(self, policy: Policy) -> list[Decision]:
        """Set the policy."""
        return self.keep(self.requested(policy))

    def requested(self, policy: Policy) -> list[Decision]:
        """Request a policy, and return the decisions that it led to."""
        before = self.policy_state.in_force
        self.policy_state.request(policy, "255/190")
        return self.calls.policy_changed(before, self.now)

    def restarted(self) -> Scene:
        """Restart the daemon: a new state machine, restored from the snapshot of the old one."""
        kept = snapshot(self.calls)
        self.calls = OperatorCalls(self.numbers, self.policy_state, self.now)
        restore(self.calls, kept, self.now)
        self.autopilot.told = None
        return self

    def judge_again(self) -> None:
        """Judge the frame of the restored call, as the daemon does after a restart."""
        seen, call = self.judged(self.call.frame_id), self.call
        call.thing, call.seen = self.calls.reason_filter.things.asked(seen, frozenset(call.reasons))
        call.thing.call = call.id

    def all(self, kind: type[DecisionKind]) -> list[DecisionKind]:
        """Return all decisions of one kind so far."""
        return [decision for _, decision in self.log if isinstance(decision, kind)]

    def modes(self) -> list[int]:
        """Return the modes commanded so far."""
        return [decision.mode for decision in self.all(SetMode)]

    def events(self) -> list[HoldEvent]:
        """Return the events of holds so far."""
        return [moved.event for moved in self.all(HoldMoved)]

    def opened(self) -> list[int]:
        """Return the ids of the calls opened so far."""
        return [decision.call.id for decision in self.all(CallOpened)]

    def closed(self) -> list[tuple[int, Outcome]]:
        """Return the calls closed so far, with their outcomes."""
        return [(decision.call.id, decision.call.outcome) for decision in self.all(CallClosed)]

    def held(self) -> list[frozenset[Reason]]:
        """Return the reasons of the holds started so far."""
        return [decision.reasons for decision in self.all(HoldStarted)]

    @property
    def call(self) -> Call:
        """The open call."""
        assert self.calls.call is not None
        return self.calls.call

    @property
    def hold(self) -> Hold:
        """The hold that stands or is commanded."""
        assert self.calls.hold is not None
        return self.calls.hold
