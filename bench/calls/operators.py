"""Answers calls as three operators would who see the labels: by go, by words, by taps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from anytraverse.assessment import Reason
from anytraverse.evaluation.labels import fold
from anytraverse.operations import SetWord, Tap
from companion.calls.decisions import Call
from companion.calls.summary import fractions
from companion.desk.drives.drive import DriveFrame
from companion.desk.drives.judge import DriveJudge
from companion.desk.tuning.episode import LabelOperator, Operator, go
from companion.sim.repeats import AskedBefore, ThingId
from companion.wire.answers import Answer, AnyOperation
from companion.wire.ids import Motion

OPERATORS = ("go", "word", "tap")
About = tuple[ThingId | None, str | None]
"""The thing or the patch of ground, and the place, that a call is about; None where it is about none."""


@dataclass
class AnsweredCall:
    """A call and its answer. at: seconds of the drive. at_m: metres driven, 0 where not known.

    repeat: it asks again, as of `AskedBefore`. words: whether the answer brings a word, or a tap.
    """

    at: float
    at_m: float
    reasons: tuple[str, ...]
    about: About
    repeat: bool
    words: bool

    @property
    def scene(self) -> bool:
        """Whether a place is asked about."""
        return Reason.UNKNOWN_SCENE.value in self.reasons

    @property
    def thing(self) -> bool:
        """Whether a thing is asked about."""
        return Reason.UNKNOWN_OBJECT.value in self.reasons


def nothing_known(_call: Call, _frame: DriveFrame) -> About:
    """Tell nothing: where no label says which thing or place is which."""
    return None, None


class WordOperator:
    """Names what is asked by a word with its true sign, or by a tap, and all that has no word in a new place.

    It says go, except about a thing that is not drivable.
    """

    def __init__(self, labels: LabelOperator, drivable: Sequence[str], *, taps: bool) -> None:
        """drivable: classes of the labels. taps: the thing asked about is tapped, whatever it is."""
        self._labels = labels
        self._drivable = frozenset(drivable)
        self._taps = taps

    def __call__(self, judge: DriveJudge, call: Call, frame: DriveFrame) -> Answer:
        """Answer a call. Raises DatasetError for labels that cannot be read."""
        answer = self._labels(judge, call, frame)
        thing = self._labels.asked(call, frame)
        if thing is None:
            return answer
        word, weight = fold(thing), 1.0 if thing in self._drivable else -1.0
        if self._taps:
            assert call.seen is not None
            assert call.seen.tile is not None
            tap = Tap(call.frame_id, fractions(call.seen.tile.shown), word, weight)
            answer = replace(
                answer, operations=(tap, *(one for one in answer.operations if _word(one) != word))
            )
        return answer if weight > 0 else replace(answer, motion=Motion.NONE)


def _word(operation: AnyOperation) -> str | None:
    return operation.word if isinstance(operation, SetWord | Tap) else None


def operator(name: str, labels: LabelOperator, drivable: Sequence[str]) -> Operator:
    """Return the operator of a name in `OPERATORS`."""
    return go if name == "go" else WordOperator(labels, drivable, taps=name == "tap")


@dataclass
class Listed:
    """Lists the calls that an operator answers. about: tells what a call at a frame is about."""

    operator: Operator
    about: Callable[[Call, DriveFrame], About]
    calls: list[AnsweredCall] = field(default_factory=list)
    _before: AskedBefore = field(default_factory=AskedBefore)

    def __call__(self, judge: DriveJudge, call: Call, frame: DriveFrame) -> Answer:
        """Answer a call."""
        at_m, about = frame.travelled or 0.0, self.about(call, frame)
        repeat = self._before.asks_again(at_m, *about)
        answer = self.operator(judge, call, frame)
        reasons = tuple(sorted(reason.value for reason in call.reasons))
        self.calls.append(AnsweredCall(frame.at, at_m, reasons, about, repeat, bool(answer.operations)))
        self._before.answered(at_m, *about)
        return answer
