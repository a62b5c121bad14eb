"""Makes what the recorder writes, of what the daemon sees and does; nothing while nobody records."""

from __future__ import annotations

import logging
import platform
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import wraps
from typing import Any, Concatenate, ParamSpec, Protocol, get_args

from anytraverse.assessment import Assessment
from anytraverse.memory import Memory
from anytraverse.release import own_version
from companion.calls.decisions import CallOpened, Decision, HoldShown
from companion.calls.machine import OperatorCalls
from companion.daemon.answers.handler import Reply
from companion.daemon.settings.service import SettingsService
from companion.daemon.turn import Decided, Event, Observer, Turn
from companion.link.inbound import ParameterRequest, PolicyRequest, ResetRequest
from companion.observers.recording import contents
from companion.observers.recording.foxglove import NS
from companion.observers.recording.messages import RecordedMessage
from companion.observers.recording.topics import Topic
from companion.system.error_guard import ErrorGuard
from companion.system.log_lines import brief
from companion.vehicle.state import WallClock
from companion.vision.client import VisionClient, VisionResult
from companion.vision.messages import Encoded, FrameJudged, GroundMap, Planned
from companion.wire.answers import Answer
from companion.wire.ids import State
from companion.wire.texts import REASONS

_P = ParamSpec("_P")
_LOOKED_EVERY = 0.2
_CLOCK_SET = 0.5
"""Seconds by which the clock must differ from what it said before to count as set anew."""
_MOST_LINES, _OLDEST_LINE = 200, 30.0
"""Log lines that wait, and the seconds after which one that nobody recorded is left out."""
_MOST_WAITING = 500
"""Messages that wait for the end of the turn."""
_REMEMBERED = 8
_DECISIONS = get_args(Decision)


class _Lines(logging.Handler):
    """Keeps log lines of any thread with their monotonic time. A full list drops its oldest line."""

    def __init__(self) -> None:
        super().__init__()
        self.found: deque[tuple[float, int, str, str]] = deque(maxlen=_MOST_LINES)

    def emit(self, record: logging.LogRecord) -> None:
        try:
            text = brief(record)
        except Exception:  # a wrong format in a log call must not end the daemon: stderr tells of it
            return
        self.found.append((time.monotonic(), record.levelno, record.name, text))


def _if_recorded(
    method: Callable[Concatenate[Recording, _P], None],
) -> Callable[Concatenate[Recording, _P], None]:
    """Call a method only while somebody records. An error costs what is recorded, and nothing else."""

    @wraps(method)
    def guarded(self: Recording, /, *given: _P.args, **named: _P.kwargs) -> None:
        if self.on:
            with self.guard.survived("recording", time.monotonic()):
                method(self, *given, **named)

    return guarded


class Feed(Protocol):
    """Takes what is recorded, see `FedService`."""

    @property
    def listener(self) -> int:
        """The number of its process, 0: there is none."""

    def feed(self, messages: Iterable[RecordedMessage], now: float) -> None:
        """Send the process messages."""


class Recording(Observer):
    """Collects messages in each turn. All times that are given are monotonic seconds.

    left_out: frames that were not encoded, because it would have delayed judging, or because they were gone.
    """

    def __init__(
        self,
        vision: VisionClient,
        calls: OperatorCalls,
        settings: SettingsService,
        clock: WallClock,
        *,
        rate: float,
        config: str,
    ) -> None:
        """rate: frames/s that are recorded. config: the one in force, as `format_config` makes it.

        Only once vision is ready.
        """
        assert vision.ready is not None
        self.left_out = 0
        self.guard = ErrorGuard(lambda _now: None)
        self.feeds: Sequence[Feed] = ()
        """The processes that are sent what is recorded."""
        self._listeners: tuple[int, ...] = ()
        self._vision = vision
        self._calls = calls
        self._settings = settings
        self._clock = clock
        self._period = 0.9 / rate
        self._setup = {
            "version": own_version(),
            "python": platform.python_version(),
            "computer": f"{platform.system()} {platform.release()} {platform.machine()}",
            "model": str(vision.ready.model),
            "config": config,
        }
        self._messages: deque[RecordedMessage] = deque(maxlen=_MOST_WAITING)
        self._lines = _Lines()
        self._offset = clock.stamp() - time.monotonic()
        """Seconds since 1970 at second 0 of the monotonic clock."""
        self._encoded_at = self._looked_at = float("-inf")
        self._position_at: float | None = None
        self._encoding: tuple[Assessment, State] | None = None
        self._owed: Assessment | None = None
        """The frame of a call, which is recorded whatever the rate."""
        self._encoded: deque[int] = deque(maxlen=_REMEMBERED)
        """Ids of the frames that were encoded last."""
        self._memory: Memory | None = None
        self._last: dict[Topic, Any] = {}
        """The newest content of each topic that is recorded when it changes."""

    @property
    def on(self) -> bool:
        """Whether somebody records or watches."""
        return any(self._listeners)

    @property
    def listeners(self) -> tuple[int, ...]:
        """The processes that are told, each by its number, 0: there is none. A new one is told what holds."""
        return self._listeners

    @listeners.setter
    def listeners(self, listeners: tuple[int, ...]) -> None:
        if listeners != self._listeners:
            self._listeners = listeners
            self._last.clear()
            self._memory = None

    @contextmanager
    def log_lines(self) -> Iterator[None]:
        """Record what is logged within the block."""
        root = logging.getLogger()
        root.addHandler(self._lines)
        try:
            yield
        finally:
            root.removeHandler(self._lines)

    def see(self, turn: Turn) -> None:
        """Record what has changed: state, words, settings, vehicle, log. Then feed those who record."""
        self._look(turn)
        if self.feeds:
            messages = self.take()
            for feed in self.feeds:
                feed.feed(messages, turn.now)
            self.listeners = tuple(feed.listener for feed in self.feeds)

    @_if_recorded
    def happened(self, event: Event, turn: Turn) -> None:
        """Record what happened."""
        match event:
            case VisionResult(FrameJudged() as judged):
                self._judged(judged, turn.state, turn.now)
            case VisionResult(Encoded() as encoded):
                self._encoded_frame(encoded)
            case VisionResult(GroundMap(content)):
                self._add(Topic.GROUND, content.at, contents.grid(content, self._ns(content.at)))
            case VisionResult(Planned(plan)):
                self._add(Topic.PLAN, plan.at, contents.as_json(contents.plain(plan._asdict())))
            case Answer() | ParameterRequest() | ResetRequest() | PolicyRequest():
                request = {"request": type(event).__name__, **contents.plain(event)}
                self._add(Topic.REQUESTS, turn.now, contents.as_json(request))
            case Reply(_, ack):
                data = contents.as_json(contents.plain(ack))
                self._add(Topic.ACKNOWLEDGEMENTS, turn.now, data, event=bool(ack.target))
            case Decided(decision):
                self._decided(decision, turn.now)

    def _judged(self, judged: FrameJudged, state: State, now: float) -> None:
        """Record an assessment, and have its frame encoded where one is due."""
        seen = judged.assessment
        content = contents.assessment(seen, judged.at, judged.duration, judged.sectors)
        self._add(Topic.ASSESSMENT, judged.at, content, seen.frame.id)
        if now - self._encoded_at >= self._period and self._encode(seen, state):
            self._encoded_at = now

    def _encoded_frame(self, encoded: Encoded) -> None:
        """Record an encoded frame with its maps."""
        asked, self._encoding = self._encoding, None
        if asked is None or asked[0].frame.id != encoded.frame_id:
            return
        if not encoded.picture:
            self.left_out += 1
            self._encoded_at = float("-inf")  # the next one, then
            return
        seen, state = asked
        at, number = seen.frame.captured_at, seen.frame.id
        self._add(Topic.CAMERA, at, contents.image(encoded.picture, "jpeg", self._ns(at)), number)
        for topic, png in (
            (Topic.TRAVERSABILITY, encoded.traversability),
            (Topic.UNCERTAINTY, encoded.uncertainty),
        ):
            if png:
                self._add(topic, at, contents.image(png, "png", self._ns(at)), number)
        region = self._calls.numbers.at(seen).judging.region
        reasons = ", ".join(sorted(REASONS[reason.value] for reason in seen.reasons))
        title = f"{number} {state.name}{': ' if reasons else ''}{reasons}"
        self._add(
            Topic.ANNOTATIONS, at, contents.image_annotations(seen, region, title, self._ns(at)), number
        )

    def _decided(self, decision: Decision, now: float) -> None:
        event = isinstance(decision, contents.EVENTS)
        self._add(Topic.DECISIONS, now, contents.decision(decision), event=event)
        match decision:
            case CallOpened(call):
                self._owed = call.seen
            case HoldShown(_, seen):
                self._owed = seen

    @_if_recorded
    def status(self, figures: Mapping[str, Any], now: float) -> None:
        """Record the figures of the status file."""
        self._add(Topic.STATUS, now, contents.as_json(contents.plain(figures)))

    @_if_recorded
    def _look(self, turn: Turn) -> None:
        state, now = turn.state, turn.now
        if self._owed is not None and (
            self._owed.frame.id in self._encoded or self._encode(self._owed, state)
        ):
            self._owed = None
        self._changed(Topic.STATE, self._state(turn), now, event=state is State.FAULT)
        if self._vision.memory is not self._memory:
            self._memory = self._vision.memory
            self._changed(Topic.WORDS, contents.words(self._memory), now)
        if now - self._looked_at >= _LOOKED_EVERY:
            self._looked_at = now
            self._look_around(turn)
        while self._lines.found:
            at, level, name, text = self._lines.found.popleft()
            if now - at < _OLDEST_LINE:
                self._add(Topic.LOG, at, contents.log_line(level, name, text, self._ns(at)))

    def take(self) -> list[RecordedMessage]:
        """Return the messages since the last call."""
        found = list(self._messages)
        self._messages.clear()
        return found

    def _encode(self, seen: Assessment, state: State) -> bool:
        """Have a frame encoded. Whether it will be."""
        if not self._vision.encode(seen.frame.id):
            return False
        self._encoding = seen, state
        self._encoded.append(seen.frame.id)
        return True

    def _state(self, turn: Turn) -> dict[str, Any]:
        calls, open_id = self._calls, turn.current_id
        return {
            "state": turn.state,
            "policy": turn.policy,
            "reasons": calls.reasons(turn.now),
            "open": open_id,
            "kind": calls.kind if open_id else "",
            "stage": calls.stage() if open_id else "",
            "holding": calls.hold is not None and calls.hold.standing,
            "vision": self._vision.trouble,
            "link": turn.link_trouble,
        }

    def _look_around(self, turn: Turn) -> None:
        """Record what changes seldom, or too often."""
        now, vehicle = turn.now, turn.vehicle
        offset = self._clock.stamp() - now
        if abs(offset - self._offset) > _CLOCK_SET:
            self._offset = offset
        self._changed(Topic.SETUP, self._setup, now)
        judging = self._calls.numbers.judging
        self._changed(Topic.SETTINGS, {"parameters": self._settings.settings, "judging": judging}, now)
        if vehicle is None:
            return
        self._changed(Topic.VEHICLE, vehicle, now)
        if vehicle.position is not None and vehicle.position_at != self._position_at:
            self._position_at = vehicle.position_at
            at = vehicle.position_at or now
            self._add(Topic.LOCATION, at, contents.location(*vehicle.position[:2], self._ns(at)))

    def _changed(self, topic: Topic, content: Any, now: float, *, event: bool = False) -> None:
        if self._last.get(topic) != content:
            self._last[topic] = content
            data = content if isinstance(content, bytes) else contents.as_json(contents.plain(content))
            self._add(topic, now, data, event=event)

    def _add(self, topic: Topic, at: float, data: bytes, sequence: int = 0, *, event: bool = False) -> None:
        self._messages.append(RecordedMessage(topic, self._ns(at), data, sequence, event))

    def _ns(self, at: float) -> int:
        """Return ns since 1970."""
        return max(0, round((self._offset + at) * NS))
