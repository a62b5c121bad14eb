"""What became of each call of one rover: its pictures, the answers from here, what the rover said."""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Any

from anytraverse.operations import Operation
from anytraverse.picture_size import jpeg_size
from companion.pages import wording as browser_wording
from companion.pages.calls import named_thing, nearest, shown
from companion.pages.given import Answered, OwnAnswers
from companion.wire.call_figures import asked
from companion.wire.call_report import CallReport
from companion.wire.ids import Motion, Outcome, Stage
from companion.wire.packing import clean
from gcs_plugin.client.faults import FaultTally
from gcs_plugin.client.rovers import TrackedCall, TrackedRover
from gcs_plugin.terminal import wording
from gcs_plugin.terminal.output import plain

SHOWN = 24
"""Calls of a rover that are shown, the newest ones."""
MOST_SAID = 12
_ABOUT = re.compile(r"[CH](\d{1,5}) ", re.ASCII)
_ASKS = ("/word", "go?")
_DRIVES = frozenset({"AUTO", "GUIDED", "AUTO.MISSION", "OFFBOARD"})
_CLOSED_BY_ANSWER = (Outcome.ANSWERED, Outcome.ACCEPTED)


@dataclass
class CallStory:
    """One call or hold. serial: as of `TrackedCall`; 0 where only the record is known. opened: seconds since
    1970. pictures: JPEG by "small", "raw", "large" and "nearest". revision: rises when a picture is replaced.
    record: as it was read last; reads: how often it was asked for.
    """

    id: int
    serial: int
    opened: float
    pictures: dict[str, bytes] = field(default_factory=dict)
    revision: int = 0
    own: OwnAnswers = field(default_factory=OwnAnswers)
    said: deque[tuple[float, str]] = field(default_factory=lambda: deque(maxlen=MOST_SAID))
    faults: FaultTally = field(default_factory=FaultTally)
    record: CallReport | None = None
    reads: int = 0
    closed_at: float | None = None
    driven_on: bool = False

    def first_answer(self, own: tuple[int, int] | None) -> str:
        """Say by its record who answered first, "" where that is not known. own: this console's ids."""
        return browser_wording.first_answer(self.record, own) if self.record is not None else ""

    def keep(self, size: str, content: bytes) -> None:
        """Keep a picture, if it is one."""
        if jpeg_size(content) is not None:
            self.pictures[size] = content
            self.revision += 1


class Stories:
    """The calls of one rover by id, the newest `SHOWN` of them."""

    def __init__(self, system: int) -> None:
        self._system = system
        self.by_id: dict[int, CallStory] = {}

    def follow(self, rover: TrackedRover, wall: float, now: float) -> list[CallStory]:
        """Take in the rover's calls. Returns those that are new. wall: seconds since 1970."""
        fresh = []
        for call in rover.calls.values():
            known = self.by_id.get(call.data.id)
            if known is None or (known.serial and known.serial != call.serial):
                known = CallStory(call.data.id, call.serial, wall - call.age(now))
                self.by_id.pop(call.data.id, None)
                self.by_id[call.data.id] = known
                fresh.append(known)
            known.serial = call.serial
            if call.open:
                known.closed_at = None
            elif known.closed_at is None:
                known.closed_at = wall
            newest = max(self.by_id.values(), key=lambda one: one.opened) is known
            if newest and not known.driven_on and self._has_driven_on(known, call, rover):
                known.driven_on = True
                known.said.append(
                    (wall, f"The rover drives on ({rover.vehicle.mode})." if rover.vehicle else "")
                )
        while len(self.by_id) > SHOWN:
            closed = (number for number, one in self.by_id.items() if not _is_open(rover.calls.get(number)))
            self.by_id.pop(next(closed, next(iter(self.by_id))))
        return fresh

    def remember(self, record: CallReport) -> CallStory | None:
        """Take in the record of a call before this console began; None for one that is known otherwise."""
        if record.id in self.by_id or len(self.by_id) >= SHOWN:
            return None
        began = (one.at for one in record.answers if one.at is not None)
        opened = next(began, record.closed) or 0.0
        self.by_id[record.id] = story = CallStory(
            record.id, 0, opened, record=record, closed_at=record.closed
        )
        return story

    def hear(self, text: str, wall: float) -> None:
        """Take in a text of the companion, which may be about a call. Those that only ask are left out."""
        about = None if text.endswith(_ASKS) or asked(text) else _ABOUT.match(text)
        story = self.by_id.get(int(about[1])) if about else None
        if story is not None and (fault := story.faults.take(text, wall)) is not None:
            if story.said and " FAULT " in story.said[-1][1]:
                story.said.pop()
            story.said.append((wall, clean(fault[1])))
        elif story is not None and (not story.said or story.said[-1][1] != clean(text)):
            story.said.append((wall, clean(text)))

    def answered(self, given: Answered) -> None:
        """Take note of an answer that leaves from here."""
        story = self.by_id.get(given.pending.answer.target)
        if story is not None:
            story.own.answers.append(given)

    def others_were_first(self, call: TrackedCall) -> bool:
        """Whether the call was answered, and not from here."""
        story = self.by_id.get(call.data.id)
        if story is None or story.own.applied:
            return False
        closed = call.data.stage is Stage.CLOSED and call.data.outcome in _CLOSED_BY_ANSWER
        return call.data.stage is Stage.ANSWERED or closed or story.own.too_late

    def undo(self, number: int) -> tuple[Operation, ...]:
        """Return what takes back the answers to a call: its scene is forgotten, its words are as before."""
        story = self.by_id.get(number)
        return story.own.undoing() if story is not None else ()

    @staticmethod
    def _has_driven_on(story: CallStory, call: TrackedCall, rover: TrackedRover) -> bool:
        went = any(
            one.pending.applied and one.pending.answer.motion is Motion.GO for one in story.own.answers
        )
        vehicle = rover.vehicle
        drives = vehicle is not None and vehicle.armed and vehicle.mode in _DRIVES
        return went and drives and not call.data.holding and call.data.stage is Stage.CLOSED

    def documents(
        self,
        rover: TrackedRover,
        now: float,
        ids: tuple[int, int] | None,
        alike: float | None,
        told_open: CallReport | None = None,
    ) -> list[dict[str, Any]]:
        """Return all calls for the page, the open ones first, then the newest.

        alike: the similarity from which two scenes count as one. told_open: what /state.json told of the open
        one.
        """
        ordered = sorted(self.by_id.values(), key=lambda one: (_is_open(rover.calls.get(one.id)), one.opened))
        return [self._document(story, rover, now, ids, alike, told_open) for story in reversed(ordered)]

    def _nearest(self, story: CallStory, alike: float | None) -> dict[str, Any] | None:
        """Return what was answered in the scene most like a call's."""
        found = story.record.nearest if story.record is not None else None
        if found is None:
            return None
        there = self.by_id.get(found.call_id or 0)
        said, motion, named = "the answer was", "", None
        if there is not None:
            own = [plain(one.pending.answer.motion) for one in there.own.answers if one.pending.applied]
            given = [one.motion for one in there.record.answers] if there.record is not None else []
            said = "you said" if own else said
            motion = browser_wording.newest_motion(own or given)
            named = named_thing(there.own, there.record)
        picture = self._url(story, "nearest")
        if not picture and there is not None:
            picture = self._url(there, "small")
        return nearest(found, said, motion, alike, picture, named)

    def _url(self, story: CallStory, size: str) -> str:
        if size not in story.pictures:
            return ""
        return f"/pictures/{self._system}/{story.id}/{size}.jpg?v={story.serial}.{story.revision}"

    def _document(
        self,
        story: CallStory,
        rover: TrackedRover,
        now: float,
        ids: tuple[int, int] | None,
        alike: float | None,
        told_open: CallReport | None,
    ) -> dict[str, Any]:
        record, call = story.record, rover.calls.get(story.id)
        report = call.data if call is not None else record
        if report is not None and told_open is not None and told_open.id == report.id:
            # The radio's report has no room for these.
            report = replace(report, distance=told_open.distance, why=report.why or told_open.why)
        told = shown(
            report or CallReport(story.id),
            story.own,
            key=f"{story.id}-{story.serial}",
            pictures={size: self._url(story, size) for size in story.pictures},
            said=[{"at": round(at, 2), "text": text} for at, text in story.said],
            nearest=self._nearest(story, alike),
            since=now - call.age(now) if call is not None else None,
        ) | {
            "opened": round(story.opened, 2),
            "closed": story.closed_at and round(story.closed_at, 2),
            "size": _frame_size(story),
        }
        if call is not None:
            data, others = call.data, self.others_were_first(call)
            place = None if data.latitude is None else [data.latitude, data.longitude, data.heading]
            outcome = "" if call.open else wording.outcome(data.outcome, test=data.test)
            first = (others and (story.first_answer(ids) or "Another operator answered first.")) or ""
            return told | {"place": place, "outcome": outcome, "first": first}
        if record is None:
            return told | {"reason": ""}
        return told | {
            "given": list(map(browser_wording.answered, record.answers)),
            "place": None if record.latitude is None else [record.latitude, record.longitude, None],
        }


def _is_open(call: TrackedCall | None) -> bool:
    return call is not None and call.open


def _frame_size(story: CallStory) -> list[int] | None:
    """Return width and height of the small picture, which shows the whole frame."""
    size = jpeg_size(story.pictures.get("small", b""))
    return None if size is None else list(size)
