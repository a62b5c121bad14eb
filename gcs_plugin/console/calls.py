"""What became of each call of one rover: its pictures, the answers from here, what the rover said."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from companion.wire.answers import ForgetCall, ForgetWord, Operation, SetWord, TapBox
from companion.wire.ids import CHANGING_RESULTS, Kind, Motion, Outcome, Reasons, Result, Stage
from companion.wire.texts import name
from gcs_plugin.client.delivery import Pending, Status
from gcs_plugin.client.documents import CallRecord
from gcs_plugin.client.rovers import Call, Rover
from gcs_plugin.console import wording as own_wording
from gcs_plugin.terminal import wording
from gcs_plugin.terminal.output import STATUS_TEXTS, plain
from gcs_plugin.terminal.pictures import jpeg_size

SHOWN = 24
"""Calls of a rover that are shown, the newest ones."""
MOST_SAID = 12
_ABOUT = re.compile(r"[CH](\d{1,5}) ", re.ASCII)
_ASKS = ("go/stay/word", "go?")
_DRIVES = frozenset({"AUTO", "GUIDED", "AUTO.MISSION", "OFFBOARD"})
_APPLIED = frozenset({"applied", "applied_not_remembered", "not_covered"})
_WELL = CHANGING_RESULTS - {Result.NOT_COVERED}
_CLOSED_BY_ANSWER = (Outcome.ANSWERED, Outcome.ACCEPTED)


@dataclass(frozen=True)
class Answered:
    """An answer from here. words: weight by word before it."""

    pending: Pending
    at: float
    words: Mapping[str, float]

    @property
    def applied(self) -> bool:
        ack = self.pending.acknowledgement
        return ack is not None and ack.result in CHANGING_RESULTS


@dataclass
class Story:
    """One call or hold. serial: as of `Call`; 0 for one that only its record tells of. opened: seconds since
    1970. pictures: JPEG by "small" and "large". revision: rises when a picture is replaced.
    """

    id: int
    serial: int
    opened: float
    pictures: dict[str, bytes] = field(default_factory=dict)
    revision: int = 0
    answers: list[Answered] = field(default_factory=list)
    said: deque[tuple[float, str]] = field(default_factory=lambda: deque(maxlen=MOST_SAID))
    record: CallRecord | None = None
    undone: Pending | None = None
    closed_at: float | None = None
    driven_on: bool = False

    def keep(self, size: str, content: bytes) -> None:
        """Keep a picture, if it is one."""
        if jpeg_size(content) is not None:
            self.pictures[size] = content
            self.revision += 1


class Stories:
    """The calls of one rover by id, the newest `SHOWN` of them."""

    def __init__(self, system: int) -> None:
        self._system = system
        self.by_id: dict[int, Story] = {}

    def follow(self, rover: Rover, wall: float, now: float) -> list[Story]:
        """Take in the rover's calls. Returns those that are new. wall: seconds since 1970."""
        fresh = []
        for call in rover.calls.values():
            known = self.by_id.get(call.data.id)
            if known is None or (known.serial and known.serial != call.serial):
                known = Story(call.data.id, call.serial, wall - call.age(now))
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

    def remember(self, record: CallRecord) -> Story | None:
        """Take in the record of a call before this console began; None for one that is known otherwise."""
        if record.id in self.by_id or len(self.by_id) >= SHOWN:
            return None
        began = (one.at for one in record.answers if one.at is not None)
        opened = next(began, record.closed) or 0.0
        self.by_id[record.id] = story = Story(record.id, 0, opened, record=record, closed_at=record.closed)
        return story

    def hear(self, text: str, wall: float) -> None:
        """Take in a text of the companion, which may be about a call. Those that only ask are left out."""
        about = None if text.endswith(_ASKS) else _ABOUT.match(text)
        story = self.by_id.get(int(about[1])) if about else None
        if story is not None and (not story.said or story.said[-1][1] != wording.clean(text)):
            story.said.append((wall, wording.clean(text)))

    def answered(self, pending: Pending, words: Mapping[str, float], wall: float) -> None:
        """Take note of an answer that leaves from here."""
        story = self.by_id.get(pending.target)
        if story is not None:
            story.answers.append(Answered(pending, wall, dict(words)))

    def others_were_first(self, call: Call) -> bool:
        """Whether the call was answered, and not from here."""
        story = self.by_id.get(call.data.id)
        if story is None or any(one.applied for one in story.answers):
            return False
        stale = any(
            one.pending.acknowledgement is not None and one.pending.acknowledgement.result is Result.STALE
            for one in story.answers
        )
        closed = call.data.stage is Stage.CLOSED and call.data.outcome in _CLOSED_BY_ANSWER
        return call.data.stage is Stage.ANSWERED or closed or stale

    def undo(self, number: int) -> tuple[Operation, ...]:
        """Return what takes back the answers to a call: its scene is forgotten, its words are as before."""
        story = self.by_id.get(number)
        applied = [one for one in story.answers if one.applied] if story is not None else []
        if not applied:
            return ()
        before = applied[0].words
        touched = {
            change.word: None
            for one in applied
            for change in one.pending.operations
            if isinstance(change, SetWord | TapBox)
        }
        restored = (SetWord(word, before[word]) if word in before else ForgetWord(word) for word in touched)
        return (ForgetCall(number), *restored)

    @staticmethod
    def _has_driven_on(story: Story, call: Call, rover: Rover) -> bool:
        went = any(one.applied and one.pending.motion is Motion.GO for one in story.answers)
        vehicle = rover.vehicle
        drives = vehicle is not None and vehicle.armed and vehicle.mode in _DRIVES
        return went and drives and not call.data.holding and call.data.stage is Stage.CLOSED

    def documents(self, rover: Rover, now: float, ids: tuple[int, int] | None) -> list[dict[str, Any]]:
        """Return all calls for the page, the open ones first, then the newest."""
        ordered = sorted(self.by_id.values(), key=lambda one: (_is_open(rover.calls.get(one.id)), one.opened))
        return [self._document(story, rover.calls.get(story.id), now, ids) for story in reversed(ordered)]

    def _document(
        self, story: Story, call: Call | None, now: float, ids: tuple[int, int] | None
    ) -> dict[str, Any]:
        shown: dict[str, Any] = {
            "id": story.id,
            "key": f"{story.id}-{story.serial}",
            "opened": round(story.opened, 2),
            "closed": story.closed_at and round(story.closed_at, 2),
            "pictures": {
                size: f"/pictures/{self._system}/{story.id}/{size}.jpg?v={story.serial}.{story.revision}"
                for size in story.pictures
            },
            "size": _frame_size(story),
            "answers": [_answer(one) for one in story.answers],
            "said": [{"at": round(at, 2), "text": text} for at, text in story.said],
            "undo": bool(self.undo(story.id)) and story.undone is None,
            "undone": None if story.undone is None else _status(story.undone),
        }
        if call is None:
            return shown | _recorded(story)
        data = call.data
        others = self.others_were_first(call)
        first = None
        if others and story.record is not None:
            first = next((one for one in story.record.answers if one.result in _APPLIED), None)
        return shown | {
            "name": name(data.kind, data.id),
            "kind": plain(data.kind),
            "stage": plain(data.stage),
            "open": call.open,
            "test": data.test,
            "reasons": plain(data.reasons),
            "reason": own_wording.reason(data),
            "figures": own_wording.figures(data),
            "todo": own_wording.what_to_do(data),
            "stands": own_wording.stands(data),
            "holding": data.holding,
            "since": round(now - call.age(now), 2),
            "frame": data.frame_id,
            "roi": data.roi,
            "box": data.worst_tile_box if own_wording.points(data) else None,
            "place": None if data.latitude is None else [data.latitude, data.longitude, data.heading],
            "outcome": "" if call.open else wording.outcome(data.outcome, test=data.test),
            "first": "" if not others else own_wording.first_answer(first, ids) if first is not None
            else "Another operator answered first.",
        }  # fmt: skip


def _is_open(call: Call | None) -> bool:
    return call is not None and call.open


def _recorded(story: Story) -> dict[str, Any]:
    """Return what the record of an older call tells."""
    record = story.record
    reasons = record.reasons if record is not None else Reasons.NONE
    given = record.answers if record is not None else ()
    return {
        "name": name(Kind.CALL, story.id),
        "kind": "call",
        "stage": "closed",
        "open": False,
        "reasons": plain(reasons),
        "reason": ", ".join(str(one).replace("_", " ") for one in plain(reasons)),
        "figures": "",
        "outcome": "" if record is None else wording.clean(record.outcome).replace("_", " "),
        "given": [
            wording.clean(", ".join(filter(None, (*one.operations, one.motion.replace("_", " "), one.text))))
            for one in given
        ],
        "box": record.worst_tile_box if record is not None else None,
        "place": [record.latitude, record.longitude, None]
        if record and record.latitude is not None
        else None,
    }


def _frame_size(story: Story) -> list[int] | None:
    """Return width and height of the small picture, which shows the whole frame."""
    size = jpeg_size(story.pictures.get("small", b""))
    return None if size is None else list(size)


def _status(pending: Pending) -> str:
    ack = pending.acknowledgement
    if ack is not None and pending.status is Status.ACKNOWLEDGED:
        return wording.result(ack)
    return STATUS_TEXTS[pending.status]


def _answer(one: Answered) -> dict[str, Any]:
    pending = one.pending
    ack = pending.acknowledgement
    settled = ack.result if ack is not None and pending.status is Status.ACKNOWLEDGED else None
    return {
        "at": round(one.at, 2),
        "said": own_wording.answer(pending.motion, pending.operations),
        "text": _status(pending),
        "tone": "wait" if not pending.settled else "good" if settled in _WELL else "bad",
        "settled": pending.settled,
    }
