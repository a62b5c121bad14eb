"""Models who answers: an operator who sees what is asked, and somebody on the trail who takes things away.

- `THINK` s after a call opened the operator taps what it asks about and names it by its true word, and names
  the kinds of ground in a new place. Go is said where nothing is in the way. Before what has room beside it
  go is said to a rover that stands, where that was named as not drivable, and is `IN_VIEW` m ahead or more:
  what is nearer is below the picture, and a mission that goes on would drive over it.
- What leaves no room, or was touched, is taken away once the rover has stood for `TAKEN` s; then go is said.
- What leaves room is never taken away. Who stands before it for `STOOD` s after all was said has ended there.
- A rover that stands for `BY_HAND` s with nothing in the way is set to AUTO by hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from random import Random

from anytraverse.operations import SetWord, Tap
from bench.calls.field import DRIVABLE, FilmedField
from bench.calls.operators import WordOperator
from companion.calls.decisions import Call
from companion.desk.drives.drive import DriveFrame
from companion.desk.drives.judge import DriveJudge
from companion.wire.answers import Answer, AnyOperation
from companion.wire.ids import Motion

THINK = (2.0, 5.0)
TAKEN, STOOD, BY_HAND = 8.0, 14.0, 8.0
IN_VIEW = 1.2
AGAIN = 5.0
"""s after which a go is given again."""


class OperatorModel:
    """The operator of one drive. Times in s."""

    def __init__(self, film: FilmedField, judge: DriveJudge, random: Random, *, puddles: bool) -> None:
        """judge: holds the engine. puddles: whether they are drivable."""
        self._names = WordOperator(film.operator, (*DRIVABLE, *(["puddle"] if puddles else [])), taps=True)
        self._judge, self._random = judge, random
        self._waits: tuple[float, int, tuple[AnyOperation, ...]] | None = None
        self._go_at = -AGAIN

    def called(self, call: Call, frame: DriveFrame, now: float) -> None:
        """Look at a call that opened with this frame."""
        said = self._names(self._judge, call, frame)
        operations = said.operations
        if self._judge.engine.perceiver.model_id == "truth":  # it learns nothing by taps
            operations = tuple(_without_tap(one) for one in operations)
        self._waits = now + self._random.uniform(*THINK), call.id, operations

    def says(
        self, current: int, stands: float, now: float, *, way: bool, room: bool, asks: bool, passes: bool
    ) -> Answer | None:
        """Return what is said now, None for nothing.

        current: the id of the open call or hold, 0 for none. stands: s for which the rover has stood. way:
        something is in the way. room: it has room beside it, and is in view. asks: a call is open, and no
        answer has covered it. passes: the companion says that it would drive round what is there.
        """
        if self._waits is not None and now >= self._waits[0]:
            (_, number, operations), self._waits = self._waits, None
            if number == current:
                go = not way or (room and (passes or forbids(operations)))
                self._go_at = now if go else self._go_at
                return Answer(number, Motion.GO if go else Motion.NONE, operations)
        goes = not way or (room and (passes or not asks))
        if current and self._waits is None and goes and stands > THINK[0] and now >= self._go_at + AGAIN:
            self._go_at = now
            return Answer(current, Motion.GO)
        return None

    @property
    def thinks(self) -> bool:
        """Whether an answer is to come."""
        return self._waits is not None


def _without_tap(operation: AnyOperation) -> AnyOperation:
    return SetWord(operation.word, operation.weight) if isinstance(operation, Tap) else operation


def forbids(operations: Sequence[AnyOperation]) -> bool:
    """Whether words say of all that they name that it is not drivable."""
    weights = [one.weight for one in operations if isinstance(one, SetWord | Tap)]
    return bool(weights) and max(weights) < 0.0
