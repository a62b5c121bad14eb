"""What was answered from a page, what became of that, and what takes it back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from anytraverse.operations import ForgetCall, ForgetWord, Operation, OtherPlace, SetWord, Tap
from companion.pages.wording import without_box
from companion.wire.answers import Answer, AnyOperation
from companion.wire.delivery import Pending, Status
from companion.wire.ids import CHANGING_RESULTS, Motion, Result
from companion.wire.words_text import operation_text

_WELL = CHANGING_RESULTS - {Result.NOT_COVERED}


@dataclass(frozen=True)
class Answered:
    """An answer from a page. at: seconds since 1970. words: weight by word before it."""

    pending: Pending
    at: float
    words: Mapping[str, float]

    @property
    def taught(self) -> bool:
        """Whether the rover learnt something from it: words, or that it may go."""
        answer = self.pending.answer
        return self.pending.applied and (bool(answer.operations) or answer.motion is Motion.GO)

    def document(self) -> dict[str, Any]:
        """Return what a page shows of it."""
        pending = self.pending
        ack = pending.acknowledgement
        settled = ack.result if ack is not None and pending.status is Status.ACKNOWLEDGED else None
        return {
            "at": round(self.at, 2),
            "said": said(pending.answer),
            "text": pending.told,
            "tone": "wait" if not pending.settled else "good" if settled in _WELL else "bad",
            "settled": pending.settled,
        }


Own = tuple[Sequence[Answered], Pending | None]
"""What was answered from a page to a call, the oldest first, and what takes it back."""


def too_late(answers: Sequence[Answered]) -> bool:
    """Whether an answer came too late, and none was applied."""
    acks = [one.pending.acknowledgement for one in answers]
    stale = any(ack is not None and ack.result is Result.STALE for ack in acks)
    return stale and not any(one.pending.applied for one in answers)


def undoing(answers: Sequence[Answered], undone: Pending | None) -> tuple[Operation, ...]:
    """Return what takes back the answers to a call: its scene is forgotten, its words are as before.

    undone: what was sent last to take them back. Where it may still be applied, or was, the result is empty.
    """
    taught = [one for one in answers if one.taught]
    if not taught or (undone is not None and (undone.applied or not undone.settled)):
        return ()
    before = taught[0].words
    touched = {
        change.word: None
        for one in taught
        for change in one.pending.answer.operations
        if isinstance(change, SetWord | Tap)
    }
    restored = (SetWord(word, before[word]) if word in before else ForgetWord(word) for word in touched)
    return (ForgetCall(taught[0].pending.answer.target), *restored)


def undone_words(operations: Sequence[Operation]) -> dict[str, float] | None:
    """Return word -> weight of the words that undoing sets, so that a page sees which it turns.

    operations: what `undoing` returned. None where nothing is left to undo.
    """
    return {one.word: one.weight for one in operations if isinstance(one, SetWord)} if operations else None


def said(answer: Answer) -> str:
    """Word an answer."""
    driving = [answer.motion.name.lower().replace("_", " ")] if answer.motion is not Motion.NONE else []
    return ", ".join([*map(_operation, answer.operations), *driving])


def _operation(operation: AnyOperation) -> str:
    return "another place" if isinstance(operation, OtherPlace) else without_box(operation_text(operation))
