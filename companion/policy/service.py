"""Changes the policy on request of a parameter, a command or the RC off switch."""

from __future__ import annotations

import logging
from collections.abc import Callable

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.judging import Settings
from companion.calls.decisions import Decision
from companion.calls.machine import OperatorCalls
from companion.calls.policy import PolicyState
from companion.link.inbound import PolicyRequest, RcChannels
from companion.link.link import Link
from companion.policy.hold_gate import HoldRefusal, Refuses
from companion.vehicle import Autopilot
from companion.wire import notices
from companion.wire.ids import ERROR, WARNING, Policy, SenderId
from companion.wire.parameters import POLICY

log = logging.getLogger(__name__)

AfterWrite = Callable[[Callable[[bool, float], None]], None]
"""Registers a callback for when this turn's changes are in the journal: see `Persistence.after_write`."""


_ACCEPTED, _FAILED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_FAILED


class PolicyService:
    """The only way to change the policy. Each change is logged and reported with its sender."""

    def __init__(
        self,
        link: Link,
        calls: OperatorCalls,
        state: PolicyState,
        after_write: AfterWrite,
        *,
        refuses: Refuses,
    ) -> None:
        self._link = link
        self._calls = calls
        self.state = state
        self._refuses = refuses
        self._judged_for = calls.numbers.judging, 0.0, False
        self._refusal = refuses(*self._judged_for)
        self._after_write = after_write
        if state.switch is not None:
            link.request_rc_channels()

    @property
    def reminder(self) -> str:
        """The text to repeat while no call or hold is open, "" for none."""
        switch = self.state.switch
        if switch is not None and switch.lost:
            return notices.switch_lost(switch.name, off=switch.off)
        return self._refusal.reminder if self._refusal is not None and self.state.wants_hold else ""

    @property
    def hold_refused(self) -> str:
        """Why the policy hold is refused, as a STATUSTEXT; "" where it is allowed."""
        return self._refusal.short if self._refusal is not None else ""

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
        refusal = self.hold_refused if policy is Policy.HOLD else ""
        if not refusal and not self.state.request(policy, who):
            refusal = notices.switch_wins(self.state.off_by)
        if refusal:
            log.warning("policy %s requested by %s is refused: %s", policy.name.lower(), who, refusal)
            self._link.send_text(refusal, WARNING, now)
        return not refusal, self._put_in_force(before, who, now, announce=not refusal)

    def command(self, request: PolicyRequest, now: float) -> list[Decision]:
        """Handle a request by command; it is acknowledged once the policy is in the journal."""
        accepted, decisions = self.set(request.policy, request.sender, now)
        result = _ACCEPTED if accepted else _FAILED
        self._after_write(lambda _, now: self._link.commands.acknowledge(request, result, now))
        return decisions

    def check_hold_again(
        self, autopilot: Autopilot | None, now: float, *, misled_by_infrared: bool
    ) -> list[Decision]:
        """Check again whether the vehicle may be held, where autopilot, settings or camera have changed.

        A hold policy that is not allowed any more is changed to report.
        """
        overrun = autopilot.overrun if autopilot is not None else 0.0
        known = self._calls.numbers.judging, overrun, misled_by_infrared
        if known == self._judged_for:
            return []
        refused, self._judged_for, self._refusal = self._refusal, known, self._refuses(*known)
        if self._refusal is None:
            if refused is not None:
                self._link.send_text(notices.hold_fits(), WARNING, now)
            return []
        before, given_up = self.state.in_force, self.state.give_up_hold()
        if self.state.wants_hold:
            log.error("%s", self._refusal.why)
        if not given_up:
            return []
        decisions = self._put_in_force(before, "", now, announce=False)
        self._link.send_text(self._refusal.short, ERROR, now)
        return decisions

    def refuses_settings(self, judging: Settings) -> HoldRefusal | None:
        """Return why these settings are refused, None where they are allowed.

        They are refused where hold is requested, and could not be allowed with them.
        """
        if self.state.requested is not Policy.HOLD:
            return None
        return self._refuses(judging, *self._judged_for[1:])

    def rc_channels_received(self, pulses: RcChannels, now: float) -> list[Decision]:
        """Take in the RC channels."""
        switch, before = self.state.switch, self.state.in_force
        if switch is None or not switch.pulse_received(pulses.of(switch.channel), now):
            return []
        log.warning("off switch %s: %s at %s us", switch.name, "OFF" if switch.off else "on", switch.width)
        # The switch is on now, but a request still keeps the companion off: the driver must know.
        if not switch.off and self.state.requested is Policy.OFF:
            self._link.send_text(notices.still_off(switch.name, self.state.off_by), WARNING, now)
            return []
        return self._put_in_force(before, switch.name, now, announce=True)

    def tick(self, now: float) -> None:
        """Report when the off switch is lost or back. The operator must not rely on it while it is lost."""
        switch = self.state.switch
        if switch is None or not switch.check(now):
            return
        text = (notices.switch_lost if switch.lost else notices.switch_heard)(switch.name, off=switch.off)
        log.warning("%s", text)
        self._link.send_text(text, ERROR if switch.lost else WARNING, now)

    def _put_in_force(self, before: Policy, who: str, now: float, *, announce: bool) -> list[Decision]:
        policy, decisions = self.state.in_force, self._calls.policy_changed(before, now)
        if policy is not Policy.HOLD:
            # A mode that still waits to be sent must not leave under the new policy.
            self._link.modes.cancel()
        if announce:
            log.warning("policy %s, set by %s", policy.name.lower(), who)
            self._link.send_text(notices.policy(policy, who), WARNING, now)
        self._after_write(lambda _, now: self._link.parameters.set_value(POLICY, float(policy), now))
        return decisions
