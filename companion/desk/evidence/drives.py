"""Reads what the rover's own recordings tell of its drives: the newest first, for a bounded time."""

from __future__ import annotations

import sys
import time
from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from companion.desk.evidence.parts import Basis
from companion.observers.recording.contents import read_json
from companion.observers.recording.foxglove import NS
from companion.observers.recording.recorder import missing
from companion.observers.recording.ring import FOLDER, recordings
from companion.observers.recording.topics import TOPICS, Topic
from companion.vehicle.state import MOVES, Odometer
from companion.wire.json_values import list_of, mapping_of, number_of, text_of, whole_of
from companion.wire.packing import clean

LONGEST = 120.0
"""Seconds of reading. Recordings that are older than what was read by then are left out, and counted."""
MOST = 1_000_000
"""Messages that are read, of all recordings, for their memory."""
_TOLD_EVERY = 5.0
_LONGEST_AGE, _LATEST = 60.0, 1e11
_GAP = 2.0
"""Seconds between two messages beyond which it is not known what happened: the clock may have been set."""
_LONGEST_NAME = 40
_MOST_VEHICLES = 16
_READ = (
    *(Topic.ASSESSMENT, Topic.STATUS, Topic.VEHICLE, Topic.DECISIONS),
    *(Topic.ACKNOWLEDGEMENTS, Topic.SETUP),
)


class CameraSample(NamedTuple):
    """What the companion said of its camera. at: seconds since 1970. pid: of the companion.

    read: frames since the camera was opened by this vision process. rate: frames per second over ten seconds.
    trouble: whether vision itself was in trouble.
    """

    at: float
    pid: int
    read: int
    rate: float | None = None
    size: tuple[int, int] = (0, 0)
    trouble: bool = False


class DecisionSample(NamedTuple):
    """A decision. what: its name, e.g. "call opened". event: of a hold that moved, "" of others."""

    at: float
    what: str
    id: int
    event: str = ""


class AnswerSample(NamedTuple):
    """An acknowledged answer. target: the call's or hold's id. result: by name, e.g. "applied"."""

    at: float
    target: int
    result: str


@dataclass
class DrivenFacts:
    """What the recordings tell, in the order of time. Times are seconds since 1970, unless said otherwise.

    files: recordings that were read. unread: that were not, or not to the end. damaged: whose disk failed.
    lacking: that lay between these, and were deleted. trouble: why none could be read.
    ages: seconds from each frame's capture until it was judged. faulty: how many were a fault.
    model: of the perceiver. camera: about once a second. gaps: between two heartbeats of the autopilot.
    vehicles: system id, MAV_AUTOPILOT and MAV_TYPE of those heard. reboots: of the autopilot.
    metres, moved: the way, and seconds of motion.
    """

    files: int = 0
    unread: int = 0
    damaged: int = 0
    lacking: int = 0
    trouble: str = ""
    begin: float | None = None
    end: float | None = None
    seconds: float = 0.0
    ages: array[float] = field(default_factory=lambda: array("f"))
    faulty: int = 0
    model: str = ""
    camera: list[CameraSample] = field(default_factory=list)
    temperatures: array[float] = field(default_factory=lambda: array("f"))
    throttled: bytearray = field(default_factory=bytearray)
    decisions: list[DecisionSample] = field(default_factory=list)
    answers: list[AnswerSample] = field(default_factory=list)
    gaps: array[float] = field(default_factory=lambda: array("f"))
    vehicles: set[tuple[int, int, int]] = field(default_factory=set)
    reboots: int = 0
    metres: float = 0.0
    moved: float = 0.0

    def basis(self, samples: int) -> Basis:
        """Return what a figure rests on that was found over so many samples of all recordings."""
        return Basis("recordings", samples, self.begin, self.end)

    def add(self, later: DrivenFacts) -> None:
        """Append what a later recording tells."""
        self.files += 1
        self.begin = later.begin if self.begin is None else self.begin
        self.end = later.end if later.end is not None else self.end
        self.model = later.model or self.model
        self.vehicles |= later.vehicles
        for name in ("seconds", "faulty", "reboots", "metres", "moved"):
            setattr(self, name, getattr(self, name) + getattr(later, name))
        for name in ("ages", "camera", "temperatures", "throttled", "decisions", "answers", "gaps"):
            getattr(self, name).extend(getattr(later, name))


class _EnoughError(Exception):
    """No more is to be read."""


def read_drives(folder: Path, longest: float = LONGEST, most: int = MOST) -> DrivenFacts:
    """Read the recordings in a companion's state folder. Raises OSError where it may not be read.

    It says on stderr how far it is. longest, most: see `LONGEST` and `MOST`.
    """
    whole = DrivenFacts()
    if trouble := missing():
        whole.trouble = trouble
        return whole
    found, reading = recordings(folder / FOLDER), _Reading(time.monotonic() + longest, most)
    each, damaged, told_at = list[DrivenFacts](), 0, time.monotonic()
    for number, one in enumerate(reversed(found), 1):
        if reading.ended():
            break
        if time.monotonic() >= told_at + _TOLD_EVERY:
            told_at = time.monotonic()
            print(f"recording {number} of {len(found)}", file=sys.stderr, flush=True)
        try:
            each.append(reading.facts_of(folder / FOLDER / one.name))
        except PermissionError:
            raise
        except OSError:  # a bad sector must not cost what the others tell
            damaged += 1
    for facts in reversed(each):
        whole.add(facts)
    whole.damaged, whole.unread = damaged, len(found) - len(each) - damaged + reading.cut
    whole.lacking = found[-1].number - found[0].number + 1 - len(found) if found else 0
    return whole


class _Reading:
    """Reads recordings until a time, monotonic seconds, or until so many messages are read."""

    def __init__(self, until: float, most: int) -> None:
        self._until, self._left = until, most
        self.cut = 0
        """Recordings that were not read to the end: 1 at most."""

    def ended(self) -> bool:
        return self._left <= 0 or time.monotonic() > self._until

    def facts_of(self, path: Path) -> DrivenFacts:
        """Read one recording, as far as there is time. Raises OSError."""
        from companion.observers.recording.reading import messages

        taking, topics = _Taking(), {TOPICS[topic].name: topic for topic in _READ}
        try:
            for one in messages(path, list(topics), check=self._check):
                self._check()
                self._left -= 1
                taking.take(topics[one.channel.topic], one.message.log_time / NS, one.message.data)
        except _EnoughError:
            self.cut += 1
        return taking.facts

    def _check(self) -> None:
        if self.ended():
            raise _EnoughError


class _Taking:
    """Takes the messages of one recording. All values are checked: it may be damaged."""

    def __init__(self) -> None:
        self.facts = DrivenFacts()
        self._last: float | None = None
        self._odometer = Odometer()
        self._reported: tuple[float, float] | None = None
        """When the vehicle reported last, and its speed."""
        self._reboots: int | None = None
        self._heard: float | None = None

    def take(self, topic: Topic, at: float, data: bytes) -> None:
        if not 0.0 < at < _LATEST:
            return
        facts = self.facts
        facts.begin = at if facts.begin is None else min(facts.begin, at)
        facts.end = at if facts.end is None else max(facts.end, at)
        if self._last is not None and 0 < at - self._last <= _GAP:
            facts.seconds += at - self._last
        self._last = at
        told = read_json(data)
        match topic:
            case Topic.ASSESSMENT:
                self._judged(told)
            case Topic.STATUS:
                self._status(at, told)
            case Topic.VEHICLE:
                self._vehicle(at, told)
            case Topic.SETUP:
                facts.model = clean(text_of(told.get("model"))) or facts.model
            case Topic.DECISIONS:
                number = whole_of(told.get("id"), 0, 0xFFFF) or 0
                what, event = (text_of(told.get(name))[:_LONGEST_NAME] for name in ("decision", "event"))
                facts.decisions.append(DecisionSample(at, what, number, event))
            case _:
                target = whole_of(told.get("target"), 0, 0xFFFF) or 0
                facts.answers.append(AnswerSample(at, target, text_of(told.get("result"))[:_LONGEST_NAME]))

    def _judged(self, told: Mapping[str, Any]) -> None:
        age = number_of(told.get("age"), 0.0, _LONGEST_AGE)
        if age is not None:
            self.facts.ages.append(age)
            self.facts.faulty += "fault" in list_of(told.get("reasons"))

    def _status(self, at: float, told: Mapping[str, Any]) -> None:
        facts, camera, computer = self.facts, mapping_of(told.get("camera")), mapping_of(told.get("computer"))
        pid = whole_of(told.get("pid"), 1, 2**31) or 0
        size = whole_of(camera.get("width"), 0, 1e5) or 0, whole_of(camera.get("height"), 0, 1e5) or 0
        rate, read = number_of(camera.get("rate"), 0.0, 1e4), whole_of(camera.get("read"), 0, 1e15) or 0
        trouble = bool(mapping_of(told.get("vision")).get("trouble"))
        facts.camera.append(CameraSample(at, pid, read, rate, size, trouble))
        if (degrees := number_of(computer.get("temperature"), -50.0, 150.0)) is not None:
            facts.temperatures.append(degrees)
        if isinstance(computer.get("throttled"), bool):
            facts.throttled.append(computer["throttled"])

    def _vehicle(self, at: float, told: Mapping[str, Any]) -> None:
        facts = self.facts
        heard, speed = number_of(told.get("heard_at"), 0.0, _LATEST), number_of(told.get("speed"), 0.0, 100.0)
        if heard is not None:
            if self._heard is not None and heard > self._heard:
                facts.gaps.append(heard - self._heard)
            self._heard = heard
        names = ("system_id", "autopilot", "type")
        system, autopilot, kind = (whole_of(told.get(name), 0, 255) for name in names)
        few = len(facts.vehicles) < _MOST_VEHICLES
        if few and system is not None and autopilot is not None and kind is not None:
            facts.vehicles.add((system, autopilot, kind))
        reboots = whole_of(told.get("reboots"), 0, 1e6)
        if reboots is not None:
            facts.reboots += max(0, reboots - self._reboots) if self._reboots is not None else 0
            self._reboots = reboots
        place = [number_of(one, -180.0, 180.0) for one in list_of(told.get("position"))[:2]]
        if len(place) == 2 and place[0] is not None and place[1] is not None:
            facts.metres = self._odometer.travelled((place[0], place[1], None)) or 0.0
        if self._reported is not None and self._reported[1] > MOVES and 0 < at - self._reported[0] <= _GAP:
            facts.moved += at - self._reported[0]
        self._reported = None if speed is None else (at, speed)
