"""Drives one route under one policy: the simulated rover, the companion's rules, a stand-in for the wire."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from random import Random
from typing import cast
from unittest import mock

import cv2
import numpy as np

from anytraverse.engine import AnyTraverse
from anytraverse.errors import AnyTraverseError
from anytraverse.memory import first_memory
from anytraverse.operations import SetWord, Tap
from bench.calls.engines import of_the_field
from bench.calls.field import DRIVABLE, FilmedField
from bench.field_drive.autopilot import ScriptedAutopilot
from bench.field_drive.eyes import JUDGED, Eyes, Filmed
from bench.field_drive.operator_model import BY_HAND, IN_VIEW, STOOD, TAKEN, OperatorModel
from bench.field_drive.scoring import DriveResult, Score
from bench.field_drive.trails import VEHICLE, FieldRoute, Placed, make_route
from bench.field_drive.truth import NamingPerceiver
from bench.field_drive.wire import WireStandIn, waypoints
from bench.virtual_time import Clock
from companion.calls.decisions import CallOpened, Decision, HoldRenamed, HoldStarted, SetMode
from companion.calls.machine import OperatorCalls
from companion.calls.policy import PolicyState
from companion.config import Config
from companion.config.stopping import Stopping, judge_stopping, longest_brake
from companion.daemon.guiding import GuideService
from companion.daemon.settings.runtime import call_numbers
from companion.desk.drives.judge import DriveJudge
from companion.guide.plan import Plan
from companion.guide.rules import GuideAnswer
from companion.link.link import Link
from companion.sim.field.motion import RoverMotion
from companion.sim.field.rover import STANDSTILL, Body, Rover
from companion.vehicle import ardupilot
from companion.vehicle.brakes import Measured, fit
from companion.vision.warm_up import judging_settings, load_engine
from companion.wire.answers import Answer
from companion.wire.ids import Motion, Policy

RATE, SPEED = 5.0, 1.2
"""Frames/s that are judged, and m/s of the mission."""
TICK = 0.04
"""s from one turn of the companion to the next."""
LONGEST = 600.0
"""s after which a drive ends."""
POLICIES = {"report": Policy.REPORT, "hold": Policy.HOLD, "guide": Policy.GUIDE}


def field_config(policy: str = "hold", *, puddles: bool = False) -> Config:
    """Return the demo's configuration for a vehicle 0.6 m wide, with words for gravel and puddles.

    The script on its autopilot brakes before it holds. puddles: whether they are drivable.
    """
    config = of_the_field(RATE, SPEED)
    words = {**config.words, "gravel": 1.0, "puddle": 1.0 if puddles else -1.0}
    mount = replace(config.mount, width=VEHICLE, front=VEHICLE / 2)
    body, brake = Body(), fit(_brakes(Body()), "brake")
    stops = replace(
        config.stopping,
        hold_by="brake",
        brake_time_constant=brake.time_constant,
        brake_braking=brake.braking,
    )
    radius = body.wheelbase / math.tan(body.max_steering)
    guide, call = replace(config.guide, radius=radius), replace(config.call, policy=policy)
    return replace(config, mount=mount, words=words, stopping=stops, guide=guide, call=call)


def _brakes(body: Body) -> Iterator[Measured]:
    """Yield stops of the simulated rover by the brake in GUIDED, from several speeds."""
    linear, rest = body.stopping, body.stopping_rest
    for speed in (0.4, 0.8, 1.2, 1.6):
        yield Measured(speed, speed / linear - rest / linear**2 * math.log(1.0 + linear * speed / rest))


def stopping(latency: float) -> float:
    """Return the metres to standstill from when a thing can be seen, as `companion check` has them."""
    config = field_config()
    judged = judge_stopping(replace(config, camera=replace(config.camera, latency=JUDGED + latency)))
    assert isinstance(judged, Stopping)
    return judged.needs


def engine_of(config: Config, *, truth: bool) -> AnyTraverse:
    """Return an engine with a new memory. truth: it perceives by the true labels."""
    cv2.setNumThreads(1)
    if not truth:
        return load_engine(config, None)[0]
    perceiver = NamingPerceiver()
    settings = judging_settings(config, perceiver)
    return AnyTraverse(perceiver, settings, first_memory(perceiver.model_id, config.preferences))


class FieldDrive:
    """One drive. Times are those of the clock in s, lengths in m."""

    def __init__(
        self, route: FieldRoute, film: FilmedField, policy: str, clock: Clock, *, truth: bool
    ) -> None:
        config = field_config(policy, puddles=route.puddles)
        self._route, self._film, self._clock, self._policy = route, film, clock, policy
        self._engine = engine_of(config, truth=truth)
        random = Random(f"{route.seed} {policy}")
        motion = RoverMotion(route.world.trail, route.seed, swing=math.radians(route.swing))
        self._rover = Rover(
            route.world.trail, cruise_speed=SPEED, body=Body(radius=VEHICLE / 2), motion=motion
        )
        self._autopilot = ScriptedAutopilot(self._rover, random, longest_brake(config))
        items = waypoints(route.world.trail, route.begin, route.metres)
        self._wire = WireStandIn(self._autopilot, items)
        self._eyes = Eyes(self._engine, film, self._rover, clock, rate=RATE, late=route.latency)
        numbers = call_numbers(config, self._engine.settings)
        self._calls = OperatorCalls(numbers, PolicyState(POLICIES[policy]), clock.now)
        self._guide = GuideService(config, cast(Link, self._wire), self._calls)
        judge = DriveJudge(config, self._engine)
        self._operator = OperatorModel(film, judge, random, puddles=route.puddles)
        self._score = Score(policy, route)
        self._stands = 0.0
        self._gone = set[str]()
        """Ids of what has appeared: it may have been taken away since."""
        self._newest: Filmed | None = None

    def run(self) -> DriveResult:
        """Drive to the end of the route, or until it stands before what nobody takes away."""
        begun, stood = self._clock.now, False
        while self._progress < self._route.metres and not stood:
            self._clock.now += TICK
            self._appear()
            for answer in self._autopilot.step():
                if isinstance(answer, GuideAnswer):
                    self._guide.answered(answer, self._clock.now)
                else:
                    self._obey(self._calls.mode_answered(answer, self._clock.now))
            self._rover.step(TICK)
            self._watch()
            self._turn()
            stood = self._help() or self._clock.now - begun > LONGEST
        found = self._score.ended(stood=stood, seconds=self._clock.now - begun)
        found.overrides, found.takeovers = self._autopilot.overrides, self._autopilot.takeovers
        return found

    @property
    def _progress(self) -> float:
        return self._rover.progress

    def _appear(self) -> None:
        """Put down what the rover is near enough to."""
        world, front = self._route.world, self._progress + self._rover.body.radius
        for one in self._route.placed:
            (thing, *_), away = one.things, one.s - self._route.begin - front
            near = one.appears is not None and 0.0 < away - thing.radius <= one.appears
            if near and thing.id not in world.things and thing.id not in self._gone:
                world.add(thing)
                self._gone.add(thing.id)

    def _watch(self) -> None:
        rover, trail = self._rover, self._route.world.trail
        self._score.touched(self._route.world.contact(rover.x, rover.y, rover.body.radius))
        s, aside = trail.nearest(rover.x, rover.y)
        edge = float(trail.half_width(np.array(s))) - abs(aside) - rover.body.radius
        self._score.moved(self._progress, edge)
        self._stands = self._stands + TICK if rover.speed < STANDSTILL else 0.0

    def _turn(self) -> None:
        """Let the companion take in what has come, and decide."""
        now, calls = self._clock.now, self._calls
        if self._eyes.feel(quick=self._wire.quick):
            self._wire.heard(self._eyes.motion, now)
        self._obey(calls.vehicle_reported(self._autopilot.report(now), now))
        for filmed, report in self._eyes.look():
            if isinstance(report, Plan):
                self._guide.planned(report, now)
            else:
                self._obey(calls.assessed(report.assessment, now), filmed)
        self._guide.tick(now)
        self._eyes.errand = self._guide.errand
        self._obey(calls.tick(now))
        self._autopilot.target(None if calls.hold is not None else self._wire.setpoints.target)
        self._score.id_is(calls.current_id, self._progress)

    def _obey(self, decisions: list[Decision], filmed: Filmed | None = None) -> None:
        for one in decisions:
            match one:
                case SetMode():
                    self._autopilot.request(one)
                case HoldStarted():
                    self._score.held(self._progress)
                case HoldRenamed(old):
                    self._score.renamed(old)
                case CallOpened(call):
                    self._newest = filmed or self._newest
                    assert self._newest is not None
                    self._film.look_back(self._newest.labels, self._newest.pose)
                    self._operator.called(call, self._newest.frame, self._clock.now)
        self._newest = filmed or self._newest

    def _help(self) -> bool:
        """Let operator and helper act. Return whether the rover has ended here."""
        now, current = self._clock.now, self._calls.current_id
        way = self._score.in_way(self._progress)
        room = way is not None and way.room and not self._score.touches(way)
        call = self._calls.call
        asks = call is not None and not call.answered
        sees = room and way is not None and self._stands > 0.0 and self._before(way) >= IN_VIEW
        passes = self._calls.reason_filter.passes
        said = self._operator.says(
            current, self._stands, now, way=way is not None, room=sees, asks=asks, passes=passes
        )
        if said is not None:
            self._answer(said)
        if self._operator.thinks:
            return False
        if way is not None and not room and self._stands >= TAKEN:
            for thing in way.things:
                self._route.world.remove(thing.id)
            self._score.result.taken += 1
            self._stands = 0.0
        elif way is None and self._stands >= BY_HAND and self._autopilot.mode != ardupilot.AUTO:
            self._autopilot.by_hand(ardupilot.AUTO)
            self._score.result.by_hand += 1
            self._stands = 0.0
        return way is not None and self._stands >= STOOD

    def _before(self, one: Placed) -> float:
        """Return the m from the rover's front to the thing."""
        front = self._progress + self._rover.body.radius
        return one.s - self._route.begin - front - one.things[0].radius

    def _answer(self, said: Answer) -> None:
        now, call, go = self._clock.now, self._calls.call, said.motion is Motion.GO
        operations = tuple(one for one in said.operations if isinstance(one, SetWord | Tap))
        seen = call.seen.observation if call is not None and call.seen is not None else None
        place = call.place if call is not None else self._film.place(self._rover.pose)
        try:
            outcome = self._engine.answer(operations, now, call=seen, call_id=said.target, go=go, place=place)
        except AnyTraverseError:  # what it cannot learn is said without words
            operations, motion = (), Motion.NONE
            outcome = self._engine.answer((), now, call=seen, call_id=said.target, go=False, place=place)
            said = replace(said, motion=motion)
        _, decisions = self._calls.apply_answer(said.target, said.motion, operations, outcome, now)
        self._obey(decisions)


def drive_all(
    seed: int,
    policies: tuple[str, ...],
    *,
    truth: bool,
    metres: float | None = None,
    size: tuple[int, int] = (320, 240),
) -> list[DriveResult]:
    """Drive one seed's route under each of the policies. metres: of its begin only. size: of the picture."""
    route, found = make_route(seed, stopping), list[DriveResult]()
    route = route if metres is None else replace(route, metres=metres)
    drivable = (*DRIVABLE, *(["puddle"] if route.puddles else []))
    film, there = FilmedField(route.world, drivable=drivable, size=size), dict(route.world.things)
    for policy in policies:
        route.world.things = dict(there)
        route.world.revision += 1
        clock = Clock()
        with mock.patch("time.monotonic", clock):
            found.append(FieldDrive(route, film, policy, clock, truth=truth).run())
    return found
