"""Runs the daemon's main loop: receive, decide, carry out, store, tell, send.

50 times a second and whenever data arrives.
"""

from __future__ import annotations

import time
from typing import NamedTuple

from companion.calls.machine import OperatorCalls
from companion.calls.mode_monitor import ModeAnswer
from companion.daemon.executor import DecisionExecutor
from companion.daemon.guiding import GuideService
from companion.daemon.health import HealthMonitor, StallDetector
from companion.daemon.policy.service import PolicyService
from companion.daemon.reports import VehicleReports, VisionResults
from companion.daemon.requests import Requests
from companion.daemon.startup import wait
from companion.daemon.trial_call import TrialCall
from companion.daemon.turn import Observers, Reminder, Turn, kind_of
from companion.guide.rules import GuideAnswer
from companion.link.inbound import InboundEvent, VehicleUpdate
from companion.link.link import Link
from companion.system.computer import Computer
from companion.vehicle.ardupilot import ScriptHold
from companion.vision.client import VisionClient
from companion.vision.messages import Planned
from companion.wire import notices
from companion.wire.ids import WARNING, Policy, State

TICK = 0.02
_SHORTEST_TURN = 0.005
"""Seconds between two turns, at least: a flood of datagrams must not cause a turn for each of them."""
_LEAVE_WITHIN = 4.0


class Deciders(NamedTuple):
    """What has something decided: on requests, on reports of autopilot and vision, or because time passes.

    computer: a hot one lowers the rate of judging. Another thread measures it: a sensor may take its time.
    """

    requests: Requests
    vehicle: VehicleReports
    guide: GuideService
    results: VisionResults
    policy: PolicyService
    test_call: TrialCall
    health: HealthMonitor
    computer: Computer


class Daemon:
    """Connects the parts of the supervisor, which do not know each other.

    `turn` is one round of the main loop and waits for at most `TICK` seconds. An exception while an event or
    a result is handled, or a decision carried out, is logged and reported, and so is one of an observer. One
    in the state machine ends the daemon, whichever input led to it: half of a change may have happened, so
    what it decides is not known to be right. A restart begins with a state that is: the journal's. Before
    that `death` holds the vehicle.
    """

    def __init__(
        self,
        link: Link,
        vision: VisionClient,
        calls: OperatorCalls,
        executor: DecisionExecutor,
        deciders: Deciders,
        observers: Observers,
    ) -> None:
        """observers: are told of each turn, once all is decided and queued for the disk."""
        self._link = link
        self._vision = vision
        self._calls = calls
        self._executor = executor
        self._deciders = deciders
        self._observers = observers
        self._guard = executor.error_guard
        self._turned_at = now = time.monotonic()
        self._stall_detector = StallDetector(link, calls, now)
        self._state = State.STARTING

    def turn(self) -> None:
        """Handle everything that was received, decide, carry it out, queue it for the disk, and send.

        Never waits for a disk.
        """
        self._wait()
        now = time.monotonic()
        # Checked twice in a turn: before anything is received, and before anything is sent, because the
        # process may be stopped at any point between.
        self._stall_detector.check(now)
        self._receive(now)
        # A hold that the events led to is sent before anything else, which may take its time.
        self._executor.send_hold_now(now)
        self._poll_vision(now)
        self._deciders.requests.acknowledge_stored(now)
        self._let_time_pass(now)
        self._set_state(now)
        self._deciders.requests.store(self._vision.memory, now)
        self._observers.see(self._made(now))
        self._stall_detector.check(time.monotonic())
        if self._link.modes.resume_waits:
            # What came meanwhile may say that a human has set another mode.
            self._receive(now)
            if self._executor.events:
                self._observers.see(self._made(now))
        self._link.tick(now)

    def sees_or_reports_fault(self, now: float) -> bool:
        """Whether the turn was a sound one: the link sends, and what it reports of the view is true.

        Without fresh judged frames the heartbeat must say fault or off. The watchdog counts on this.
        """
        if self._link.sent_at < self._turned_at:
            return False
        return self._calls.reason_filter.fresh(now) or self._state in (State.FAULT, State.OFF)

    def release(self) -> None:
        """Hand a hold that needs our setpoint stream over to the autopilot's own mode, before the end."""
        until = time.monotonic() + _LEAVE_WITHIN
        self._calls.holding.release(time.monotonic())
        while self._calls.holding.offboard_release is not None and time.monotonic() < until:
            self.turn()

    def _wait(self) -> None:
        rest = min(_SHORTEST_TURN, TICK) - (time.monotonic() - self._turned_at)
        if rest > 0:
            time.sleep(rest)
        wait(self._link, self._vision, min(TICK, self._link.wait(time.monotonic())))
        self._turned_at = time.monotonic()

    def _receive(self, now: float) -> None:
        for event in self._link.poll(now):
            self._executor.events.append(event)
            with self._guard.survived(type(event).__name__, now):
                self._handle(event, now)

    def _handle(self, event: InboundEvent, now: float) -> None:
        match event:
            case VehicleUpdate(vehicle):
                self._executor.carry_out(self._deciders.vehicle.received(vehicle, now), now)
            case ScriptHold():
                self._calls.monitor.script_hold_reported(event)
            case GuideAnswer():
                if (known := self._link.vehicle) is not None:  # its mode may be known by the answer
                    self._executor.carry_out(self._deciders.vehicle.received(known, now), now)
                self._deciders.guide.answered(event, now)
            case ModeAnswer():
                self._executor.carry_out(self._calls.mode_answered(event, now), now)
            case _:
                self._deciders.requests.received(event, now)

    def _poll_vision(self, now: float) -> None:
        vehicle = self._deciders.vehicle
        self._vision.rate.tick(now, self._deciders.computer.newest)
        newest = self._link.vehicle
        motion = newest.motion if newest is not None else None
        reach = self._deciders.policy.reach
        place, moving = vehicle.position.place(), vehicle.moves(now)
        errand = self._deciders.guide.errand
        self._vision.situation(place, motion, now, moving=moving, reach=reach, errand=errand)
        for result in self._vision.poll(now):
            self._executor.events.append(result)
            with self._guard.survived(kind_of(result).__name__, now):
                if isinstance(result.report, Planned):
                    self._deciders.guide.planned(result.report.content, now)
                self._deciders.results.received(result, now)

    def _let_time_pass(self, now: float) -> None:
        self._executor.carry_out(self._deciders.vehicle.check_course(now), now, at_once=True)
        self._deciders.guide.tick(now)
        self._deciders.health.check(now)
        self._executor.carry_out(self._deciders.policy.tick(now), now, at_once=True)
        self._executor.carry_out(self._calls.tick(now), now, at_once=True)
        self._deciders.test_call.tick(now)

    def _set_state(self, now: float) -> None:
        """Set what the link sends to the autopilot and its script. No observer is needed for that."""
        calls, link = self._calls, self._link
        link.setpoints.on = calls.holding.streams
        if calls.hold is not None:  # one that leaves behind the command to hold would end the script's brake
            link.setpoints.target = None
        link.dead_man.on = calls.policy.holds and calls.holding.in_charge(now)
        self._state = calls.state(now)
        open_id = calls.current_id or self._deciders.test_call.id
        link.set_state(
            self._state,
            open_id,
            calls.policy,
            fault_accepted=calls.fault_accepted(now),
            braking=calls.hold is not None and calls.hold.braking,
            guiding=self._deciders.guide.guides,
        )

    def _made(self, now: float) -> Turn:
        """Make the record of this turn."""
        calls, health, events = self._calls, self._deciders.health, tuple(self._executor.events)
        self._executor.events.clear()
        return Turn(
            now=now,
            state=self._state,
            policy=calls.policy,
            current_id=calls.current_id,
            words=self._vision.words,
            weak=self._vision.weak,
            place=self._deciders.vehicle.position.place(),
            vehicle=self._link.vehicle,
            link_trouble=self._link.trouble or "",
            computer=self._deciders.computer.newest,
            silent=health.silent(now),
            fault=health.fault(now),
            reminder=self._reminder(),
            test_call=self._deciders.test_call.status,
            events=events,
        )

    def _reminder(self) -> Reminder:
        """Return the most urgent text to repeat while nothing is open."""
        policy, health = self._deciders.policy, self._deciders.health
        if (trial := self._deciders.test_call.reminder) is not None:
            return trial
        if self._calls.policy is Policy.OFF:
            return Reminder(notices.off(policy.state.off_by))
        if text := health.reminder():
            return Reminder(text)
        if self._calls.policy.holds and (text := self._link.dead_man.reminder):
            return Reminder(text, quiet=True)
        return Reminder(policy.reminder, WARNING, quiet=True)
