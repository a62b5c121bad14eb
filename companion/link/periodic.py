"""Sends heartbeat, summary, numbers and the computer's figures at their rates, always the newest values.

They leave room in the byte budget for a call, and the last two leave room for the summary.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from companion.link import encode
from companion.link.sender import Sender
from companion.wire.ids import TUNNEL_SUMMARY, HeartbeatMode, Policy, State
from companion.wire.messages import MESSAGES, NUMBERS, SUMMARY_PERIOD_WHILE_CALLING
from companion.wire.payloads import Summary

_STATE_GAP = 0.25
_NUMBER_LIFETIME = 5.0
_PATIENCE = 0.3
"""s to wait for a newer frame's summary when one is due."""
_BEFORE, _AFTER = 0.05, 0.15
"""s before and after a summary is due, in which less urgent frames wait: the pace would delay the summary."""
_RECENT = 1.0
"""s without a new summary after which none is expected."""
_TOLERANCE = 1e-6
_OLDEST = 0xFFFF
"""ms: the greatest frame age that a summary can carry."""
_CALL_RESERVE = MESSAGES["call text"].bytes + MESSAGES["call data"].bytes
_SUMMARY_RESERVE = _CALL_RESERVE + MESSAGES["summary"].bytes


def _period(name: str) -> float:
    period = MESSAGES[name].period
    assert period is not None
    return period


class PeriodicTelemetry:
    """Queues the periodic messages of one connection; rates come from the message table.

    periods: s between summaries ("summary") and between two of the same number ("number"); may be changed,
    `math.inf` for never. dropped: summaries not sent for lack of budget.
    """

    def __init__(self, sender: Sender, now: float) -> None:
        self._sender = sender
        self._started = now
        self._content = HeartbeatMode(State.STARTING, 0, Policy.REPORT)
        self._heartbeat_at = -math.inf
        self._heartbeat_now = False
        self._summary: tuple[Summary, float] | None = None
        self._newest: tuple[Summary, float] | None = None
        self._summary_at = -math.inf
        self._sequence = 0
        self.dropped = 0
        self._numbers: dict[str, float] = {}
        self._numbers_at = -math.inf
        self._computer: tuple[Mapping[str, Any], float] = {}, now
        self._computer_at = -math.inf
        self.periods = {"summary": _period("summary"), "number": _period("number")}
        # The numbers take turns within their period, so that they do not all want the wire at once.
        step = _period("number") / len(NUMBERS)
        self._number_at = {name: now + (place - len(NUMBERS)) * step for place, name in enumerate(NUMBERS)}

    def set_state(self, content: HeartbeatMode) -> None:
        """Set the heartbeat's content; a change is sent at once, at most four times a second."""
        if content != self._content:
            if content.guiding and not self._content.guiding:
                self.send_heartbeat_now()  # before the request for GUIDED, which follows
            self._content = content
            self._heartbeat_now = True

    def newest_heartbeat(self) -> Any:
        """The heartbeat as it is now, for a client that requests it."""
        return encode.heartbeat(self._content)

    def newest_summary(self, to: tuple[int, int], now: float) -> Any | None:
        """The newest summary for `to`, with the last broadcast one's sequence number; None before any."""
        if self._newest is None:
            return None
        return self._encoded(*self._newest, (self._sequence - 1) & 0xFFFF, now, to)

    def newest_numbers(self, now: float) -> list[Any]:
        """The newest numbers, for a client that requests them."""
        filled = [name for name in NUMBERS if name in self._numbers]
        return [encode.number(name, self._numbers[name], self._uptime(now)) for name in filled]

    def send_heartbeat_now(self) -> None:
        """Make the next heartbeat due now, after a reconnect or when the autopilot is back."""
        self._heartbeat_at = -math.inf

    def summary(self, summary: Summary, now: float) -> None:
        """Set the newest summary."""
        self._summary = self._newest = (summary, now)

    def numbers(self, values: Mapping[str, float], now: float) -> None:
        """Set the newest numbers; those that are not finite are left out."""
        self._numbers = {name: value for name, value in values.items() if math.isfinite(value)}
        self._numbers_at = now

    def computer(self, figures: Mapping[str, Any], now: float) -> None:
        """Set the newest figures of `Computer.measure`."""
        if figures is not self._computer[0]:
            self._computer = figures, now

    def tick(self, now: float, *, calling: bool, resuming: bool = False) -> None:
        """Queue what is due. calling: whether a call or hold is open.

        resuming: a resume waits. The script must hear of the end of a fault before it, or it holds again.
        """
        period = self.periods["summary"]
        if calling:
            period = max(period, SUMMARY_PERIOD_WHILE_CALLING)
        awaited = self._awaits_summary(now, period)
        self._summary_tick(now, period)
        silent = now - self._heartbeat_at + _TOLERANCE
        beat = _period("heartbeat") + (_BEFORE + _AFTER if awaited else 0.0)
        if (self._heartbeat_now and resuming) or silent >= (_STATE_GAP if self._heartbeat_now else beat):
            self._heartbeat_at, self._heartbeat_now = now, False
            self._sender.push("heartbeat", encode.heartbeat(self._content), now, key=0, lifetime=1.0)
        if calling or awaited:
            return
        if now - self._numbers_at < _NUMBER_LIFETIME:
            self._send_numbers(now)
        self._send_computer(now)

    def _awaits_summary(self, now: float, period: float) -> bool:
        """Whether a summary is due about now; less urgent messages then wait for it."""
        if self._newest is None or now - self._newest[1] > _RECENT:
            return False
        return -_BEFORE <= now - self._summary_at - period <= _AFTER

    def _summary_tick(self, now: float, period: float) -> None:
        """Send the first summary that comes after one is due; after 0.3 s without one, send the older one."""
        due = self._summary_at + period - _TOLERANCE
        if self._summary is None or now < due:
            return
        _, given_at = self._summary
        if given_at >= due or now >= due + _PATIENCE:
            self._send_summary(*self._summary, now)
            # After a small delay the schedule stays as it was; after a pause a new one begins.
            self._summary_at = due if now - due <= _PATIENCE else now

    def _send_summary(self, summary: Summary, given_at: float, now: float) -> None:
        self._summary = None
        if not self._sender.has_room("summary", now, reserve=_CALL_RESERVE):
            self.dropped += 1
            return
        message = self._encoded(summary, given_at, self._sequence, now)
        self._sequence = (self._sequence + 1) & 0xFFFF
        self._sender.push("summary", message, now, key=0, lifetime=1.0)

    def _encoded(
        self, summary: Summary, given_at: float, sequence: int, now: float, to: tuple[int, int] = (0, 0)
    ) -> Any:
        age = min(_OLDEST, summary.frame_age_ms + round((now - given_at) * 1000))
        filled = replace(summary, sequence=sequence, dropped=self.dropped, frame_age_ms=age)
        return encode.tunnel(TUNNEL_SUMMARY, filled.pack(), to)

    def _uptime(self, now: float) -> int:
        return round((now - self._started) * 1000)

    def _send_numbers(self, now: float) -> None:
        period = self.periods["number"]
        for name in NUMBERS:
            due = self._number_at[name] + period
            if name not in self._numbers or now < due:
                continue
            self._number_at[name] = now if now - due > period else due
            if self._sender.has_room("number", now, reserve=_SUMMARY_RESERVE):
                message = encode.number(name, self._numbers[name], self._uptime(now))
                self._sender.push("number", message, now, key=name, lifetime=1.0)

    def _send_computer(self, now: float) -> None:
        figures, measured_at = self._computer
        due = now - self._computer_at >= _period("computer") and now - measured_at < _NUMBER_LIFETIME
        if due and figures and self._sender.has_room("computer", now, reserve=_SUMMARY_RESERVE):
            self._computer_at = now
            self._sender.push("computer", encode.computer_status(figures, now), now, key=0, lifetime=1.0)
