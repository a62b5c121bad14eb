"""Tracks the state of one rover from the messages of its companion and its autopilot. No I/O, no clock."""

from __future__ import annotations

import math
import re
from collections import deque
from dataclasses import dataclass, field, replace

from pymavlink.dialects.v20.common import MAV_SEVERITY_WARNING

from companion.wire.answers import Acknowledgement
from companion.wire.call_figures import asked
from companion.wire.call_report import CallReport
from companion.wire.documents import StateFile
from companion.wire.ids import (
    CHANGING_RESULTS,
    CPU_THROTTLED,
    DISK_FULL,
    NO_TEMPERATURE,
    UNDER_VOLTAGE,
    Kind,
    Outcome,
    Policy,
    Result,
    Stage,
    State,
    read_heartbeat_mode,
    words_hash,
)
from companion.wire.parameters import WORD_PREFIX
from companion.wire.payloads import Summary
from gcs_plugin.client import events as ev
from gcs_plugin.client.vehicle import Position, TrackedVehicle

FRESH_S = 3.0
"""The companion is alive while its last heartbeat is younger than this."""
ANEW_S = 10.0
"""A hold announced so much later than the known hold of the same id is another hold: the ids began anew."""
ECHO_S = 5.0
"""The autopilot's script repeats a text of the companion within this time."""
MAX_CALLS = 64
MAX_PARAMETERS = 64
MAX_LATENCIES = 4096
MAX_SUMMARIES_A_SECOND = 20
_NAME = re.compile(r"[A-Z0-9_]{1,16}\Z", re.ASCII)
"""Valid parameter names; others are dropped, since control characters would reach the terminal."""
_HOLDS_STAGE = CHANGING_RESULTS | {Result.STALE}


@dataclass
class TrackedCall:
    """Holds the newest data of a call or hold.

    received_at: when it was received. reported_at: when it was reported to the operator. Seconds, as `now`.
    """

    data: CallReport
    opened_at: float
    received_at: float
    serial: int = 0
    """Number of this call among all of this rover; unlike the id it is not used again after a restart."""
    presumed_closed: bool = False
    """It was closed without a closing message: a later message that says it is open opens it again."""
    reported_at: float = 0.0

    @property
    def open(self) -> bool:
        return self.data.stage is not Stage.CLOSED

    def age(self, now: float) -> float:
        """Return the seconds since it was announced."""
        return self.data.age_s + now - self.received_at


@dataclass(frozen=True)
class ComputerReport:
    """Holds what the companion's computer said of itself.

    received_at: seconds, as `now`. temperature: degrees Celsius. cpu: share in use.
    """

    received_at: float
    temperature: int | None
    cpu: float | None
    throttled: bool
    under_voltage: bool
    disk_full: bool


@dataclass
class _Counters:
    """Counts what was received from the companion. unreadable: the messages that could not be read."""

    bytes: int = 0
    unreadable: int = 0
    summaries: int = 0
    summaries_lost: int = 0
    duplicate_acknowledgements: int = 0
    latencies_ms: deque[int] = field(default_factory=lambda: deque(maxlen=MAX_LATENCIES))
    latency_max_ms: int = 0

    def latency(self, milliseconds: int) -> None:
        self.latencies_ms.append(milliseconds)
        self.latency_max_ms = max(self.latency_max_ms, milliseconds)


class TrackedRover:
    """Tracks one system. Every `handle_...` takes a message's content and returns the resulting events."""

    def __init__(self, system: int) -> None:
        self.system = system
        self.state: State | None = None
        self.current_id = 0
        self.policy: Policy | None = None
        self.fault_accepted = self.braking = self.guiding = False
        self.signs = False
        """Whether its companion signs; then it also ignores messages that are not signed."""
        self.vehicle: TrackedVehicle | None = None
        self.position: Position | None = None
        self.summary: Summary | None = None
        self.computer: ComputerReport | None = None
        self.calls: dict[int, TrackedCall] = {}
        self.texts: deque[tuple[float, int, str]] = deque(maxlen=50)
        self.parameters: dict[str, float] = {}
        self.state_file: StateFile | None = None
        """Its /state.json, None until it was read."""
        self.counters = _Counters()
        self._heartbeat_at: float | None = None
        self._up = False
        self._current_since = 0.0
        self._idle_since: float | None = None
        self._serial = 0
        self._summary_at = 0.0
        self._asked = 0, ""
        """Id of the call whose text came last, and why it is open, in the rover's words."""

    def alive(self, now: float) -> bool:
        """Return whether the last heartbeat of its companion is younger than 3 s."""
        return self._heartbeat_at is not None and now - self._heartbeat_at < FRESH_S

    @property
    def known(self) -> bool:
        """Whether a heartbeat of its companion was ever received."""
        return self._heartbeat_at is not None

    def silence(self, now: float) -> float:
        """Return the seconds since the companion's last heartbeat; infinity before the first."""
        return math.inf if self._heartbeat_at is None else now - self._heartbeat_at

    def open_calls(self) -> list[TrackedCall]:
        """Return the open calls and holds in the order of their ids."""
        return [call for _, call in sorted(self.calls.items()) if call.open]

    def reported_for(self, number: int, now: float) -> float:
        """Return the seconds since this call or hold was reported to the operator."""
        call = self.calls.get(number)
        return now - (self._current_since if call is None else call.reported_at)

    def words(self) -> dict[str, float]:
        """Return the words in use with their weights, as far as they are known.

        Without its /state.json, or one of now, these are spelled as far as parameter names can.
        """
        prefix = len(WORD_PREFIX)
        named = {
            name[prefix:].replace("_", " ").lower(): value
            for name, value in sorted(self.parameters.items())
            if name.startswith(WORD_PREFIX)
        }
        told = {} if self.state_file is None else self.state_file.words
        if told and self.summary is not None and self.summary.words == words_hash(told):
            return dict(told)
        return {word: value for word, value in {**told, **named}.items() if -1.0 <= value <= 1.0}

    def given(self) -> dict[str, float]:
        """Return the words that were given before, with their weights then, as far as they are known."""
        return {} if self.state_file is None else {**self.state_file.given, **self.state_file.words}

    def handle_vehicle(self, vehicle: TrackedVehicle) -> list[ev.Event]:
        """Take in the autopilot's mode and arming."""
        if vehicle == self.vehicle:
            return []
        self.vehicle = vehicle
        return [ev.VehicleChanged(self.system, vehicle.mode, vehicle.armed)]

    def handle_heartbeat(self, now: float) -> list[ev.Event]:
        """Take in a heartbeat of the companion, whatever its content."""
        self._heartbeat_at = now
        return self.check_link(now)

    def check_link(self, now: float) -> list[ev.Event]:
        """Return an event when the companion has come or gone since the last call."""
        if self.alive(now) == self._up:
            return []
        self._up = not self._up
        return [ev.LinkChanged(self.system, self._up)]

    def handle_state(self, custom_mode: int, now: float) -> list[ev.Event]:
        """Take in the heartbeat's custom_mode. Raises ValueError for a state unknown to this version."""
        told = read_heartbeat_mode(custom_mode)
        state, current_id, self.policy = told.state, told.current_id, told.policy
        self.fault_accepted, self.braking, self.guiding = told[3:]
        new_events: list[ev.Event] = []
        if (state, current_id) != (self.state, self.current_id):
            new_events.append(ev.StateChanged(self.system, state, current_id))
        if current_id != self.current_id:
            self._current_since = now
        self.state, self.current_id = state, current_id
        return new_events + self._close_missed(now)

    def handle_summary(self, summary: Summary, now: float) -> list[ev.Event]:
        """Take in a summary, and count lost ones by the gap in the sequence.

        A gap too large for the time since the last summary is a restart of the companion, not a loss.
        """
        counters = self.counters
        if self.summary is not None:
            gap = (summary.sequence - self.summary.sequence) & 0xFFFF
            if gap == 0:
                return []
            if gap - 1 <= MAX_SUMMARIES_A_SECOND * (1 + now - self._summary_at):
                counters.summaries_lost += gap - 1
        counters.summaries += 1
        counters.latency(summary.frame_age_ms)
        self.summary, self._summary_at = summary, now
        return [ev.SummaryReceived(self.system, summary)]

    def handle_computer(self, temperature: int, cpu: int, flags: int, now: float) -> None:
        """Take in the fields of ONBOARD_COMPUTER_STATUS. cpu: percent; over 100: not known."""
        self.computer = ComputerReport(
            now,
            None if temperature == NO_TEMPERATURE else temperature,
            None if cpu > 100 else cpu / 100.0,
            throttled=bool(flags & CPU_THROTTLED),
            under_voltage=bool(flags & UNDER_VOLTAGE),
            disk_full=bool(flags & DISK_FULL),
        )

    def handle_call(self, data: CallReport, now: float) -> list[ev.Event]:
        """Take in the data of a call or hold; a mere repeat makes no event."""
        known = self.calls.get(data.id)
        number, why = self._asked
        data = replace(data, why=why if number == data.id else "")
        if known is not None and not _is_another_call(known, data, now):
            return self._update_call(known, data, now)
        self._make_room()
        self._serial += 1
        self.calls[data.id] = TrackedCall(data, now - data.age_s, now, self._serial, reported_at=now)
        return [] if data.stage is Stage.CLOSED else [ev.CallAnnounced(self.system, data)]

    def handle_acknowledgement(self, ack: Acknowledgement, now: float) -> list[ev.Event]:
        """Update the call's stage from an answer's acknowledgement, before the call's own next message.

        The acknowledgement of a refused answer holds no stage; a stale answer means that the call is closed.
        """
        call = self.calls.get(ack.target)
        if call is None or not call.open or ack.result not in _HOLDS_STAGE or ack.stage is call.data.stage:
            return []
        if ack.stage is not Stage.CLOSED:
            call.data = replace(call.data, stage=ack.stage)
            return [ev.CallChanged(self.system, call.data)]
        if ack.outcome is not Outcome.NONE or ack.result is Result.STALE:
            call.presumed_closed = ack.outcome is Outcome.NONE
            return [self._close(call, ack.outcome, now)]
        return []

    def handle_text(self, severity: int, text: str, now: float) -> list[ev.Event]:
        """Take in a STATUSTEXT of the companion."""
        self.texts.append((now, severity, text))
        self._hear_why(text)
        return [ev.TextReceived(self.system, severity, text)]

    def _hear_why(self, text: str) -> None:
        """Keep what a text says of an open call's figures: the call's data has no room for it."""
        if found := asked(text):
            self._asked = found
            call = self.calls.get(found[0])
            if call is not None and call.open and call.data.kind is Kind.CALL:
                call.data = replace(call.data, why=found[1])

    def handle_vehicle_text(self, severity: int, text: str, now: float) -> list[ev.Event]:
        """Report the autopilot's texts of WARNING or worse, except repeats of the companion's texts."""
        echo = any(new_events == text and now - at < ECHO_S for at, _, new_events in self.texts)
        if severity > MAV_SEVERITY_WARNING or echo:
            return []
        return [ev.VehicleTextReceived(self.system, severity, text)]

    def handle_parameter(self, name: str, value: float) -> list[ev.Event]:
        """Take in a parameter; invalid names, values that are not finite, and names too many are dropped."""
        if not _NAME.match(name) or not math.isfinite(value) or self.parameters.get(name) == value:
            return []
        if name not in self.parameters and len(self.parameters) >= MAX_PARAMETERS:
            return []
        self.parameters[name] = value
        return [ev.ParameterReceived(self.system, name, value)]

    def _update_call(self, known: TrackedCall, data: CallReport, now: float) -> list[ev.Event]:
        if not known.open and not (known.presumed_closed and data.stage is not Stage.CLOSED):
            return []
        before, known.data, known.received_at = known.data, data, now
        if known.presumed_closed:
            known.presumed_closed, known.reported_at = False, now
            return [ev.CallAnnounced(self.system, data)]
        if data.stage is Stage.CLOSED:
            return [ev.CallEnded(self.system, data, now - known.opened_at)]
        if (before.stage, before.reasons, before.holding) != (data.stage, data.reasons, data.holding):
            return [ev.CallChanged(self.system, data)]
        return []

    def _close_missed(self, now: float) -> list[ev.Event]:
        """Close open calls when the heartbeat names none for 3 s: their closing messages were lost."""
        if self.current_id:
            self._idle_since = None
            return []
        if self._idle_since is None:
            self._idle_since = now
        new_events: list[ev.Event] = []
        for call in self.open_calls():
            if call.received_at < self._idle_since <= now - FRESH_S:
                call.presumed_closed = True
                new_events.append(self._close(call, Outcome.NONE, now))
        return new_events

    def _close(self, call: TrackedCall, outcome: Outcome, now: float) -> ev.Event:
        call.data = replace(call.data, stage=Stage.CLOSED, outcome=outcome, holding=False)
        return ev.CallEnded(self.system, call.data, now - call.opened_at)

    def _make_room(self) -> None:
        if len(self.calls) >= MAX_CALLS:
            by_use = sorted(self.calls.values(), key=lambda call: (call.open, call.received_at))
            del self.calls[by_use[0].data.id]


def _is_another_call(known: TrackedCall, data: CallReport, now: float) -> bool:
    """Return whether `data` is of a new call or hold that has the id of a known one, after a restart.

    A call keeps its frame for life. A hold may change its frame, but is announced only once.
    """
    if known.data.kind is Kind.CALL and data.kind is Kind.CALL:
        return known.data.frame_id != data.frame_id
    return now - data.age_s > known.opened_at + ANEW_S
