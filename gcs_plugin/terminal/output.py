"""Writes what the terminal shows: lines for a person, or one JSON object a line for a program."""

from __future__ import annotations

import dataclasses
import json
import re
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from enum import Enum, IntEnum, IntFlag
from typing import Any, Protocol, TextIO

from pymavlink.dialects.v20.common import MAV_SEVERITY_CRITICAL, MAV_SEVERITY_WARNING

from companion.wire import texts
from companion.wire.call_report import ONLY_RECORDED, CallReport
from companion.wire.delivery import STATUS_TEXTS, DeliveryStatus
from companion.wire.ids import Reasons, Stage, State
from companion.wire.packing import clean
from gcs_plugin.client import events as ev
from gcs_plugin.client.events import Event
from gcs_plugin.client.faults import FaultTally
from gcs_plugin.client.policy_request import PolicyStatus
from gcs_plugin.terminal import wording


def plain(value: Any) -> Any:
    """Convert for JSON: enums to names in lower case, flags to lists of names, dataclasses to objects."""
    if isinstance(value, IntFlag):
        return [str(flag.name).lower() for flag in type(value) if flag and flag in value]
    if isinstance(value, IntEnum):
        return value.name.lower()
    if isinstance(value, Enum):
        return value.value
    if dataclasses.is_dataclass(value):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def record(event: Event, time: float) -> dict[str, Any]:
    """Convert an event to an object: its name, seconds since the start, the rover's system id, its fields.

    The fields of a call, a summary or an acknowledgement are put on the same level, without those of a call
    that no message tells.
    """
    fields: dict[str, Any] = {"event": event.event, "time": round(time, 3), "system": event.system}
    for name, value in plain(event).items():
        inner = value if isinstance(value, dict) else {}
        fields |= {key: one for key, one in inner.items() if key not in ONLY_RECORDED} or {name: value}
    return fields


def to_line(fields: dict[str, Any]) -> str:
    """Format an object as one line of JSON."""
    return json.dumps(fields, separators=(",", ":"))


REPEATED_S = 60.0
_FIGURE = re.compile(r"\d+%")
_TYPED = re.compile(r"`(?=\w)")
ALARM, GOOD, FAINT, _PLAIN = "1;31", "32", "2", ""
_ShownState = tuple[int, Stage, bool, int]


def _shown_state(call: CallReport) -> _ShownState:
    return call.id, call.stage, call.holding, int(call.reasons)


def _urgency(severity: int) -> str:
    """Choose a colour for a STATUSTEXT: alarms stand out, and texts below WARNING are faint."""
    if severity <= MAV_SEVERITY_CRITICAL:
        return ALARM
    return _PLAIN if severity <= MAV_SEVERITY_WARNING else FAINT


class Writes(Protocol):
    """Represents a stream of text."""

    def write(self, text: str, /) -> object:
        """Write text: part of a line, or several lines."""

    def flush(self) -> object:
        """Show what was written."""


class Output(Protocol):
    """Shows what happens in a session."""

    def started(self, link: str) -> None:
        """Show the start. link: the address of our end of the link."""

    def event(self, event: ev.Event, now: float, *, several: bool) -> None:
        """Show an event. several: whether more than one rover is heard."""

    def say(self, lines: Iterable[str]) -> None:
        """Show the reply to a typed line."""

    def problem(self, text: str) -> None:
        """Show a problem, such as a typed line that cannot be carried out."""

    def typed(self, line: str) -> None:
        """Show a line that the script typed."""

    def end(self, totals: dict[str, Any]) -> None:
        """Show the end, with the session's figures."""


class JsonOutput:
    """Writes one JSON object a line; times are seconds since `started`."""

    def __init__(self, stream: TextIO, started: float) -> None:
        self._stream = stream
        self._started = started

    def started(self, link: str) -> None:
        self._write({"event": "started", "link": link})

    def event(self, event: ev.Event, now: float, *, several: bool) -> None:  # noqa: ARG002
        self._write(record(event, now - self._started))

    def say(self, lines: Iterable[str]) -> None:
        self._write({"event": "said", "lines": list(lines)})

    def problem(self, text: str) -> None:
        self._write({"event": "problem", "text": text})

    def typed(self, line: str) -> None:
        self._write({"event": "typed", "line": line})

    def end(self, totals: dict[str, Any]) -> None:
        self._write(totals)

    def _write(self, fields: dict[str, Any]) -> None:
        print(to_line(fields), file=self._stream, flush=True)


class LoggedOutput:
    """Passes everything to an output and to a log, until the log cannot be written any more."""

    def __init__(self, output: Output, log: Output) -> None:
        self._output = output
        self._log: Output | None = log

    def started(self, link: str) -> None:
        self._output.started(link)
        self._to_log(lambda log: log.started(link))

    def event(self, event: ev.Event, now: float, *, several: bool) -> None:
        self._output.event(event, now, several=several)
        self._to_log(lambda log: log.event(event, now, several=several))

    def say(self, lines: Iterable[str]) -> None:
        told = list(lines)
        self._output.say(told)
        self._to_log(lambda log: log.say(told))

    def problem(self, text: str) -> None:
        self._output.problem(text)
        self._to_log(lambda log: log.problem(text))

    def typed(self, line: str) -> None:
        self._output.typed(line)
        self._to_log(lambda log: log.typed(line))

    def end(self, totals: dict[str, Any]) -> None:
        self._output.end(totals)
        self._to_log(lambda log: log.end(totals))

    def _to_log(self, write_to: Callable[[Output], None]) -> None:
        if self._log is None:
            return
        try:
            write_to(self._log)
        except OSError as error:
            self._log = None
            self._output.problem(f"the log ends here, it cannot be written: {error.strerror or error}")


class TextOutput:
    """Writes lines with the time of day. before: what an operator types before each answer, e.g. "at "."""

    def __init__(self, stream: Writes, *, colours: bool, before: str = "") -> None:
        self._stream = stream
        self._colours = colours
        self._before = before
        self._texts: dict[tuple[int, str], float] = {}
        self._shown_state: dict[int, _ShownState] = {}
        self._faults: dict[int, FaultTally] = {}
        self._fault_states: dict[int, tuple[int, float, int]] = {}
        """Of each rover the call in which its state was a fault last, since when, and how often."""

    def started(self, link: str) -> None:
        self._write(f"on {link}; type `help` for what can be typed", stamped=True)

    def event(self, event: ev.Event, now: float, *, several: bool) -> None:
        lines, colour = self.lines(event, now)
        who = f"rover {event.system}: " if several else ""
        for number, line in enumerate(lines):
            self._write(line if number else who + line, colour, stamped=not number)

    def say(self, lines: Iterable[str]) -> None:
        for line in lines:
            self._write(line)

    def problem(self, text: str) -> None:
        self._write(f"? {_TYPED.sub('`' + self._before, text)}")

    def typed(self, line: str) -> None:
        self._write(f"> {line}", FAINT, stamped=True)

    def end(self, totals: dict[str, Any]) -> None:
        self._write(
            f"{totals['calls']} calls, {totals['answers_acknowledged']} of {totals['answers_sent']} answers "
            f"acknowledged, {totals['summaries_lost']} summaries lost, {totals['seconds']:.0f} s"
        )

    def lines(self, event: ev.Event, now: float) -> tuple[list[str], str]:
        """Word an event: lines for a person, maybe none, and how urgent they are: `ALARM`, `GOOD` ..."""
        match event:
            case ev.LinkChanged():
                known = "companion heard" if event.up else "companion NOT HEARD: answers wait"
                return [f"rover {event.system} {known}"], GOOD if event.up else ALARM
            case ev.StateChanged():
                call = event.state in (State.CALLING, State.HOLDING) and event.current_id != 0
                told = not call  # the call's own lines say more
                if event.state is State.FAULT and event.current_id:
                    return self._fault_state(event, now), FAINT
                if event.state is not State.FAULT and event.system in self._faults:
                    self._faults[event.system].forget("Companion")
                return [wording.state(event.state, event.current_id)] * told, FAINT
            case ev.VehicleChanged():
                return [f"vehicle {event.mode}, {'armed' if event.armed else 'disarmed'}"], FAINT
            case ev.CallAnnounced():
                self._shown_state[event.system] = _shown_state(event.call)
                return wording.call_lines(event.call, event.call.age_s, self._before), ALARM
            case ev.CallChanged():
                return self._call_change_lines(event), _PLAIN
            case ev.CallEnded():
                self._faults.setdefault(event.system, FaultTally()).forget(
                    texts.name(event.call.kind, event.call.id)
                )
                return [wording.closed(event.call, event.after_s)], GOOD
            case ev.TextReceived():
                return self._said(event, now), _urgency(event.severity)
            case ev.VehicleTextReceived():
                fresh = self._fresh(event, now)
                return [f'autopilot says "{clean(event.text)}"'] * fresh, ALARM
            case ev.AnswerStatusChanged():
                subject = str(event.target) if event.target else "no call"
                alarm = event.status in (DeliveryStatus.WAITING, DeliveryStatus.EXPIRED)
                return [f"answer to {subject} {STATUS_TEXTS[event.status]}"], ALARM if alarm else FAINT
            case ev.Acknowledged():
                return [wording.acknowledged(event.acknowledgement)], _PLAIN
            case ev.PolicyStatusChanged():
                alarm = event.status in (
                    PolicyStatus.WAITING,
                    PolicyStatus.REFUSED,
                    PolicyStatus.EXPIRED,
                )
                return [wording.policy(event.policy, event.status)], ALARM if alarm else _PLAIN
            case ev.NotUnderstood():
                return [f"cannot read a message of the companion: {clean(event.problem)}"], ALARM
            case _:
                return [], _PLAIN

    def _call_change_lines(self, event: ev.CallChanged) -> list[str]:
        """Return lines about what is new in a call.

        Reasons come and go from frame to frame: each one is shown once in each stage.
        """
        call, told, now = event.call, self._shown_state.get(event.system), _shown_state(event.call)
        if told is None or told[:2] != now[:2]:
            self._shown_state[event.system] = now
            return [wording.changed(call, call.age_s, self._before)]
        self._shown_state[event.system] = (*now[:3], told[3] | now[3])
        added = call.reasons & ~Reasons(told[3])
        if call.stage is Stage.OPEN and added:
            return [wording.also(call, added, self._before)]
        return [wording.stands(call)] * (told[2] != now[2])

    def _fault_state(self, event: ev.StateChanged, now: float) -> list[str]:
        """Return the line of a fault in a call: at once, then once a minute, with how often it came."""
        about, since, times = self._fault_states.get(event.system, (0, now, 0))
        if about != event.current_id:
            since, times = now, 0
        self._fault_states[event.system] = event.current_id, since, times + 1
        line = wording.state(event.state, event.current_id)
        line += f": {times + 1} times in {now - since:.0f} s" if times else ""
        due = self._fresh(ev.TextReceived(event.system, 0, f"fault in {event.current_id}"), now)
        return [line] * due

    def _said(self, event: ev.TextReceived, now: float) -> list[str]:
        """Return the line of a companion's text, none for a repeat. Faults of one call share a line."""
        fault = self._faults.setdefault(event.system, FaultTally()).take(event.text, now)
        if fault is None:
            return [f'says "{clean(event.text)}"'] * self._fresh(event, now)
        subject, line, is_new = fault
        due = self._fresh(replace(event, text=f"{subject} FAULT"), now)
        unseen = self._fresh(event, now)  # the autopilot may have brought it first
        return [f'says "{clean(line)}"'] * (unseen if is_new else due)

    def _fresh(self, event: ev.TextReceived | ev.VehicleTextReceived, now: float) -> bool:
        """Return whether a text was not shown within the last minute; its figures (`12%`) do not count.

        The companion repeats its texts, and the autopilot repeats them again.
        """
        self._texts = {key: at for key, at in self._texts.items() if now - at < REPEATED_S}
        key = event.system, _FIGURE.sub("%", event.text)
        fresh = key not in self._texts
        if fresh:
            self._texts[key] = now
        return fresh

    def _write(self, line: str, colour: str = _PLAIN, *, stamped: bool = False) -> None:
        stamp = time.strftime("%H:%M:%S") if stamped else " " * 8
        coloured = f"\033[{colour}m{line}\033[0m" if colour and self._colours else line
        print(f"{stamp}  {coloured}", file=self._stream, flush=True)
