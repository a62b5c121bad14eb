"""Reads what the rover's own recordings tell of its drives: the newest first, for a bounded time."""

from __future__ import annotations

import time
from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from anytraverse.decoding import decode
from anytraverse.errors import AnyTraverseError
from companion.observers.recording.contents import read_json
from companion.observers.recording.foxglove import NS, jpeg_of
from companion.observers.recording.recorder import missing
from companion.observers.recording.ring import FOLDER, recordings
from companion.observers.recording.topics import TOPICS, Topic
from companion.vehicle.state import MOVES, Odometer
from companion.wire.json_values import list_of, mapping_of, number_of, text_of, whole_of
from companion.wire.packing import clean

LONGEST = 120.0
"""Seconds of reading. Recordings that are older than what was read by then are left out, and counted."""
_LONGEST_AGE, _LATEST = 60.0, 1e11
_GAP = 2.0
"""Seconds between two reports of the vehicle beyond which it is not known what it did."""
_READ = frozenset(
    {Topic.ASSESSMENT, Topic.STATUS, Topic.VEHICLE, Topic.DECISIONS, Topic.REQUESTS, Topic.ACKNOWLEDGEMENTS}
    | {Topic.CAMERA, Topic.SETUP}
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
    """A decision. what: its name, e.g. "call opened". content: all that was recorded of it."""

    at: float
    what: str
    id: int
    content: Mapping[str, Any]


class AnswerSample(NamedTuple):
    """An acknowledged answer. target: the call's or hold's id. result: by name, e.g. "applied"."""

    at: float
    target: int
    result: str


class ModeSample(NamedTuple):
    """A mode that the autopilot reported anew."""

    at: float
    mode: int
    armed: bool


@dataclass
class DrivenFacts:
    """What the recordings tell, in the order of time. Times are seconds since 1970, unless said otherwise.

    files, unread: recordings that were read, and older ones that were not. trouble: why none could be.
    judged: when each frame was captured. ages: seconds from then until it was judged. faulty: whether it was
    a fault. model: of the perceiver. camera: about once a second.
    statuses: the newest status of each run of the companion, by its process, with its time.
    heard: heartbeats of the autopilot, monotonic seconds of the companion. vehicles: system id, MAV_AUTOPILOT
    and MAV_TYPE of those heard. reboots: of the autopilot. metres, moved: the way, and seconds of motion.
    light: when, and the mean brightness of a frame, of 255: one a recording.
    """

    files: int = 0
    unread: int = 0
    trouble: str = ""
    begin: float | None = None
    end: float | None = None
    seconds: float = 0.0
    judged: array[float] = field(default_factory=lambda: array("d"))
    ages: array[float] = field(default_factory=lambda: array("f"))
    faulty: bytearray = field(default_factory=bytearray)
    model: str = ""
    camera: list[CameraSample] = field(default_factory=list)
    temperatures: list[float] = field(default_factory=list)
    throttled: list[bool] = field(default_factory=list)
    statuses: dict[int, tuple[float, Mapping[str, Any]]] = field(default_factory=dict)
    decisions: list[DecisionSample] = field(default_factory=list)
    answers: list[AnswerSample] = field(default_factory=list)
    senders: set[tuple[int, int]] = field(default_factory=set)
    heard: array[float] = field(default_factory=lambda: array("d"))
    vehicles: set[tuple[int, int, int]] = field(default_factory=set)
    modes: list[ModeSample] = field(default_factory=list)
    reboots: int = 0
    metres: float = 0.0
    moved: float = 0.0
    light: list[tuple[float, float]] = field(default_factory=list)

    def add(self, later: DrivenFacts) -> None:
        """Append what a later recording tells."""
        self.files += 1
        self.begin = later.begin if self.begin is None else self.begin
        self.end = later.end if later.end is not None else self.end
        self.model = later.model or self.model
        if self.modes and later.modes and self.modes[-1][1:] == later.modes[0][1:]:
            del later.modes[0]  # each recording begins with what holds
        for name in ("seconds", "reboots", "metres", "moved"):
            setattr(self, name, getattr(self, name) + getattr(later, name))
        for name in (
            "judged",
            "ages",
            "faulty",
            "camera",
            "temperatures",
            "throttled",
            "decisions",
            "answers",
        ):
            getattr(self, name).extend(getattr(later, name))
        for name in ("heard", "modes", "light"):
            getattr(self, name).extend(getattr(later, name))
        for name in ("statuses", "senders", "vehicles"):
            getattr(self, name).update(getattr(later, name))


def read_drives(
    folder: Path, tell: Callable[[int, int], object] = lambda _done, _of: None, longest: float = LONGEST
) -> DrivenFacts:
    """Read the recordings in a companion's state folder. Raises OSError.

    tell: called with how many are read, and of how many. longest: see `LONGEST`.
    """
    whole = DrivenFacts()
    if trouble := missing():
        whole.trouble = trouble
        return whole
    until, found = time.monotonic() + longest, recordings(folder / FOLDER)
    each = list[DrivenFacts]()
    for number, one in enumerate(reversed(found)):
        tell(number, len(found))
        try:
            each.append(_facts_of(folder / FOLDER / one.name, until))
        except TimeoutError:
            break
    for facts in reversed(each):
        whole.add(facts)
    whole.unread = len(found) - len(each)
    return whole


def _facts_of(path: Path, until: float) -> DrivenFacts:
    """Read one recording. Raises TimeoutError after `until`, monotonic seconds, and OSError."""
    from companion.observers.recording.reading import messages

    def check() -> None:
        if time.monotonic() > until:
            raise TimeoutError

    taking = _Taking()
    topics = {TOPICS[topic].name: topic for topic in _READ}
    for one in messages(path, list(topics), check=check):
        taking.take(topics[one.channel.topic], one.message.log_time / NS, one.message.data)
    return taking.facts


class _Taking:
    """Takes the messages of one recording. All values are checked: it may be damaged."""

    def __init__(self) -> None:
        self.facts = DrivenFacts()
        self._odometer = Odometer()
        self._reported: tuple[float, float] | None = None
        """When the vehicle reported last, and its speed."""
        self._reboots: int | None = None

    def take(self, topic: Topic, at: float, data: bytes) -> None:
        if not 0.0 < at < _LATEST:
            return
        facts = self.facts
        facts.begin = at if facts.begin is None else min(facts.begin, at)
        facts.end = at if facts.end is None else max(facts.end, at)
        facts.seconds = facts.end - facts.begin
        if topic is Topic.CAMERA:
            self._picture(at, data)
            return
        told = read_json(data)
        match topic:
            case Topic.ASSESSMENT:
                self._judged(at, told)
            case Topic.STATUS:
                self._status(at, told)
            case Topic.VEHICLE:
                self._vehicle(at, told)
            case Topic.SETUP:
                facts.model = clean(text_of(told.get("model"))) or facts.model
            case Topic.DECISIONS:
                number = whole_of(told.get("id"), 0, 0xFFFF) or 0
                facts.decisions.append(DecisionSample(at, text_of(told.get("decision")), number, told))
            case Topic.ACKNOWLEDGEMENTS:
                target = whole_of(told.get("target"), 0, 0xFFFF) or 0
                facts.answers.append(AnswerSample(at, target, text_of(told.get("result"))))
            case _:
                sender = [whole_of(one, 0, 255) for one in list_of(told.get("sender"))]
                if len(sender) == 2 and sender[0] is not None and sender[1] is not None:
                    facts.senders.add((sender[0], sender[1]))

    def _judged(self, at: float, told: Mapping[str, Any]) -> None:
        age = number_of(told.get("age"), 0.0, _LONGEST_AGE)
        if age is not None:
            self.facts.judged.append(at - age)
            self.facts.ages.append(age)
            self.facts.faulty.append("fault" in list_of(told.get("reasons")))

    def _status(self, at: float, told: Mapping[str, Any]) -> None:
        facts, camera, computer = self.facts, mapping_of(told.get("camera")), mapping_of(told.get("computer"))
        pid = whole_of(told.get("pid"), 1, 2**31) or 0
        facts.statuses[pid] = at, told
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
        if heard is not None and (not facts.heard or heard != facts.heard[-1]):
            facts.heard.append(heard)
        names = ("system_id", "autopilot", "type")
        system, autopilot, kind = (whole_of(told.get(name), 0, 255) for name in names)
        if system is not None and autopilot is not None and kind is not None:
            facts.vehicles.add((system, autopilot, kind))
        mode, armed = whole_of(told.get("custom_mode"), 0, 2**32), told.get("armed") is True
        if mode is not None and (not facts.modes or facts.modes[-1][1:] != (mode, armed)):
            facts.modes.append(ModeSample(at, mode, armed))
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

    def _picture(self, at: float, data: bytes) -> None:
        if not self.facts.light and (level := _brightness(data)) is not None:
            self.facts.light.append((at, level))


def _brightness(message: bytes) -> float | None:
    """Return the mean brightness of a recorded frame, of 255; None for what is none."""
    try:
        found = decode(jpeg_of(message))
    except (AnyTraverseError, ImportError, ValueError):
        return None
    return None if found is None else float(found.mean())
