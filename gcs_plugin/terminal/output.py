"""Where the terminal writes to: lines for a person, or one JSON object a line for a program."""

from __future__ import annotations

import dataclasses
import json
import re
import time
from collections.abc import Callable, Iterable
from enum import Enum, IntEnum, IntFlag
from typing import Any, Protocol, TextIO

from pymavlink.dialects.v20.common import MAV_SEVERITY_CRITICAL, MAV_SEVERITY_WARNING

from companion.wire.ids import Reasons, Stage, State
from companion.wire.payloads import CallData
from gcs_plugin.client import events as ev
from gcs_plugin.client.delivery import PolicyRequested, Status
from gcs_plugin.client.events import Event
from gcs_plugin.terminal import wording


def plain(value: Any) -> Any:
    """Enums by their names in lower case, flags as lists of names, dataclasses as objects."""
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
    """`event` as an object: its name, seconds since the start, the rover's system id, then its fields.

    A call's, a summary's or an acknowledgement's own fields stand beside them.
    """
    fields: dict[str, Any] = {"event": event.event, "time": round(time, 3), "system": event.system}
    for name, value in plain(event).items():
        fields.update(value if isinstance(value, dict) else {name: value})
    return fields


def to_line(fields: dict[str, Any]) -> str:
    """One line of JSON."""
    return json.dumps(fields, separators=(",", ":"))


REPEATED_S = 60.0
_FIGURE = re.compile(r"\d+%")
_TYPED = re.compile(r"`(?=\w)")
_ALARM, _GOOD, _FAINT, _PLAIN = "1;31", "32", "2", ""
_ON_THE_WAY = {
    Status.WAITING: "waits: the companion is not heard",
    Status.SENT: "sent",
    Status.ACKNOWLEDGED: "acknowledged",
    Status.CLOSED: "not acknowledged: the call was closed meanwhile",
    Status.EXPIRED: "LOST: no acknowledgement within 60 s",
}


_Standing = tuple[int, Stage, bool, int]


def _standing(call: CallData) -> _Standing:
    return call.id, call.stage, call.holding, int(call.reasons)


def _urgency(severity: int) -> str:
    """An alarm must not look like news; of a call the lines above say more than its text."""
    if severity <= MAV_SEVERITY_CRITICAL:
        return _ALARM
    return _PLAIN if severity <= MAV_SEVERITY_WARNING else _FAINT


class Writes(Protocol):
    """A stream of text."""

    def write(self, text: str, /) -> object:
        """Write some of a line, or several."""

    def flush(self) -> object:
        """Let it be seen now."""


class Output(Protocol):
    """What the session tells."""

    def started(self, link: str) -> None:
        """The first thing told: where rovers reach us."""

    def event(self, event: ev.Event, now: float, *, several: bool) -> None:
        """Something happened; several: more than one rover is heard."""

    def say(self, lines: Iterable[str]) -> None:
        """What was asked for."""

    def problem(self, text: str) -> None:
        """A line that could not be obeyed."""

    def typed(self, line: str) -> None:
        """A line that the script typed."""

    def end(self, totals: dict[str, Any]) -> None:
        """The last thing told."""


class JsonOutput:
    """One object a line; times are seconds since `started`."""

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


class Logged:
    """Tells an output, and a log beside it for as long as that can be written."""

    def __init__(self, output: Output, log: Output) -> None:
        self._output = output
        self._log: Output | None = log

    def started(self, link: str) -> None:
        self._output.started(link)
        self._keep(lambda log: log.started(link))

    def event(self, event: ev.Event, now: float, *, several: bool) -> None:
        self._output.event(event, now, several=several)
        self._keep(lambda log: log.event(event, now, several=several))

    def say(self, lines: Iterable[str]) -> None:
        told = list(lines)
        self._output.say(told)
        self._keep(lambda log: log.say(told))

    def problem(self, text: str) -> None:
        self._output.problem(text)
        self._keep(lambda log: log.problem(text))

    def typed(self, line: str) -> None:
        self._output.typed(line)
        self._keep(lambda log: log.typed(line))

    def end(self, totals: dict[str, Any]) -> None:
        self._output.end(totals)
        self._keep(lambda log: log.end(totals))

    def _keep(self, tell: Callable[[Output], None]) -> None:
        if self._log is None:
            return
        try:
            tell(self._log)
        except OSError as error:
            self._log = None
            self._output.problem(f"the log ends here, it cannot be written: {error.strerror or error}")


class TextOutput:
    """Lines with the time of day. before: what is typed before each answer here."""

    def __init__(self, stream: Writes, *, colours: bool, before: str = "") -> None:
        self._stream = stream
        self._colours = colours
        self._before = before
        self._texts: dict[tuple[int, str], float] = {}
        self._standing: dict[int, _Standing] = {}

    def started(self, link: str) -> None:
        self._write(f"on {link}; type `help` for what can be typed", stamped=True)

    def event(self, event: ev.Event, now: float, *, several: bool) -> None:
        lines, colour = self._lines(event, now)
        who = f"rover {event.system}: " if several else ""
        for number, line in enumerate(lines):
            self._write(line if number else who + line, colour, stamped=not number)

    def say(self, lines: Iterable[str]) -> None:
        for line in lines:
            self._write(line)

    def problem(self, text: str) -> None:
        self._write(f"? {_TYPED.sub('`' + self._before, text)}")

    def typed(self, line: str) -> None:
        self._write(f"> {line}", _FAINT, stamped=True)

    def end(self, totals: dict[str, Any]) -> None:
        self._write(
            f"{totals['calls']} calls, {totals['answers_acknowledged']} of {totals['answers_sent']} answers "
            f"acknowledged, {totals['summaries_lost']} summaries lost, {totals['seconds']:.0f} s"
        )

    def _lines(self, event: ev.Event, now: float) -> tuple[list[str], str]:
        match event:
            case ev.LinkChanged():
                known = "companion heard" if event.up else "companion NOT HEARD: answers wait"
                return [f"rover {event.system} {known}"], _GOOD if event.up else _ALARM
            case ev.StateChanged():
                call = event.state in (State.CALLING, State.HOLDING) and event.current_id != 0
                told = not call  # which says it better
                return [wording.state(event.state, event.current_id)] * told, _FAINT
            case ev.VehicleChanged():
                return [f"vehicle {event.mode}, {'armed' if event.armed else 'disarmed'}"], _FAINT
            case ev.CallOpened():
                self._standing[event.system] = _standing(event.call)
                return wording.call_lines(event.call, event.call.age_s, self._before), _ALARM
            case ev.CallChanged():
                return self._news(event), _PLAIN
            case ev.CallClosed():
                return [wording.closed(event.call, event.after_s)], _GOOD
            case ev.TextHeard():
                fresh = self._fresh(event, now)
                return [f'says "{wording.clean(event.text)}"'] * fresh, _urgency(event.severity)
            case ev.VehicleTextHeard():
                fresh = self._fresh(event, now)
                return [f'autopilot says "{wording.clean(event.text)}"'] * fresh, _ALARM
            case ev.AnswerMoved():
                subject = str(event.target) if event.target else "no call"
                alarm = event.status in (Status.WAITING, Status.EXPIRED)
                return [f"answer to {subject} {_ON_THE_WAY[event.status]}"], _ALARM if alarm else _FAINT
            case ev.Acknowledged():
                return [wording.acknowledged(event.acknowledgement)], _PLAIN
            case ev.PolicyMoved():
                alarm = event.status in (
                    PolicyRequested.WAITING,
                    PolicyRequested.REFUSED,
                    PolicyRequested.EXPIRED,
                )
                return [wording.policy(event.policy, event.status)], _ALARM if alarm else _PLAIN
            case ev.NotUnderstood():
                return [f"cannot read a message of the companion: {wording.clean(event.problem)}"], _ALARM
            case _:
                return [], _PLAIN

    def _news(self, event: ev.CallChanged) -> list[str]:
        """Reasons come and go from frame to frame: one that was told for this stage is no news."""
        call, told, now = event.call, self._standing.get(event.system), _standing(event.call)
        if told is None or told[:2] != now[:2]:
            self._standing[event.system] = now
            return [wording.changed(call, call.age_s, self._before)]
        self._standing[event.system] = (*now[:3], told[3] | now[3])
        added = call.reasons & ~Reasons(told[3])
        if call.stage is Stage.OPEN and added:
            return [wording.also(call, added, self._before)]
        return [wording.stands(call)] * (told[2] != now[2])

    def _fresh(self, event: ev.TextHeard | ev.VehicleTextHeard, now: float) -> bool:
        """A text repeats, the companion's also from the autopilot: to read it once a minute is enough."""
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
