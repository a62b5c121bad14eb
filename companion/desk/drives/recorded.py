"""Reads a drive that a rover has recorded: frames, how they were judged, and by which words and settings."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from heapq import heappop, heappush
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from msgspec import ValidationError, convert

from anytraverse.decoding import decode
from anytraverse.errors import AnyTraverseError
from anytraverse.frame import Image, Pose
from anytraverse.ground import RELIABLE, GroundRegion
from anytraverse.judging import Settings
from anytraverse.operations import ForgetWord, SetWord, Tap
from anytraverse.regions import Box
from anytraverse.release import to_install
from companion.desk.drives.drive import DriveError, DriveFrame, printable
from companion.observers.recording.contents import read_json
from companion.observers.recording.foxglove import jpeg_of
from companion.observers.recording.topics import TOPICS, Topic
from companion.vehicle.motion import LARGEST_LEAN
from companion.wire.json_values import number_of
from companion.wire.typed_answers import MOTIONS, CommandError, read_typed
from companion.wire.words_text import operation_text

if TYPE_CHECKING:
    from companion.observers.recording.reading import Read

_NS = 1_000_000_000
_LONGEST_GAP = 3600.0
_JUMP = 1.0
_FARTHEST = 1e7
"""m. No odometry that was recorded goes further."""
_HELD, _MOST_HELD = 64, 32 << 20
"""Frames of a recording, and bytes of their messages, that are held so that their times rise."""
_MOST_TOLD, _OF_A_MESSAGE = 64 << 20, 200
"""Bytes of a file's judgements, words, settings and answers that are held at most; what each takes beside."""


class RecordedFrame(NamedTuple):
    """A frame, and how it was judged. seen: content of its /assessment, {} where it has none.

    words: weight by word, of those in use. tapped: whether one of them was made by taps, which are not
    recorded. judging: of /settings, by what it was judged.
    """

    frame: DriveFrame
    seen: Mapping[str, Any]
    words: Mapping[str, float]
    tapped: bool
    judging: Mapping[str, Any]


@dataclass
class _Standing:
    """What holds from a time on. at: ns since 1970, rising. content: JSON."""

    at: list[int] = field(default_factory=list)
    content: list[bytes] = field(default_factory=list)

    def add(self, at: int, content: bytes) -> None:
        place = bisect_right(self.at, at)
        self.at.insert(place, at)
        self.content.insert(place, content)

    def then(self, at: int) -> Mapping[str, Any]:
        found = bisect_right(self.at, at)
        return read_json(self.content[max(0, found - 1)]) if self.content else {}


@dataclass
class _DriveClock:
    """Turns times since 1970 into seconds of the drive, which rise.

    The computer's clock may be set while it records, and a rover may be off for days between two recordings:
    a step back, or one of over an hour, counts as one second.
    """

    newest: int | None = None
    at: float = 0.1

    def at_next(self, captured: int) -> float:
        """Return the time of the next frame. captured: ns since 1970."""
        if self.newest is not None:
            gap = (captured - self.newest) / _NS
            self.at += gap if 0.0 < gap <= _LONGEST_GAP else _JUMP
        self.newest = captured
        return self.at


class RecordedDrive:
    """Recordings of one drive, in their order: a file, or all of a folder.

    model: the perceiver's id. config: the rover's configuration, TOML of `format_config`.
    """

    def __init__(self, path: Path) -> None:
        """Raises DriveError for what is no recording with frames, and OSError."""
        try:
            from companion.observers.recording.reading import messages
        except ImportError:
            raise DriveError(f"recordings need the package mcap: {to_install('record')}") from None
        if not path.exists():
            raise DriveError(f"{path} is not there: give a recording, or the folder with some")
        self._paths = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
        self.title = printable(path.name)
        names = [TOPICS[Topic.CAMERA].name, TOPICS[Topic.SETUP].name]
        setup: Mapping[str, Any] = {}
        self.count = 0
        for file in self._paths:
            for one in messages(file, names):
                if one.channel.topic == names[0]:
                    self.count += 1
                elif not setup:
                    setup = read_json(one.message.data)
        if not self.count:
            raise DriveError(f"{path} holds no frames of a recording: give one of the .mcap files")
        self.model, self.config = printable(str(setup.get("model", ""))), str(setup.get("config", ""))

    def frames(self) -> Iterator[DriveFrame]:
        """Read all frames in their order."""
        return (one.frame for one in self.recorded())

    def recorded(self) -> Iterator[RecordedFrame]:
        """Read all frames with what was recorded of them. Of the frames at most `_HELD` are held in memory.

        Each start of the companion counts its frames from 1: the second frame 7 is named "frame 7 (2)".
        """
        clock, named = _DriveClock(), Counter[int]()
        for path in self._paths:
            yield from _of_file(path, clock, named)

    def parts(self) -> Iterator[RecordedDrive]:
        """Yield each file with frames as a drive of its own, whose monotonic clock does not start again."""
        for path in self._paths:
            try:
                part = RecordedDrive(path)
            except DriveError:
                continue
            yield part

    def reports(self) -> Iterator[Mapping[str, Any]]:
        """Read what the autopilot reported, contents of /vehicle."""
        for path in self._paths:
            for _, one in _told(path, {TOPICS[Topic.VEHICLE].name: Topic.VEHICLE}):
                yield read_json(one.message.data)

    def answers(self) -> list[tuple[float, str]]:
        """Read the answers to calls: when the call opened, in seconds of the drive, and the answer as typed.

        Only words, taps and motions are told: what forgets a call or a place means nothing on another drive.
        What no operator could have typed is left out: a recording may be damaged.
        """
        topics = {TOPICS[one].name: one for one in (Topic.CAMERA, Topic.DECISIONS, Topic.REQUESTS)}
        clock, found = _DriveClock(), list[tuple[float, str]]()
        opened, newest = dict[int, float](), 0  # a call may be answered in the next file
        for path in self._paths:
            told = [
                (one.message.log_time, topic, b"" if topic is Topic.CAMERA else one.message.data)
                for topic, one in _told(path, topics)
            ]
            for at, topic, data in sorted(told, key=lambda one: one[:2]):
                content = read_json(data)
                if topic is Topic.CAMERA:
                    clock.at_next(at)
                elif content.get("decision") == "call opened":
                    newest = _whole(content.get("id"))
                    opened[newest] = clock.at
                elif content.get("request") == "Answer":
                    line = _typed(content)
                    since = opened.get(_whole(content.get("target")) or newest)
                    if line and since is not None:
                        found.append((since, line))
        return found


def _whole(raw: Any) -> int:
    return raw if isinstance(raw, int) else 0


def _typed(content: Mapping[str, Any]) -> str:
    """Return a recorded answer as an operator types it; "" where nothing is left of it."""
    parts = list[str]()
    operations = content.get("operations")
    for one in operations if isinstance(operations, list) else []:
        match one:
            case {"word": str(word), "weight": float() | int() as weight, "box": [*sides]}:
                if len(sides) != 4 or not all(isinstance(side, float | int) for side in sides):
                    continue
                left, top, right, bottom = map(float, sides)
                parts.append(operation_text(Tap(0, (left, top, right, bottom), word, weight)))
            case {"word": str(word), "weight": float() | int() as weight}:
                parts.append(operation_text(SetWord(word, weight)))
            case {"word": str(word)} if len(one) == 1:
                parts.append(operation_text(ForgetWord(word)))
    motion = str(content.get("motion")).replace("_", " ")  # the name of a `Motion`, "look_again"
    line = ", ".join(filter(None, ("; ".join(parts), motion if motion in MOTIONS else "")))
    try:
        read_typed(line)
    except CommandError:
        return ""
    return line


def _told(path: Path, topics: Mapping[str, Topic]) -> Iterator[tuple[Topic, Read]]:
    """Read what is not a picture, to be held in memory. Raises DriveError for far more than a rover says."""
    from companion.observers.recording.reading import messages

    left = _MOST_TOLD
    for one in messages(path, list(topics)):
        topic = topics[one.channel.topic]
        left -= _OF_A_MESSAGE + (0 if topic is Topic.CAMERA else len(one.message.data))
        if left < 0:
            raise DriveError(f"{path} says more than a rover does in a minute: it is no recording of ours")
        yield topic, one


def _pictures(path: Path) -> Iterator[tuple[int, int, bytes]]:
    """Read the frames: when each was captured, in ns since 1970 and rising, its number, and its message."""
    from companion.observers.recording.reading import messages

    waiting = list[tuple[int, int, bytes]]()
    for one in messages(path, [TOPICS[Topic.CAMERA].name]):
        heappush(waiting, (one.message.log_time, one.message.sequence, one.message.data))
        if len(waiting) > _HELD or sum(len(data) for *_, data in waiting) > _MOST_HELD:
            yield heappop(waiting)
    while waiting:
        yield heappop(waiting)


def _of_file(path: Path, clock: _DriveClock, named: Counter[int]) -> Iterator[RecordedFrame]:
    seen = defaultdict[int, list[tuple[int, bytes]]](list)
    standing = {topic: _Standing() for topic in (Topic.WORDS, Topic.SETTINGS)}
    for topic, one in _told(path, {TOPICS[topic].name: topic for topic in (Topic.ASSESSMENT, *standing)}):
        if topic is Topic.ASSESSMENT:
            seen[one.message.sequence].append((one.message.log_time, one.message.data))
        else:
            standing[topic].add(one.message.log_time, one.message.data)
    for captured, number, data in _pictures(path):
        judged, content = min(seen.get(number, [(captured, b"")]), key=lambda one: abs(one[0] - captured))
        named[number] += 1
        name = f"frame {number}" + (f" ({named[number]})" if named[number] > 1 else "")
        words = standing[Topic.WORDS].then(judged)
        settings = standing[Topic.SETTINGS].then(judged)
        told = read_json(content)
        frame = DriveFrame(
            name,
            clock.at_next(captured),
            partial(_picture, data),
            lean=_lean(told.get("lean")),
            pose=_pose(told.get("pose")),
            reach=number_of(told.get("reach"), 0.0, RELIABLE),
        )
        weights = _mapping(words.get("words"))
        tapped = bool(_mapping(words.get("taps")).keys() & weights.keys())
        yield RecordedFrame(frame, told, weights, tapped, _mapping(settings.get("judging")))


def settings_of(told: Mapping[str, Any], base: Settings) -> Settings:
    """Return the recorded settings, with `base` for what was not recorded. Raises DriveError.

    They are to be judged again, so that a region that the vehicle does not fit in is allowed.
    """
    limits = _mapping(told.get("thresholds"))
    try:
        given = {name: limits[name] for name in ("roi", "scene", "tile", "trav") if name in limits}
        thresholds = replace(base.thresholds, **given)
        tiles = {name: told[name] for name in ("tile_share", "tile_width") if name in told}
        region = Box(**told["region"]) if "region" in told else base.region
        ground = convert(told.get("ground"), GroundRegion | None)
        return replace(
            base, region=region, thresholds=thresholds, misfit_allowed=True, ground=ground, **tiles
        )
    except (AnyTraverseError, TypeError, ValidationError) as error:
        raise DriveError(f"the recorded settings cannot be used: {error}") from error


def _lean(told: Any) -> tuple[float, float] | None:
    """Read how the vehicle leant, None where that was not recorded, or cannot be."""
    if not isinstance(told, list) or len(told) != 2:
        return None
    pitch, bank = (number_of(one, -LARGEST_LEAN, LARGEST_LEAN) for one in told)
    return None if pitch is None or bank is None else (pitch, bank)


def _pose(told: Any) -> Pose | None:
    """Read where the vehicle was, None where that was not recorded, or cannot be."""
    if not isinstance(told, list) or len(told) != 3:
        return None
    x, y, heading = (number_of(one, -_FARTHEST, _FARTHEST) for one in told)
    return None if x is None or y is None or heading is None else Pose(x, y, heading)


def _picture(data: bytes) -> Image | None:
    try:
        found = decode(jpeg_of(data))
    except (AnyTraverseError, ValueError):
        return None
    return None if found is None else np.ascontiguousarray(found[..., ::-1], np.uint8)


def _mapping(raw: Any) -> Mapping[str, Any]:
    return raw if isinstance(raw, dict) else {}
