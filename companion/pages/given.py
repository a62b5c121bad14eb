"""What was answered from a page, what became of that, and what takes it back."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

from anytraverse.operations import (
    ForgetCall,
    ForgetWord,
    Operation,
    OtherPlace,
    SetWord,
    Tap,
    taps_of,
    weights_of,
)
from companion.pages.wording import without_box
from companion.wire.answers import Answer, AnyOperation
from companion.wire.call_report import CallReport
from companion.wire.delivery import DeliveryStatus, Pending
from companion.wire.ids import CHANGING_RESULTS, Kind, Motion, Result
from companion.wire.words_text import operation_text

_WELL = CHANGING_RESULTS - {Result.NOT_COVERED}


@dataclass(frozen=True)
class Answered:
    """An answer from a page. at: seconds since 1970. call: that it is to.

    words: weight by word before it. tapped: those of them that were tapped in pictures.
    """

    pending: Pending
    at: float
    words: Mapping[str, float]
    call: CallReport | None = None
    tapped: Collection[str] = ()

    @property
    def taught(self) -> bool:
        """Whether the rover learnt something from it: words, or that it may go."""
        answer = self.pending.answer
        return self.pending.applied and (bool(answer.operations) or answer.motion is Motion.GO)

    @property
    def remembered(self) -> bool:
        """Whether the rover remembers the scene with it: of a hold only where it taps in the picture."""
        of_hold = self.call is not None and self.call.kind is Kind.HOLD
        return not of_hold or bool(taps_of(self.pending.answer.changes))

    def document(self) -> dict[str, Any]:
        """Return what a page shows of it."""
        pending = self.pending
        ack = pending.acknowledgement
        settled = ack.result if ack is not None and pending.status is DeliveryStatus.ACKNOWLEDGED else None
        return {
            "at": round(self.at, 2),
            "said": said(pending.answer),
            "text": pending.told,
            "tone": "wait" if not pending.settled else "good" if settled in _WELL else "bad",
            "settled": pending.settled,
        }


@dataclass
class OwnAnswers:
    """What was answered from a page to one call, the oldest first. undone: what was sent to take it back."""

    answers: list[Answered] = field(default_factory=list)
    undone: Pending | None = None

    @property
    def applied(self) -> bool:
        """Whether one of them was applied."""
        return any(one.pending.applied for one in self.answers)

    @property
    def too_late(self) -> bool:
        """Whether one of them came too late, and none was applied before."""
        acks = [one.pending.acknowledgement for one in self.answers]
        return any(ack is not None and ack.result is Result.STALE for ack in acks) and not self.applied

    def undoing(self) -> tuple[Operation, ...]:
        """Return what takes them back: a remembered scene of the call is forgotten, its words are as before.

        A word that was tapped and then forgotten stays forgotten.
        () where `undone` may still be applied, or was.
        """
        taught, undone = [one for one in self.answers if one.taught], self.undone
        if not taught or (undone is not None and (undone.applied or not undone.settled)):
            return ()
        # A forgotten word's examples are lost, and without them the perceiver may not know it.
        lost = {word for one in taught for word in one.tapped}
        before = taught[0].words
        touched = {
            change.word: not isinstance(change, ForgetWord)
            for one in taught
            for change in one.pending.answer.operations
            if isinstance(change, SetWord | Tap | ForgetWord)
        }
        restored = (
            SetWord(word, before[word]) if word in before else ForgetWord(word)
            for word, in_use in touched.items()
            if in_use or (word in before and word not in lost)
        )
        scenes = {ForgetCall(one.pending.answer.target) for one in taught if one.remembered}
        return (*scenes, *restored)

    def document(self) -> dict[str, Any]:
        """Return what a page shows of them. undo: weight by word that undoing sets, None: nothing is left."""
        undoing = self.undoing()
        return {
            "answers": [one.document() for one in self.answers],
            "undo": weights_of(undoing) if undoing else None,
            "undone": None if self.undone is None else self.undone.told,
        }


def said(answer: Answer) -> str:
    """Word an answer."""
    driving = [answer.motion.name.lower().replace("_", " ")] if answer.motion is not Motion.NONE else []
    return ", ".join([*map(_operation, answer.operations), *driving])


def _operation(operation: AnyOperation) -> str:
    return "another place" if isinstance(operation, OtherPlace) else without_box(operation_text(operation))
