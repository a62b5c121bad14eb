"""Judges the frames of a drive by the engine and the rules of calls of a rover, in the drive's time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from anytraverse.assessment import Assessment, Reason
from anytraverse.engine import AnyTraverse
from companion.calls.decisions import Call, CallOpened, WouldHold
from companion.calls.machine import OperatorCalls
from companion.calls.mode_monitor import ModeReport
from companion.calls.policy import PolicyState
from companion.calls.summary import call_data
from companion.config import Config
from companion.daemon.answers.outcome import outcome_text
from companion.daemon.settings.runtime import call_numbers
from companion.desk.drives.drive import DriveFrame
from companion.wire.answers import Answer
from companion.wire.call_report import CallReport
from companion.wire.ids import Kind, Motion, Policy, Stage

FIGURES = ("traversability", "uncertainty", "drivable_share", "worst_tile")
"""Figures of the region of interest that a row has."""


class JudgementRow(NamedTuple):
    """How a frame was judged. reasons: by name. opened: the id of the call that it opened, 0 for none."""

    name: str
    figures: Mapping[str, float | None]
    reasons: tuple[str, ...]
    opened: int = 0


class Judgement(NamedTuple):
    """A judged frame. opened: the call that it opened. would_hold: whether a rover would be held."""

    seen: Assessment
    opened: Call | None
    would_hold: bool


class DriveJudge:
    """Judges as a rover in policy shadow does. There is no camera, so a frozen or dark one is no fault.

    The frames of one drive and one memory give the same calls every time.
    """

    def __init__(self, config: Config, engine: AnyTraverse) -> None:
        """engine: as `load_engine` makes it of the configuration, or with other settings."""
        self.engine = engine
        numbers = call_numbers(config, engine.settings)
        self._calls = OperatorCalls(numbers, PolicyState(Policy.SHADOW), 0.0)
        self._frames = 0

    @property
    def open_id(self) -> int:
        """The id of the open call, 0 for none."""
        return self._calls.current_id

    @property
    def holding(self) -> bool:
        """Whether a rover would stand in a hold now."""
        return bool(self._calls.shadow.open)

    def judge(self, frame: DriveFrame) -> Judgement | None:
        """Judge a frame; None for a torn one, in which only time passes."""
        self._frames += 1
        if frame.image is None:
            self._calls.tick(frame.at)
            return None
        seen = self.engine.step(frame.numbered(self._frames), frame.at, frame.place)
        decisions = self._calls.assessed(seen, frame.at)
        opened = next((one.call for one in decisions if isinstance(one, CallOpened)), None)
        if opened is not None:
            opened.place = frame.place
        if frame.travelled is not None:  # after the frame: before it, time alone would pass
            self._calls.vehicle_reported(ModeReport(travelled=frame.travelled), frame.at)
        return Judgement(seen, opened, any(isinstance(one, WouldHold) for one in decisions))

    def told(self, call: Call) -> CallReport:
        """Return what the operator is told of a call that has just opened."""
        assert call.seen is not None
        return call_data(
            call.seen,
            self.engine.settings.region,
            self.engine.memory.preferences,
            call.place,
            number=call.id,
            kind=Kind.CALL,
            stage=Stage.OPEN,
            reasons=call.reasons,
            frame_id=call.frame_id,
        )

    def answer(self, answer: Answer, now: float) -> tuple[str, bool]:
        """Answer the open call. Return what became of that, and whether its scene is remembered by it.

        Raises AnyTraverseError.
        """
        call = self._calls.call
        if call is None:
            return "no call is open", False
        operations, go = answer.changes, answer.motion is Motion.GO
        observation = call.seen.observation if call.seen is not None else None
        outcome = self.engine.answer(
            operations, now, call=observation, call_id=call.id, go=go, place=call.place
        )
        result, decisions = self._calls.apply_answer(call.id, answer.motion, operations, outcome, now)
        memory = self.engine.memory if operations else None
        text = outcome_text(self._calls, call.id, result, decisions, outcome.call, outcome.newest, memory)
        return text, outcome.remembered

    def go_where_uncovered(self, number: int, now: float) -> None:
        """Give a call that no answer has covered a go, so that each place is asked about once."""
        if self.needs_answer(number):
            self.answer(Answer(number, Motion.GO), now)

    def needs_answer(self, number: int) -> bool:
        """Whether this call is open, and what was said does not cover it."""
        call = self._calls.call
        return call is not None and call.id == number and not call.answered


def row(name: str, seen: Assessment, reasons: Iterable[Reason], opened: int = 0) -> JudgementRow:
    """Make the row of a judged frame. It has only those reasons that are in `reasons`."""
    roi, counts = seen.roi, frozenset(reasons)
    figures: dict[str, float | None] = dict.fromkeys(FIGURES)
    if roi is not None:
        figures = {one: getattr(roi, one) for one in FIGURES} | {"worst_tile": roi.worst_tile.uncertainty}
    return JudgementRow(
        name, figures, tuple(sorted(one.value for one in seen.reasons if one in counts)), opened
    )
