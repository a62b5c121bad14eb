"""Answers from the radio to the state machine: order, staleness, and what the operator is told of them."""

from __future__ import annotations

from typing import Any, cast

import pytest

from anytraverse.answers import AnswerOutcome
from anytraverse.errors import UnknownWordError
from anytraverse.history import Place
from anytraverse.memory import Memory
from anytraverse.operations import Operation, SetWord, Tap, weights_of
from anytraverse.preferences import Preferences
from companion.daemon.answers.handler import AnswerHandler, Handled
from companion.link.answer_store import AnswerStore
from companion.vision.client import VisionClient, VisionResult
from companion.vision.messages import Done
from companion.wire.answers import Acknowledgement, Answer, Via
from companion.wire.ids import Motion, Outcome, Result, Stage
from tests.companion.calls.scenes import ACROSS, AUTO, CLEAR, DRUM, HOLD, Scene, Thing, View

GO, STAY = Motion.GO, Motion.STAY


class Queue:
    """Eyes that apply answers when told to."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.jobs: list[tuple[Any, tuple[Operation, ...], bool, bool]] = []
        self.owners = list[object]()
        self.full = False

    def answer(
        self,
        token: object,
        operations: tuple[Operation, ...],
        *,
        frame_id: int = 0,
        call_id: int = 0,
        go: bool = False,
        place: Place | None = None,
        match: int | None = None,
        owner: object,
    ) -> bool:
        """As `VisionClient.answer`."""
        self.owners.append(owner)
        assert match is None
        assert (call_id > 0) or frame_id == 0
        assert (place is None) == (call_id == 0)
        if not self.full:
            self.jobs.append((token, operations, frame_id > 0, go))
        return not self.full

    @property
    def words(self) -> Preferences:
        """As `VisionClient.words`."""
        return Preferences.of(self.scene.words)

    def apply(self) -> VisionResult:
        """The oldest job."""
        scene = self.scene
        token, operations, for_call, go = self.jobs.pop(0)
        scene.words.update(weights_of(operations))
        frame = scene.call.frame_id if for_call and scene.calls.call is not None else None
        outcome = AnswerOutcome(
            call=scene.judged(frame) if frame is not None else None,
            newest=scene.judged(scene.frame),
            remembered=frame is not None and (bool(operations) or go),
        )
        return VisionResult(Done(1, outcome, "", None), memory(scene), token)


def memory(scene: Scene) -> Memory:
    """What the eyes remember."""
    return Memory("model", Preferences.of(scene.words))


class Talk:
    """An operator who talks to a scene."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.eyes = Queue(scene)
        self.answer_handler = AnswerHandler(
            scene.calls, cast(VisionClient, self.eyes), AnswerStore(None), lambda sender: (sender[0], 0)
        )
        self.said: list[Acknowledgement] = []

    def say(self, target: int, motion: Motion = Motion.NONE, **words: float) -> None:
        """An answer leaves for the companion."""
        self.send(target, motion, *(SetWord(word, weight) for word, weight in words.items()))

    def send(self, target: int, motion: Motion, *operations: Operation) -> None:
        """The same with any operations."""
        request = Answer(
            target, motion, operations, transaction=len(self.said) + 1, sender=(255, 190), via=Via.TUNNEL
        )
        self._take(self.answer_handler.receive(request, self.scene.now))

    def seen(self, *, remembered: bool = True) -> None:
        """The eyes have applied one answer, and the disk takes what came of it at once, or not at all."""
        self._take(self.applied(self.eyes.apply()), remembered=remembered)

    def applied(self, result: VisionResult) -> Handled:
        """What comes of an answer that the eyes have applied or refused."""
        assert isinstance(result.report, Done)
        return self.answer_handler.applied(result.report, result, self.scene.now)

    def _take(self, heard: Handled, *, remembered: bool = True) -> None:
        self.scene.keep(heard.decisions)
        for reply in heard.replies:
            if reply.changed:
                self._take(self.answer_handler.written(reply, remembered=remembered, now=self.scene.now))
            else:
                self.said.append(reply.acknowledgement)

    @property
    def last(self) -> tuple[Result, str]:
        """What the newest acknowledgement says."""
        return self.said[-1].result, self.said[-1].text


def test_words_are_acknowledged_once_the_eyes_have_applied_them(held: Scene) -> None:
    talk = Talk(held)
    talk.say(1, GO, drum=1.0)
    assert talk.said == []
    talk.seen()
    assert talk.last == (Result.APPLIED, "C1 go given: waiting for a clear view")
    assert talk.said[-1].stage is Stage.ANSWERED


def test_a_call_that_an_answer_closes_says_so(report: Scene) -> None:
    report.run(1.0, DRUM)
    talk = Talk(report)
    talk.say(1, drum=1.0)
    talk.seen()
    assert talk.last == (Result.APPLIED, "C1 closed: answered, thank you")
    assert (talk.said[-1].stage, talk.said[-1].outcome) == (Stage.CLOSED, Outcome.ANSWERED)


def test_words_that_do_not_cover_are_told_with_the_figure(held: Scene) -> None:
    talk = Talk(held)
    talk.say(1, GO, puddle=-1.0)
    talk.seen()
    assert talk.last == (Result.NOT_COVERED, "C1 stays open: unknown 95%, over 25% calls")
    assert talk.said[-1].stage is Stage.OPEN


def test_a_forbidden_thing_across_the_way_is_told_as_blocked(hold: Scene) -> None:
    hold.run(1.0, View((Thing(ACROSS),)))
    talk = Talk(hold)
    talk.say(1, GO, drum=-1.0)
    talk.seen()
    assert talk.last == (Result.APPLIED, "C1 blocked by drum: waiting")


def test_what_the_journal_could_not_keep_is_said(held: Scene) -> None:
    talk = Talk(held)
    talk.say(1, GO)
    talk.seen(remembered=False)
    assert talk.last == (
        Result.APPLIED_NOT_REMEMBERED,
        "not remembered (disk?): C1 go given: waiting for a clear view",
    )
    held.run(1.5)
    assert held.autopilot.mode == AUTO


@pytest.mark.parametrize("target", [2, 0xFFFF])
def test_an_id_that_is_not_open_is_stale_and_changes_nothing(held: Scene, target: int) -> None:
    talk = Talk(held)
    talk.say(target, GO, drum=1.0)
    assert talk.last == (Result.STALE, f"No open call or hold {target}: nothing changed")
    assert talk.eyes.jobs == []


def test_the_current_one_is_refused_while_it_is_too_new_to_have_been_read(report: Scene) -> None:
    report.show(DRUM, DRUM)
    talk = Talk(report)
    talk.say(0, GO)
    assert talk.last == (Result.STALE, "C1 is new: read it, then answer")


def test_words_for_nothing_in_particular_are_taken_when_nothing_is_open(report: Scene) -> None:
    talk = Talk(report)
    talk.say(0, drum=-1.0)
    talk.seen()
    assert talk.last == (Result.APPLIED, "in use: trail: 1; log: -1; drum: -1")


def test_words_for_a_call_that_closed_meanwhile_are_told_to_be_in_use(report: Scene) -> None:
    report.run(1.0, DRUM)
    talk = Talk(report)
    talk.say(1, drum=1.0)
    talk.say(1, GO)
    talk.seen()
    talk.seen()
    assert talk.last == (Result.STALE, "1 is closed; in use: trail: 1; log: -1; drum: 1")


def test_a_box_that_is_none_is_refused_with_the_reason(held: Scene) -> None:
    talk = Talk(held)
    talk.send(1, GO, Tap(1, (0.5, 0.5, 0.4, 0.6), "drum", 1.0))
    assert talk.last[0] is Result.REFUSED
    assert "empty" in talk.last[1]
    assert held.calls.go_at is None


def test_an_answer_that_the_eyes_refuse_moves_nothing(held: Scene) -> None:
    talk = Talk(held)
    talk.say(1, GO, unicorn=1.0)
    token, *_ = talk.eyes.jobs.pop()
    error = UnknownWordError("unicorn", ("trail",))
    heard = talk.applied(VisionResult(Done(1, None, str(error), None), memory(held), token))
    assert heard.replies[0].acknowledgement.result is Result.REFUSED
    assert heard.decisions == []
    assert held.calls.go_at is None


def test_stay_counts_at_once_and_overtakes_a_go_that_the_eyes_still_have(held: Scene) -> None:
    talk = Talk(held)
    talk.say(1, GO)
    talk.say(1, STAY)
    assert talk.last == (Result.APPLIED, "C1 noted: still open")
    talk.seen()
    held.run(10.0)
    assert held.autopilot.mode == HOLD
    assert held.calls.stage() is Stage.OPEN


def test_a_go_after_a_stay_counts(held: Scene) -> None:
    talk = Talk(held)
    talk.say(1, STAY)
    talk.say(1, GO)
    talk.seen()
    held.run(1.5)
    assert held.autopilot.mode == AUTO


def test_a_go_that_the_eyes_kept_for_more_than_a_minute_drives_nothing_on_and_says_so(held: Scene) -> None:
    held.run(2.0, CLEAR)
    talk = Talk(held)
    talk.say(1, GO)
    held.run(held.numbers.go_lasts + 1.0, CLEAR)
    talk.seen()
    assert talk.last == (Result.APPLIED, "C1 go has lapsed: send it again")
    held.run(2.0, CLEAR)
    assert (held.autopilot.mode, held.calls.go_at) == (HOLD, None)


def test_a_go_does_not_overtake_the_words_before_it(blocked: Scene) -> None:
    talk = Talk(blocked)
    talk.say(1, log=1.0)
    talk.say(1, GO)
    talk.seen()
    talk.seen()
    blocked.run(1.5)
    assert blocked.autopilot.mode == AUTO


def test_a_go_to_a_blocked_hold_is_told_to_wait(blocked: Scene) -> None:
    talk = Talk(blocked)
    talk.say(1, GO)
    assert talk.last == (Result.APPLIED, "H1 blocked by log: waiting")
    blocked.run(1.5, CLEAR)
    assert blocked.autopilot.mode == AUTO


def test_stay_to_a_hold_is_noted(hold: Scene) -> None:
    hold.camera = False
    hold.run(2.0)
    talk = Talk(hold)
    talk.say(1, STAY)
    assert talk.last == (Result.APPLIED, "H1 noted: still holding")


def test_a_go_while_disarmed_is_told_to_come_to_nothing(held: Scene) -> None:
    held.human(HOLD, armed=False)
    talk = Talk(held)
    talk.say(1, GO)
    talk.seen()
    assert talk.last == (Result.APPLIED, "C1 no go: disarmed, or no autopilot")


def test_an_answer_waits_for_the_frame_of_a_call_that_a_restart_found_open(held: Scene) -> None:
    held.restarted()
    talk = Talk(held)
    talk.say(1, GO)
    assert talk.last[0] is Result.BUSY


def test_but_not_for_ever(held: Scene) -> None:
    held.restarted()
    held.run(11.0, DRUM)
    talk = Talk(held)
    talk.say(1, drum=1.0)
    talk.eyes.jobs[0] = (*talk.eyes.jobs[0][:2], False, True)
    talk.seen()
    assert talk.last == (Result.NOT_COVERED, "C1 noted: still open")
    talk.say(1, GO)
    talk.seen()
    held.run(1.5)
    assert held.autopilot.mode == AUTO


def test_too_many_waiting_answers_are_refused_for_now(held: Scene) -> None:
    talk = Talk(held)
    talk.eyes.full = True
    talk.say(1, GO)
    assert talk.said[-1].result is Result.BUSY
    talk.eyes.full = False
    talk.say(1, GO)
    talk.seen()
    assert talk.last[0] is Result.APPLIED
    assert set(talk.eyes.owners) == {(255, 0)}
