"""Collects figures of all parts for the status file and /state.json, and writes the status file."""

from __future__ import annotations

import json
import os
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from itertools import islice
from pathlib import Path
from statistics import median
from typing import Any

from anytraverse.history import Place
from anytraverse.release import own_version
from companion.calls.machine import OperatorCalls
from companion.calls.summary import current_data
from companion.daemon.guiding import GuideService
from companion.daemon.records import Records
from companion.daemon.settings.service import SettingsService
from companion.daemon.turn import Observer, Turn
from companion.link.link import Link
from companion.storage.call_files import scene_picture
from companion.storage.writer import Writer
from companion.system.atomic_write import write_atomically
from companion.system.computer import Computer
from companion.vehicle.course import unknown
from companion.vision.client import VisionClient
from companion.wire.call_report import STATE_MEMBERS
from companion.wire.documents import MOST_GIVEN
from companion.wire.ids import VERSION
from companion.wire.json_values import place_document

_DIGITS = 4
_OF_THE_LINK = ("trouble", "autopilot", "dropped_summaries", "lost", "unsaid", "rejected")
_NEWEST = 25
"""Newest frames of which the median latency is reported."""
AHEAD_FRESH = 3.0
"""Seconds after its capture for which a frame tells what is ahead."""


_RATE_OVER, _SAMPLED_EVERY = 10, 0.9
"""Samples, and seconds between two of them, over which the rate of the camera's frames is taken."""
_RECENT = 1200
"""Newest frames whose times are written to the last status file."""


class FrameRate:
    """Calculates frames a second from a counter that is looked at about once a second."""

    def __init__(self) -> None:
        self._samples: deque[tuple[float, int]] = deque(maxlen=_RATE_OVER)

    def update(self, now: float, count: int) -> float | None:
        """Take the counter, and return the rate; None while it is not known. now: monotonic seconds."""
        if self._samples and count < self._samples[-1][1]:  # vision was started again, and counts from 0
            self._samples.clear()
        if not self._samples or now - self._samples[-1][0] >= _SAMPLED_EVERY:
            self._samples.append((now, count))
        (began, first), (ended, last) = self._samples[0], self._samples[-1]
        return round((last - first) / (ended - began), 2) if ended > began else None


class Status(Observer):
    """Observes the judged frames and the place, and reads the parts. It changes none."""

    def __init__(
        self,
        link: Link,
        vision: VisionClient,
        calls: OperatorCalls,
        settings: SettingsService,
        records: Records,
        computer: Computer,
        guide: GuideService,
        *,
        view: int,
    ) -> None:
        """view: the camera's horizontal field of view, degrees, 0: unknown. Only once vision is ready."""
        assert vision.ready is not None
        self._guide = guide
        self._link = link
        self._vision = vision
        self._calls = calls
        self._settings = settings
        self._records = records
        self._view = view
        self._model = vision.ready.model
        self._computer = computer
        self._test_call: Mapping[str, Any] = {}
        self._place = Place()
        self._release = own_version()
        self._is_service = os.environ.get("SYSTEMD_EXEC_PID") == str(os.getpid())
        self._frame_rate = FrameRate()
        self._sectors: tuple[float | None, ...] = ()
        self._judging_s = 0.0
        """Seconds of judging the newest frame."""
        self._latencies: deque[float] = deque(maxlen=_NEWEST)
        """Seconds from capture until judged, of the newest frames."""

    def see(self, turn: Turn) -> None:
        """Take the times of each new frame, and its sectors."""
        self._place, self._test_call = turn.place, turn.test_call
        for judged in turn.judged:
            self._sectors = judged.sectors
            self._judging_s = judged.duration
            self._latencies.append(judged.assessment.age)

    def ahead(self) -> dict[str, Any] | None:
        """Return what was judged of the way ahead; None where no frame of the last `AHEAD_FRESH` s was.

        sectors: drivable share of each image column, from the left, None where nothing is known.
        field_of_view: degrees. traversability, uncertainty: of the region of interest, None unknown.
        """
        newest = self._calls.reason_filter.newest
        if newest is None or time.monotonic() - newest.frame.captured_at > AHEAD_FRESH:
            return None
        return {
            "sectors": self._sectors,
            "field_of_view": self._view,
            "traversability": newest.roi.traversability if newest.roi else None,
            "uncertainty": newest.roi.uncertainty if newest.roi else None,
        }

    def figures(self) -> dict[str, Any]:
        """Return all figures, for the status file: JSON values."""
        newest, camera, rate = self._calls.reason_filter.newest, self._vision.camera, self._vision.rate
        ready, now = self._vision.ready, time.monotonic()
        return {
            "version": self._release,
            "service": self._is_service,
            "state": self._calls.state(now).name.lower(),
            "reasons": sorted(reason.value for reason in self._calls.reasons(now)),
            "current_id": self._calls.current_id,
            "policy": self._calls.policy.name.lower(),
            "held_by": _held_by(self._calls),
            "mission": _mission(self._calls),
            "guide": self._guide.figures(),
            "switches": self._settings.policy.figures(),
            "shadow": self._settings.statistics.figures(),
            "words": self._vision.words.format(),
            "set_by_ground": self._settings.overrides.figures(),
            "known_place": self._known_place(),
            "roi_uncertainty": newest.roi.uncertainty if newest and newest.roi else None,
            "similarity": newest.similarity if newest else None,
            "perceiver": {
                "model": self._model.id,
                "precision": self._model.precision,
                "why": self._model.why,
                "step_ms": round(1e3 * self._judging_s, 1),
                "scene_age": round(newest.scene_age, 3) if newest else None,
                "infrared": self._model.infrared,
                "match_measured": ready is not None and bool(ready.settings.thresholds.match),
            },
            "judging": {
                "rate": round(rate.value, 3),
                "configured": round(rate.steps[0], 3),
                "lowered_by": rate.why,
            },
            "latency_ms": round(1e3 * median(self._latencies), 1) if self._latencies else None,
            "test_call": self._test_call,
            "hold_refused": self._settings.policy.hold_refused,
            "guide_refused": self._settings.policy.guide_refused,
            "course": unknown(self._link.vehicle, now),
            "px4_deadman": self._link.dead_man.state.value,
            "vision": {"trouble": self._vision.trouble, "restarts": self._vision.watchdog.restarted},
            "camera": {
                "state": camera.state.value,
                "reason": camera.reason,
                "read": camera.read,
                "dropped": camera.dropped,
                "rate": self._frame_rate.update(now, camera.read),
                "width": camera.width,
                "height": camera.height,
                "timed_by": camera.timed_by,
                "depth": camera.depth,
                "intrinsics": camera.intrinsics,
                "infrared": self._vision.infrared,
            },
            "computer": self._computer.newest,
            "link": {"trouble": self._link.trouble, **asdict(self._link.counters)},
        }

    def state_file(self) -> dict[str, Any]:
        """Return the most important figures, for /state.json: JSON values, some 2 kB."""
        status, words, place = self.figures(), self._vision.words, self._place
        picture = self._records.picture_of(self._calls.current_id)
        current = current_data(self._calls, words, place, picture, time.monotonic(), measured=True)
        return {
            "version": self._release,
            "protocol": VERSION,
            "model": status["perceiver"]["model"],
            "state": status["state"],
            "policy": status["policy"],
            "hold_refused": status["hold_refused"],
            "guide_refused": status["guide_refused"],
            "px4_deadman": status["px4_deadman"],
            "reasons": status["reasons"],
            "held_by": status["held_by"],
            "mission": status["mission"],
            "latency_ms": status["latency_ms"],
            "judging": status["judging"],
            "open": None if current is None else current.document(STATE_MEMBERS, _DIGITS),
            "known_place": status["known_place"],
            "words": {word: round(words[word], _DIGITS) for word in words},
            "given": self._given(),
            "vocabulary": list(self._settings.words.of.values()),
            "tapped": [word for word in words if word in self._vision.memory.examples],
            "settings": {name: round(value, _DIGITS) for name, value in self._settings.settings.items()},
            "set_by_ground": sorted(status["set_by_ground"]),
            "place": place_document(place),
            "computer": status["computer"],
            "link": {name: status["link"][name] for name in _OF_THE_LINK},
        }

    def _given(self) -> dict[str, float]:
        """Return word -> weight of the words that are out of use, and are still known: the newest ones."""
        newest = islice(self._vision.memory.given.items(), MOST_GIVEN)
        return {word: round(weight, _DIGITS) for word, weight in newest}

    def _known_place(self) -> dict[str, Any] | None:
        """Return which remembered scene is in force by a match, and what it changed; None: none is."""
        memory = self._vision.memory
        adoption = memory.adoption
        if adoption is None or adoption.reference is None:
            return None
        entry = next((one for one in memory.history if one.order == adoption.order), None)
        limits = self._calls.numbers.judging.thresholds
        return {
            "scene": adoption.order,
            "call": adoption.call_id or None,
            "similarity": round(adoption.similarity, _DIGITS),
            "needed": round(limits.least_match(len(memory.history)), _DIGITS),
            "since": None if adoption.time is None else round(adoption.time, 2),
            "changed": {word: list(both) for word, both in memory.matched.items()},
            "picture": "" if entry is None else scene_picture(entry),
        }


def _held_by(calls: OperatorCalls) -> str | None:
    script = calls.holding.script_holds
    if script is not None:
        return f"script: {script.why}"
    if calls.hold is not None and calls.hold.braking:
        return "companion brakes"
    return "companion" if calls.hold is not None and calls.hold.standing else None


def _mission(calls: OperatorCalls) -> dict[str, Any] | None:
    """Return what is known of the mission. over: the vehicle stands after it, and is not held."""
    report, mission = calls.monitor.newest, calls.monitor.newest.mission
    if mission is None:
        return None
    state = mission.state.name.lower()
    return {"state": state, "item": mission.item, "total": mission.total, "over": report.mission_over}


class StatusFile(Observer):
    """Observes which frames are judged, and queues the file for the writer."""

    def __init__(self, writer: Writer, path: Path) -> None:
        self._writer = writer
        self._path = path
        self._frames = 0
        self._recent: deque[tuple[int, float, float]] = deque(maxlen=_RECENT)

    def see(self, turn: Turn) -> None:
        """Count the judged frames."""
        for judged in turn.judged:
            frame = judged.assessment.frame
            self._frames += 1
            self._recent.append((frame.id, frame.captured_at, judged.at))

    def write(self, figures: Mapping[str, Any]) -> dict[str, Any]:
        """Queue the file: figures, number of judged frames, process id and the state of the disk.

        Return its content.
        """
        status = {**figures, "frames": self._frames, "pid": os.getpid(), "disk": self._writer.figures()}
        content = json.dumps(status).encode()
        # It is written again every second: a torn one lasts no longer.
        self._writer.queue_job("status", partial(write_atomically, self._path, content, sync=False))
        return status

    def leave(self, figures: Mapping[str, Any]) -> None:
        """Write everything that waits, within `SLOW` seconds, and last the status file.

        Only this last status file has the times of the newest frames, since that list is long and writing
        wears memory cards out.
        """
        self.write({**figures, "recent": list(self._recent)})
        self._writer.drain()
