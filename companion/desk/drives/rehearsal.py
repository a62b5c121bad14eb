"""Plays a drive and asks somebody at the desk what the rover would ask on it."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from anytraverse.assessment import Assessment, Reason
from anytraverse.errors import AnyTraverseError
from anytraverse.history import Embedding, History, cosine
from anytraverse.memory import Memory
from companion.calls.decisions import Call
from companion.desk.drives.drive import Drive, DriveFrame
from companion.desk.drives.judge import DriveJudge, Judgement, row
from companion.vision.pictures import panel, unmarked
from companion.wire.answers import Answer
from companion.wire.call_report import CallReport, GivenAnswer
from companion.wire.ids import State
from companion.wire.typed_answers import CommandError, placed, read_typed
from companion.wire.words_text import operation_text

MOST_TRIES = 8
"""Answers to one call, until it counts as not answered."""


class Said(NamedTuple):
    """An answer as it was typed, and what became of it. taken: False where it was refused."""

    line: str
    text: str
    taken: bool


@dataclass
class AskedCall:
    """A call of the drive. at: seconds of the drive. data: what the operator would be told.

    raw, judged: the frame without a mark, and as it was judged, JPEG. said: answers.
    by_person: whether somebody's answer is remembered for its scene. A `stay` is not: it teaches nothing.
    """

    id: int
    frame: str
    at: float
    data: CallReport
    embedding: Embedding
    raw: bytes
    judged: bytes
    said: list[Said] = field(default_factory=list)
    by_person: bool = False
    group: int = 0

    @property
    def record(self) -> CallReport:
        """What a rover's record of the call would hold: `data`, and the answers that were taken."""
        taken = ((placed(read_typed(one.line), self.data), one.text) for one in self.said if one.taken)
        return replace(self.data, answers=tuple(_given(answer, text) for answer, text in taken))


Operator = Callable[[AskedCall, str], str | None]
"""Asks what is to be answered to a call. None: nobody answers. It is told what became of the answer before,
"" at first."""


@dataclass
class Rehearsal:
    """What a drive led to. torn: names of frames that cannot be read. Frames count from 1 in the lists.

    drive_s: seconds of the drive.
    """

    frames: int = 0
    drive_s: float = 0.0
    torn: list[str] = field(default_factory=list)
    not_ok: int = 0
    would_hold: int = 0
    at_call: list[int] = field(default_factory=list)
    at_match: list[int] = field(default_factory=list)
    calls: list[AskedCall] = field(default_factory=list)

    def figures(self) -> dict[str, Any]:
        """Return the figures as JSON values. by_tenth: the calls in each tenth of the drive."""
        whole = max(1, self.frames + len(self.torn))
        tenths = [0] * 10
        for number in self.at_call:
            tenths[min(9, 10 * (number - 1) // whole)] += 1
        return {
            "frames": self.frames,
            "torn": len(self.torn),
            "not_ok": self.not_ok,
            "calls": len(self.calls),
            "groups": max((call.group for call in self.calls), default=0),
            "answered": sum(call.by_person for call in self.calls),
            "would_hold": self.would_hold,
            "matches": len(self.at_match),
            "at_call": self.at_call,
            "at_match": self.at_match,
            "by_tenth": tenths,
        }


def rehearse(
    drive: Drive,
    judge: DriveJudge,
    operator: Operator,
    out: Path,
    found: Rehearsal,
    told: Callable[[int], None],
) -> None:
    """Judge all frames of a drive, and ask the operator at each call; the drive waits meanwhile.

    Writes frames.jsonl, and the pictures of each call in calls/ before it is asked. All is added to `found`.
    told: called with the number of each frame, from 1, once it is judged. A KeyboardInterrupt ends the drive
    early. Raises OSError.
    """
    (out / "calls").mkdir(exist_ok=True)
    with (out / "frames.jsonl").open("w", encoding="utf-8") as lines:
        try:
            for number, frame in enumerate(drive.frames(), 1):
                judged = judge.judge(frame)
                found.drive_s = frame.at
                if judged is None:
                    found.torn.append(frame.name)
                    continue
                _count(found, number, judged)
                if judged.opened is not None:
                    call = _asked(judge, judged.opened, frame, found.calls)
                    found.calls.append(call)
                    _write_pictures(out, call)
                    _answer(judge, call, operator, frame.at)
                lines.write(json.dumps(_row(frame.name, judged.seen, judge.open_id)) + "\n")
                told(number)
        except KeyboardInterrupt:
            pass


def learnt(memory: Memory, before: int, calls: Sequence[AskedCall]) -> Memory:
    """Return the memory with the scenes that a person answered, and those that were there before the drive.

    before: `Memory.clock` at its start.
    """
    answered = {call.id for call in calls if call.by_person}
    entries = [one for one in memory.history if one.order <= before or one.call_id in answered]
    return replace(memory, history=History(entries, memory.history.limit))


def _count(found: Rehearsal, number: int, judged: Judgement) -> None:
    found.frames += 1
    found.not_ok += not judged.seen.ok
    found.would_hold += judged.would_hold
    if judged.opened is not None:
        found.at_call.append(number)
    if judged.seen.adopted is not None:
        found.at_match.append(number)


def _asked(judge: DriveJudge, call: Call, frame: DriveFrame, before: Sequence[AskedCall]) -> AskedCall:
    """Make the call that is asked. It joins the first group whose first call was in a like scene."""
    seen, data, region = call.seen, judge.told(call), judge.engine.settings.region
    assert seen is not None
    assert seen.observation is not None
    title = f"C{call.id} {frame.name}"
    embedding = seen.observation.embedding
    alike = judge.engine.settings.thresholds.scene
    first = {one.group: one for one in reversed(before)}
    group = next((g for g, one in sorted(first.items()) if cosine(one.embedding, embedding) >= alike), 0)
    return AskedCall(
        call.id,
        frame.name,
        frame.at,
        data,
        embedding,
        unmarked(seen.frame.image),
        panel(seen, State.CALLING, title, region),
        group=group or len(first) + 1,
    )


def _answer(judge: DriveJudge, call: AskedCall, operator: Operator, now: float) -> None:
    """Ask until the call is covered, nobody answers, or it was tried too often; then it gets a go."""
    problem = ""
    for _ in range(MOST_TRIES):
        line = operator(call, problem)
        if line is None:
            break
        try:
            problem, remembered = judge.answer(placed(read_typed(line), call.data), now)
        except (CommandError, AnyTraverseError) as error:
            problem = f"nothing changed: {error}"
            call.said.append(Said(line, problem, taken=False))
            continue
        call.said.append(Said(line, problem, taken=True))
        call.by_person = call.by_person or remembered
        if not judge.needs_answer(call.id):
            return
    judge.go_where_uncovered(call.id, now)


def _given(answer: Answer, text: str) -> GivenAnswer:
    operations = tuple(map(operation_text, answer.operations))
    return GivenAnswer(None, None, 0, answer.motion.name.lower(), operations, "applied", text)


def _write_pictures(out: Path, call: AskedCall) -> None:
    for kind, jpeg in (("raw", call.raw), ("large", call.judged)):
        (out / "calls" / f"{call.id}-{kind}.jpg").write_bytes(jpeg)


def _row(name: str, seen: Assessment, open_id: int) -> dict[str, Any]:
    judged = row(name, seen, Reason)
    figures = {
        "roi_uncertainty": judged.figures["uncertainty"],
        "worst_tile": judged.figures["worst_tile"],
        "drivable_share": judged.figures["drivable_share"],
        "similarity": seen.similarity,
        "match": seen.match.similarity if seen.match is not None else None,
    }
    return {
        "frame": seen.frame.id,
        "file": name,
        "ok": seen.ok,
        "reasons": judged.reasons,
        **{key: None if value is None else round(value, 4) for key, value in figures.items()},
        "known_place": seen.adopted.order if seen.adopted is not None else None,
        "open": open_id,
    }
