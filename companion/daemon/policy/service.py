"""Changes the policy on request of a parameter, a command or the RC off switch."""

from __future__ import annotations

import logging
from collections.abc import Mapping

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.errors import SettingsError
from anytraverse.judging import Settings
from companion.calls.decisions import Decision
from companion.calls.faults import Fault
from companion.calls.machine import OperatorCalls
from companion.calls.policy import PolicyState
from companion.config.stopping import Stopping
from companion.daemon.policy.excess_speed import ExcessSpeed
from companion.daemon.policy.hold_gate import HoldConditions, HoldGate, HoldRefusal
from companion.daemon.settings.echo import BUSY, ParameterEcho
from companion.daemon.settings.runtime import tuned
from companion.link.inbound import PolicyRequest, RcChannels
from companion.link.link import Link
from companion.vehicle import ardupilot
from companion.vision.client import VisionClient
from companion.wire import notices
from companion.wire.ids import ERROR, WARNING, Policy, SenderId
from companion.wire.parameters import POLICY

log = logging.getLogger(__name__)

_ACCEPTED, _FAILED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_FAILED


class PolicyService:
    """The only way to change the policy. Each change is logged and reported with its sender.

    While hold is in force and cannot be given, that is a fault: the vehicle is held, and the policy stays.
    """

    def __init__(
        self,
        link: Link,
        vision: VisionClient,
        calls: OperatorCalls,
        state: PolicyState,
        gate: HoldGate,
        echo: ParameterEcho,
        guide_lacks: str,
    ) -> None:
        """guide_lacks: the setting without which policy guide is refused, "" for none."""
        self._link = link
        self._vision = vision
        self._calls = calls
        self.state = state
        self._gate = gate
        self._guide_lacks = guide_lacks
        self._judged_for: HoldConditions | None = None
        self._refusal: HoldRefusal | None = None
        self._fault: HoldRefusal | None = None
        """The refusal that was reported as a fault, None where none stands."""
        self._told_of_manual = False
        self._wanted = False
        """Whether an operator asked for hold last, and was refused."""
        self._echo = echo
        self._speed = ExcessSpeed(gate.configured_speed)
        self._reach_needed: float | None = None
        self._reach: float | None = None
        if state.switch is not None:
            link.request_rc_channels()

    @property
    def reminder(self) -> str:
        """The text to repeat while no call or hold is open, "" for none."""
        switch = self.state.switch
        if switch is not None and switch.lost:
            return notices.switch_lost(switch.name, off=switch.off)
        if misfit := self.judging.misfit:
            return notices.fault_region(misfit)
        return self._fault.reminder if self._fault is not None else ""

    @property
    def hold_refused(self) -> str:
        """Why a request for hold would be refused, as a STATUSTEXT; "" where it would not."""
        return self._refuses(Policy.HOLD)

    @property
    def guide_refused(self) -> str:
        """The same for guide."""
        return self._refuses(Policy.GUIDE)

    def _refuses(self, policy: Policy) -> str:
        """Return why a request for hold or guide would be refused, as a STATUSTEXT; "" where it would not.

        A request is judged by the newest frames, too: they need not have been slow for long.
        """
        guides = policy is Policy.GUIDE
        if guides and self._guide_lacks:
            return notices.guide_lacks(self._guide_lacks)
        known = self._known()._replace(step=self._vision.pace.newest, guides=guides)
        refusal = self._refusal or self._gate.refuses(known)
        return refusal.short if refusal is not None else ""

    @property
    def judging(self) -> Settings:
        """The settings that frames are judged by."""
        return self._calls.numbers.judging

    @property
    def reach(self) -> float | None:
        """`Frame.reach`. It does not get less while something is asked, held or accepted."""
        return self._reach if self.judging.metres is not None else None

    @property
    def stopping(self) -> Stopping | str:
        """Whether the vehicle stops in time at the speed that counts; a text where that is not known."""
        return self._gate.stopping(self._known())

    def figures(self) -> dict[str, object]:
        """Return the policy's part of the status file."""
        switch = self.state.switch
        info: dict[str, object] = {
            "in_force": self.state.in_force.name.lower(),
            "off_by": self.state.off_by or None,
        }
        if switch is None:
            return info
        return {**info, "switch": switch.name, "switch_us": switch.width, "switch_heard": not switch.lost}

    def set(self, policy: Policy, sender: SenderId, now: float) -> tuple[bool, list[Decision]]:
        """Handle a ground station's request for a policy. Returns whether it is granted.

        If not, a text says why.
        """
        who, before = f"{sender[0]}/{sender[1]}", self.state.in_force
        refusal = self._refuses(policy) if policy.holds else ""
        self._wanted = bool(refusal) and not self.state.requested.holds
        if not refusal and not self.state.request(policy, who):
            refusal = notices.switch_wins(self.state.off_by)
        if refusal:
            log.warning("policy %s requested by %s is refused: %s", policy.name.lower(), who, refusal)
            self._link.texts.send(refusal, WARNING, now)
        return not refusal, self._put_in_force(before, who, now, announce=not refusal)

    def command(self, request: PolicyRequest, now: float) -> list[Decision]:
        """Handle a request by command; it is acknowledged once the policy is in the journal."""
        accepted, decisions = self.set(request.policy, request.sender, now)
        result = _ACCEPTED if accepted else _FAILED
        self._echo.after_write(lambda _, now: self._link.commands.acknowledge(request, result, now))
        return decisions

    def tune(self, values: Mapping[str, float], what: str) -> str:
        """Judge frames by these values from now on. Returns why that is refused, "" where it is not.

        values: parameter name -> value. Where hold is requested, values with which the vehicle could not
        stop in time are refused.
        """
        try:
            other = tuned(self.judging, values)
        except SettingsError as error:
            return notices.refused(str(error))
        refusal = self._refuses_settings(other)
        if refusal is not None:
            log.warning("%s: %s", what, refusal.why)
            return notices.kept_for_hold(what, refusal.reason)
        if not self._vision.tune(other):
            return notices.refused(BUSY)
        self._calls.retune(other)
        return ""

    def _refuses_settings(self, judging: Settings) -> HoldRefusal | None:
        """Return why these settings are refused, None where they are allowed.

        Where hold is requested, settings that would take it away are refused, whether frames are judged as
        now or at once. What takes it away already may change, so that it can be mended in steps.
        """
        if not self.state.requested.holds:
            return None
        known = self._known()
        for step in (known.step, 0.0):
            refusal = self._gate.outruns(known._replace(judging=judging, step=step))
            if refusal is not None and self._gate.outruns(known._replace(step=step)) is None:
                return refusal
        return None

    def rc_channels_received(self, pulses: RcChannels, now: float) -> list[Decision]:
        """Take in the RC channels."""
        switch, before = self.state.switch, self.state.in_force
        if switch is None or not switch.pulse_received(pulses.of(switch.channel), now):
            return []
        log.warning("off switch %s: %s at %s us", switch.name, "OFF" if switch.off else "on", switch.width)
        # The switch is on now, but a request still keeps the companion off: the driver must know.
        if not switch.off and self.state.requested is Policy.OFF:
            self._link.texts.send(notices.still_off(switch.name, self.state.off_by), WARNING, now)
            return []
        return self._put_in_force(before, switch.name, now, announce=True)

    def tick(self, now: float) -> list[Decision]:
        """Check again whether hold can be given, and report when that or the off switch has changed."""
        self._follow_speed(now)
        decisions = self._check_hold(now)
        switch = self.state.switch
        if switch is not None and switch.check(now):
            # The operator must not rely on a switch while it is lost.
            told = (notices.switch_lost if switch.lost else notices.switch_heard)(switch.name, off=switch.off)
            log.warning("%s", told)
            self._link.texts.send(told, ERROR if switch.lost else WARNING, now)
        return decisions

    def _known(self) -> HoldConditions:
        autopilot = self._calls.monitor.newest.autopilot
        overrun = autopilot.overrun if autopilot is not None else 0.0
        step, misled = self._vision.pace.step, self._vision.misled_by_infrared
        guides = self.state.requested is Policy.GUIDE
        return HoldConditions(self.judging, step, overrun, self._speed.speed, guides, misled)

    def _follow_speed(self, now: float) -> None:
        vehicle, speed, monitor = self._link.vehicle, self._speed, self._calls.monitor
        before = speed.speed
        if not monitor.drives_itself(now) and self._calls.hold is None:
            speed.forget()
        elif vehicle is not None and vehicle.speed is not None and vehicle.position_at is not None:
            speed.reported(vehicle.speed, vehicle.position_at)
        if speed.speed != before:
            self._reach_needed = self._gate.reach(speed.speed)
        needed, answered = self._reach_needed, self._calls.reason_filter.things
        if not (self._calls.current_id or answered) or (needed or 0.0) > (self._reach or 0.0):
            self._reach = needed

    def _check_hold(self, now: float) -> list[Decision]:
        known = self._known()
        if known != self._judged_for:
            self._judged_for, self._refusal = known, self._gate.refuses(known)
        if self._wanted and not self.hold_refused:
            self._wanted = False
            self._link.texts.send(notices.hold_fits(), WARNING, now)
        return self._report_fault(now)

    def _report_fault(self, now: float) -> list[Decision]:
        """Report it as a fault that hold is in force and cannot be given, and when that is over."""
        before, self._fault = self._fault, self._refusal if self.state.in_force.holds else None
        self._tell_of_manual(now)
        what, told = (one.fault if one is not None else "" for one in (self._fault, before))
        if what == told:
            return []
        decisions = self._calls.fault_reported(Fault.POLICY, what, now)
        if self._fault is not None:
            log.error("%s", self._fault.why)
            if self._calls.current_id:
                # The hold is repeated instead of the reminder, and does not say what to do.
                self._link.texts.send(self._fault.reminder, ERROR, now)
        elif self.state.in_force.holds:
            log.warning("hold can be given again")
        return decisions

    def _tell_of_manual(self, now: float) -> None:
        """Say once in a fault what arming may need: the autopilot's script may demand a companion without."""
        if self._fault is None:
            self._told_of_manual = False
        elif not self._told_of_manual and self._calls.monitor.newest.autopilot is ardupilot.ROVER:
            self._told_of_manual = True
            self._link.texts.send(notices.manual_may_need(), WARNING, now)

    def _put_in_force(self, before: Policy, who: str, now: float, *, announce: bool) -> list[Decision]:
        policy, decisions = self.state.in_force, self._calls.policy_changed(before, now)
        if not policy.holds:
            # A mode that still waits to be sent must not leave under the new policy.
            self._link.modes.cancel()
        if announce:
            log.warning("policy %s, set by %s", policy.name.lower(), who)
            self._link.texts.send(notices.policy(policy, who), WARNING, now)
        what = f"policy {policy.name.lower()}" if announce else ""
        self._echo.send_after_write(POLICY, float(policy), what)
        return decisions + self._report_fault(now)
