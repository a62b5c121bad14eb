"""The supervisor's side of the vision process: what it believes, when it restarts it, and who is told."""

from __future__ import annotations

import logging
import time
import tracemalloc
from dataclasses import replace
from itertools import starmap

import numpy as np
import pytest
from msgspec import structs

from anytraverse.answers import AnswerOutcome
from anytraverse.frame import Frame, Pose
from anytraverse.history import Entry, History, Place
from anytraverse.judging import Settings
from anytraverse.memory import resumed_memory
from anytraverse.operations import SetWord
from anytraverse.perception import Example
from bench.virtual_time import Clock
from companion.cameras.newest import CameraState, CameraStatus
from companion.config import Config
from companion.config.radio import LinkSection
from companion.config.web import WebSection
from companion.guide.plan import Errand, Outline, Plan, Route
from companion.sim.loopback_vision import LoopbackVision
from companion.system.watchdog import SILENT_AFTER
from companion.tasks import VISION
from companion.vehicle.motion import MotionReport
from companion.vision.checks import LONGEST_VECTOR
from companion.vision.client import (
    MAX_DRAWINGS,
    MAX_JOBS,
    STORED_FRAMES,
    VISION_LOST,
    VisionClient,
    VisionResult,
)
from companion.vision.codec import CodecError, decode
from companion.vision.memory_copy import update_from
from companion.vision.messages import (
    MOST_ROWS,
    Alive,
    Done,
    Drawn,
    Encoded,
    Failed,
    FrameJudged,
    Logged,
    Model,
    Planned,
    Ready,
    Restore,
    Scenes,
    Situation,
    Start,
    Tune,
)
from companion.vision.worker import Worker
from companion.wire.ids import State
from tests.anytraverse.conftest import Painted
from tests.companion.daemon.rig import picture
from tests.companion.vision.played import WORDS, engine, unframed

STEP = 0.02
MANY_SCENES = replace(Config(), journal=replace(Config().journal, scenes=10_000))


class Channel(LoopbackVision):
    """One that can be full, and say anything at all."""

    full = False

    def send(self, message: bytes) -> bool:
        return not self.full and super().send(message)

    def say(self, packed: bytes) -> None:
        """These bytes as a report."""
        self._reports.append(packed)


class Stage:
    """A supervisor's side in virtual time."""

    def __init__(self, clock: Clock, step: float = STEP) -> None:
        self.clock = clock
        self.step = step
        self.children: list[Channel] = []
        self.refuses: OSError | None = None
        self.frames = 0
        self.vision = VisionClient(self._launch, Config(), None, VISION)
        self.until_ready()

    def _launch(self) -> Channel:
        if self.refuses is not None:
            raise self.refuses
        self.children.append(Channel(engine, self.step))
        return self.children[-1]

    @property
    def child(self) -> Channel:
        """The process that runs."""
        return self.children[-1]

    def until_ready(self) -> None:
        """Started, loaded and tuned."""
        for _ in range(2):
            self.turn()
        self.vision.tune(Settings())
        self.turn()

    def turn(self, seconds: float = 0.0) -> list[VisionResult]:
        """The process does what waits, and the supervisor hears of it after `seconds`."""
        if self.children:
            self.child.work()
        for _ in range(round(seconds / 0.5)):
            self.clock.now += 0.5
            self.child.live(CameraStatus(CameraState.DELIVERING), None)
            self.vision.poll(self.clock.now)
        return self.vision.poll(self.clock.now)

    def silence(self, seconds: float) -> list[VisionResult]:
        """No sign of life for so long."""
        found: list[VisionResult] = []
        for _ in range(round(seconds / 0.1)):
            self.clock.now += 0.1
            found += self.vision.poll(self.clock.now)
        return found

    def show(self, thing: str = "", scene: int = 0) -> None:
        """A frame is judged."""
        self.frames += 1
        self.clock.now += 0.1
        self.child.judge(Frame(self.frames, self.clock.now, picture(thing, scene=scene)))

    def ask(self, token: object, **weights: float) -> bool:
        """Words without a call."""
        return self.vision.answer(token, tuple(starmap(SetWord, weights.items())))

    def lost(self, found: list[VisionResult], *tokens: object) -> None:
        """Whoever waited is told so."""
        assert [one.token for one in found if isinstance(one.report, Done)] == list(tokens)
        for one in found:
            if isinstance(one.report, Done):
                assert one.report.error == VISION_LOST == "vision restarted: send it again"
                assert one.report.outcome is None


@pytest.fixture
def stage(clock: Clock) -> Stage:
    return Stage(clock)


def test_it_starts_with_what_was_kept_and_judges_once_it_is_tuned(stage: Stage) -> None:
    assert list(stage.child.requests) == [Start(Config(), None, 0, 1), Tune(1, Settings())]
    assert stage.vision.trouble == ""
    assert stage.vision.ready is not None
    assert stage.vision.ready.model == Model("painted-1")


def test_of_several_judgements_the_newest_counts_and_one_that_changed_the_memory(stage: Stage) -> None:
    for _ in range(4):
        stage.show()
    found = [one.report for one in stage.turn() if isinstance(one.report, FrameJudged)]
    assert [(one.assessment.frame.id, one.update is not None) for one in found] == [(1, True), (4, False)]
    for _ in range(100):
        stage.show()
    (newest,) = stage.turn()
    assert isinstance(newest.report, FrameJudged)
    assert newest.report.assessment.frame.id == 104
    assert newest.memory is stage.vision.memory


def test_an_answer_comes_back_with_its_token_and_the_memory(stage: Stage) -> None:
    token = object()
    assert stage.ask(token, drum=-1.0)
    (applied,) = stage.turn()
    assert isinstance(applied.report, Done)
    assert applied.token is token
    assert applied.report.error == ""
    assert applied.memory is stage.vision.memory
    assert applied.memory.preferences["drum"] == -1.0


def test_the_process_is_told_neither_token_nor_key() -> None:
    child = LoopbackVision(engine)
    web, link = WebSection(token="0123456789abcdef"), LinkSection(signing_key="/etc/anytraverse/signing.key")
    vision = VisionClient(lambda: child, replace(Config(), web=web, link=link), None, VISION)
    vision.poll(time.monotonic())
    child.work()
    assert list(child.requests) == [Start(Config(), None, 0, 1)]


def test_a_refused_answer_comes_back_with_the_reason(stage: Stage) -> None:
    stage.ask("token", unicorn=1.0)
    (applied,) = stage.turn()
    assert isinstance(applied.report, Done)
    assert "unicorn" in applied.report.error


def test_waiting_answers_are_bounded_and_none_is_lost_or_overtaken(stage: Stage) -> None:
    taken = [stage.ask(number, drum=1.0) for number in range(MAX_JOBS + 2)]
    assert taken == [True] * MAX_JOBS + [False] * 2
    stage.show()
    assert [one.token for one in stage.turn() if isinstance(one.report, Done)] == list(range(MAX_JOBS))
    assert stage.ask("again", drum=1.0)


def test_of_one_owner_two_answers_wait_and_others_have_their_places(stage: Stage) -> None:
    def ask(owner: object) -> bool:
        return stage.vision.answer(owner, (SetWord("drum", 1.0),), owner=owner)

    assert [ask("flood") for _ in range(3)] == [True, True, False]
    assert [ask("operator") for _ in range(3)] == [True, True, False]
    stage.show()
    assert len([one for one in stage.turn() if isinstance(one.report, Done)]) == 4
    assert ask("flood")


def test_pictures_that_were_asked_for_are_bounded(stage: Stage, caplog: pytest.LogCaptureFixture) -> None:
    stage.show()
    stage.turn()
    for number in range(MAX_DRAWINGS + 1):
        stage.vision.draw(1, f"title {number}", State.OK)
    assert "no picture of title 16" in caplog.text
    assert len([one for one in stage.turn() if isinstance(one.report, Drawn)]) == MAX_DRAWINGS


def test_while_it_is_silent_it_gets_no_job_and_then_it_is_killed(stage: Stage) -> None:
    old = stage.child
    assert stage.ask("waits", drum=1.0)
    assert stage.silence(SILENT_AFTER + 0.1) == []
    assert not stage.ask("token", drum=1.0)
    assert not stage.vision.tune(Settings())
    assert not stage.vision.restore("token", 1, b"")
    assert old.death == ""
    stage.lost(stage.silence(VISION.silent_for + 4 * STEP - SILENT_AFTER), "waits")
    assert old.death == "closed"
    assert stage.vision.trouble == "vision hangs"
    stage.turn()
    assert stage.child is not old


def test_slow_eyes_may_be_silent_for_four_of_their_steps_longer(clock: Clock) -> None:
    stage = Stage(clock, step=1.0)
    slow = stage.child
    stage.silence(6.8)
    assert slow.death == ""
    stage.silence(0.4)
    assert slow.death == "closed"


def test_while_the_supervisor_stood_still_no_silence_counts(stage: Stage) -> None:
    stage.clock.now += 30.0
    stage.vision.poll(stage.clock.now)
    assert stage.child.death == ""
    assert stage.ask("token", drum=1.0)


def test_slow_eyes_are_silent_for_a_step_and_take_answers_all_the_same(clock: Clock) -> None:
    stage = Stage(clock, step=4.0)
    stage.silence(5.5)
    assert stage.ask("token", drum=1.0)
    stage.silence(1.0)
    assert not stage.ask("token", drum=1.0)


def test_settings_that_did_not_reach_it_are_not_those_of_the_next_one(stage: Stage) -> None:
    stage.child.full = True
    assert not stage.vision.tune(replace(Settings(), freshness=1.5))
    for _ in range(4):
        stage.turn()
    assert [one.settings for one in stage.child.requests if isinstance(one, Tune)] == [Settings()]


def test_settings_that_change_faster_than_frames_are_judged_are_refused_and_no_frame_is_nonsense(
    stage: Stage,
) -> None:
    taken = [stage.vision.tune(replace(Settings(), freshness=1.0 + number)) for number in range(1000)]
    assert taken == [True] * taken.count(True) + [False] * taken.count(False)
    stage.show("drum")  # by the settings before all of these
    assert [one.report for one in stage.vision.poll(stage.clock.now) if isinstance(one.report, FrameJudged)]
    stage.turn()
    stage.show("drum")
    stage.turn()
    assert stage.vision.tune(Settings())
    assert len(stage.children) == 1


def test_settings_before_the_first_frame_reach_the_next_process_where_one_dies_as_it_gets_ready(
    clock: Clock,
) -> None:
    children = [LoopbackVision(engine) for _ in range(2)]
    waiting = iter(children)
    vision = VisionClient(lambda: next(waiting), Config(), None, VISION)
    vision.poll(clock.now)
    children[0].work()
    children[0].death = "SIGSEGV"
    vision.poll(clock.now)
    assert vision.ready is not None
    other = replace(Settings(), freshness=1.5)
    assert not vision.tune(other)
    for _ in range(4):
        vision.poll(clock.now)
        children[1].work()
    assert [one.settings for one in children[1].requests if isinstance(one, Tune)] == [other]


def test_one_that_never_gets_ready_is_killed_after_its_time_for_loading(stage: Stage) -> None:
    stage.child.death = "SIGSEGV"
    stage.turn()
    stage.vision.poll(stage.clock.now)
    loading = stage.child
    stage.silence(VISION.loading - 1.0)
    assert loading.death == ""
    stage.silence(2.0)
    assert loading.death == "closed"


def test_what_waits_when_it_dies_is_told_and_a_new_process_starts_from_the_last_copy(stage: Stage) -> None:
    stage.ask("applied", trail=1.0)
    stage.turn()
    memory = stage.vision.memory
    assert stage.ask(1, drum=1.0)
    assert stage.ask(2, drum=-1.0)
    stage.child.death = "SIGSEGV"
    stage.lost(stage.vision.poll(stage.clock.now), 1, 2)
    assert stage.vision.trouble == "vision died (SIGSEGV)"
    assert stage.vision.memory is memory
    stage.until_ready()
    start = stage.child.requests[0]
    assert isinstance(start, Start)
    assert start.memory is not None
    assert start.memory.preferences.format() == memory.preferences.format()
    assert stage.vision.trouble == ""
    assert stage.ask(3, drum=1.0)
    (applied,) = stage.turn()
    assert isinstance(applied.report, Done)
    assert applied.token == 3
    assert applied.memory.preferences["drum"] == 1.0


def test_a_memory_that_is_too_long_for_one_message_reaches_a_new_process_whole(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.vision.codec.LARGEST", 16 << 10)
    scenes = [Entry(np.ones(2, np.float32), WORDS, order, order, order) for order in range(1, 301)]
    kept = replace(engine(None).memory, history=History(scenes, 10_000), clock=300)
    child = LoopbackVision(engine)
    vision = VisionClient(lambda: child, MANY_SCENES, kept, VISION)
    for _ in range(10):
        vision.poll(clock.now)
        child.work()
    assert vision.trouble == ""
    assert [entry.call_id for entry in vision.memory.history] == list(range(1, 301))
    worker = child._worker
    assert worker is not None
    assert [entry.call_id for entry in worker._engine.memory.history] == list(range(1, 301))


def test_hostile_reports_of_remembered_scenes_take_no_more_than_the_configured_ones_may(
    stage: Stage,
) -> None:
    tap = Example("painted-1", np.zeros(LONGEST_VECTOR, np.float32))
    row = Entry(tap.vector, WORDS, 1, 1, examples={"gnome": (tap,) * 200})
    packed = unframed(Scenes((row,) * MOST_ROWS))
    tracemalloc.start()
    for _ in range(12):
        stage.child._reports = [packed]
        stage.vision.poll(stage.clock.now)
    kept, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept < 64 << 20
    assert stage.vision.trouble == "vision sent nonsense"


def test_a_process_that_dies_before_it_has_the_whole_memory_gets_all_of_it_anew(clock: Clock) -> None:
    scenes = [Entry(np.ones(2, np.float32), WORDS, order, order, order) for order in range(1, 301)]
    kept = replace(engine(None).memory, history=History(scenes, 10_000), clock=300)
    children = [LoopbackVision(engine) for _ in range(2)]
    waiting = iter(children)
    vision = VisionClient(lambda: next(waiting), MANY_SCENES, kept, VISION)
    for _ in range(3):
        vision.poll(clock.now)
        children[0].work()
    children[0].death = "SIGKILL"
    for _ in range(10):
        vision.poll(clock.now)
        children[1].work()
    assert vision.trouble == ""
    assert [entry.call_id for entry in vision.memory.history] == list(range(1, 301))


@pytest.mark.slow
def test_a_played_process_remembers_only_what_it_was_asked_last(stage: Stage) -> None:
    for number in range(1, 301):
        stage.vision.tune(replace(Settings(), freshness=float(number)))
        stage.show()
        stage.turn()
    assert len(stage.child.requests) == 256
    newest = stage.child.requests[-1]
    assert isinstance(newest, Tune)
    assert newest.settings == replace(Settings(), freshness=300.0)


def test_as_many_answers_as_may_wait_are_decided_in_the_time_that_is_told(clock: Clock) -> None:
    child = LoopbackVision(engine, 2.0)
    vision = VisionClient(lambda: child, Config(), None, VISION)
    for _ in range(2):
        vision.poll(clock.now)
        child.work()
    vision.poll(clock.now)
    vision.tune(Settings())
    child.work()
    while vision.answer("token", (SetWord("drum", 1.0),)):
        pass
    asked, decided, began = child._requests, list[VisionResult](), clock.now
    while vision.watchdog.restarted == 0 and len(decided) < MAX_JOBS:
        for _ in range(10):  # as slow as it may be
            clock.now += 1.0
            decided += vision.poll(clock.now)
        child._requests, asked = asked[:1], asked[1:]
        child.work()
        decided += vision.poll(clock.now)
    assert (vision.watchdog.restarted, len(decided)) == (0, MAX_JOBS)
    assert 60.0 < clock.now - began <= vision.answers_within


def test_an_answer_is_decided_in_the_time_that_is_told_whatever_signs_of_life_come(stage: Stage) -> None:
    within = stage.vision.answers_within
    assert stage.ask("words", drum=1.0)
    found, waited = list[VisionResult](), 0.0
    while not found and waited < 2 * within:
        stage.clock.now += 1.0
        waited += 1.0
        stage.child.live(CameraStatus(CameraState.DELIVERING), None)
        found = stage.vision.poll(stage.clock.now)
    stage.lost(found, "words")
    assert within < waited <= within + 1.0
    assert stage.vision.trouble == "vision hangs"


def test_what_was_told_before_it_died_counts(stage: Stage) -> None:
    stage.ask("told", drum=1.0)
    stage.child.work()
    stage.ask("never done", drum=-1.0)
    stage.child.death = "SIGKILL"
    told, lost = stage.vision.poll(stage.clock.now)
    assert isinstance(told.report, Done)
    assert (told.token, told.report.error) == ("told", "")
    stage.lost([lost], "never done")
    assert stage.vision.memory.preferences["drum"] == 1.0


def test_a_new_process_is_tuned_gets_the_frames_back_and_goes_on_counting_frames(stage: Stage) -> None:
    other = replace(Settings(), freshness=1.5)
    stage.vision.tune(other)
    for number in range(1, STORED_FRAMES + 2):
        stage.show("drum")
        stage.turn()
        stage.vision.draw(number, "C", State.CALLING, store=True)
        stage.turn()
    assert not stage.vision.has_stored_frame(1)
    assert stage.vision.has_stored_frame(2)
    stage.child.death = "SIGSEGV"
    for _ in range(4):
        stage.turn()
    start, tune, *frames = stage.child.requests
    assert isinstance(start, Start)
    assert start.first_frame == STORED_FRAMES + 2
    assert isinstance(tune, Tune)
    assert tune.settings == other
    assert [one.frame_id for one in frames if isinstance(one, Restore)] == [2, 3]
    assert stage.vision.answer("token", (SetWord("drum", 1.0),), frame_id=3, call_id=1)
    (applied,) = stage.turn()
    assert isinstance(applied.report, Done)
    assert applied.report.error == ""
    assert applied.report.outcome is not None
    assert applied.report.outcome.call is not None
    assert applied.report.outcome.call.frame.id == 3


def test_a_new_process_does_not_send_back_what_it_was_given() -> None:
    given = engine(None).memory
    examples = {"gnome": (Example(given.model_id, np.ones(2, np.float32)),)}
    scenes = [Entry(np.ones(2, np.float32), WORDS, order, order, 0, examples) for order in range(1, 4)]
    start = replace(given, history=History(scenes), examples=examples, clock=3)
    resumed, _ = resumed_memory(start, start.model_id, start.configured, Painted().meaning, history_limit=256)
    assert update_from(start, resumed, 1, 0, ()).entries == ()


def test_a_frame_that_a_new_process_dies_over_twice_is_given_back_no_more(stage: Stage) -> None:
    stage.show("drum")
    stage.turn()
    stage.vision.draw(1, "C", State.CALLING, store=True)
    stage.turn()
    stage.child.death = "SIGSEGV"
    for expected in (True, True, False):
        stage.silence(5.0)
        stage.child.work()
        assert stage.vision.has_stored_frame(1) is expected
        stage.child._reports = stage.child._reports[:1]  # ready, and no more
        stage.vision.poll(stage.clock.now)
        assert stage.vision.trouble == ""
        stage.child.work()
        assert any(isinstance(one, Restore) for one in stage.child.requests) is expected
        stage.child._reports.clear()
        stage.child.death = "SIGSEGV"
        stage.vision.poll(stage.clock.now)


def nonsense(stage: Stage, case: str) -> None:
    """What a process that is not to be relied on sends."""
    child, worker = stage.child, stage.child._worker
    assert worker is not None
    captured = stage.clock.now
    looked = worker.judge(Frame(50, captured, picture()))
    match case:
        case "unreadable":
            child.say(b"no pickle")
        case "empty":
            child.say(b"")
        case "no report":
            child.report(Tune(1, Settings()))  # type: ignore[arg-type]
        case "wrong base":
            assert looked.update is not None
            child.report(
                structs.replace(looked, update=structs.replace(looked.update, base=looked.update.base + 1))
            )
        case "wrong revision":
            child.report(looked)
            child.report(structs.replace(worker.judge(Frame(51, captured, picture())), revision=99))
        case "twice the same change":
            child.report(looked)
            child.report(
                structs.replace(looked, assessment=worker.judge(Frame(51, captured, picture())).assessment)
            )
        case "an old frame":
            child.report(looked)
            child.report(worker.judge(Frame(49, captured, picture())))
        case "from the future":
            child.report(worker.judge(Frame(52, captured + 5.0, picture())))
        case "judged by no settings that were sent":
            child.report(structs.replace(looked, tuning=0))
        case "judged by settings that were never sent":
            child.report(structs.replace(looked, tuning=99))
        case "an outcome by no settings that were sent":
            child.report(Done(2, AnswerOutcome(looked.assessment, None), "", None, tuning=0))
        case "an outcome nobody asked for":
            child.report(Done(77, None, "why not", None))
        case "a picture nobody asked for":
            child.report(Drawn(77, 1, "title"))
        case "an encoded frame nobody asked for":
            child.report(Encoded(77, 1, b"jpeg"))
        case "another frame encoded than was asked for":
            assert stage.vision.encode(50)
            child.report(Encoded(stage.vision.newest_request, 51, b"jpeg"))
        case "an encoded frame without a number":
            child.report(Encoded(0, 1, b"jpeg"))
        case "ready a second time":
            memory, known = stage.vision.memory, stage.vision._copy.revision
            update = update_from(memory, memory, known + 1, known, ())
            child.report(Ready(Model("painted-1"), Settings(), update, (), 0.1))


@pytest.mark.parametrize(
    "case",
    [
        "unreadable",
        "empty",
        "no report",
        "wrong base",
        "wrong revision",
        "twice the same change",
        "an old frame",
        "from the future",
        "judged by no settings that were sent",
        "judged by settings that were never sent",
        "an outcome by no settings that were sent",
        "an outcome nobody asked for",
        "a picture nobody asked for",
        "an encoded frame nobody asked for",
        "another frame encoded than was asked for",
        "an encoded frame without a number",
        "ready a second time",
    ],
)
def test_one_that_sends_nonsense_is_killed_and_who_waits_is_told(stage: Stage, case: str) -> None:
    assert stage.ask("waits", drum=1.0)
    old = stage.child
    nonsense(stage, case)
    found = stage.vision.poll(stage.clock.now)
    stage.lost([one for one in found if isinstance(one.report, Done)], "waits")
    assert stage.vision.trouble == "vision sent nonsense"
    assert old.death == "closed"
    stage.until_ready()
    assert stage.vision.trouble == ""
    assert "drum" not in stage.vision.memory.preferences


@pytest.mark.parametrize(
    ("store", "number", "title", "believed"),
    [(True, 1, "title", True), (True, 2, "title", False), (True, 1, "?", False), (False, 1, "title", False)],
)
def test_a_frame_is_stored_only_where_that_was_asked_of_it(
    stage: Stage, store: bool, number: int, title: str, believed: bool
) -> None:
    stage.vision.draw(1, "title", State.CALLING, store=store)
    stage.child.report(Drawn(stage.vision.newest_request, number, title, png=b"png", stored=True))
    stage.vision.poll(stage.clock.now)
    assert stage.vision.has_stored_frame(number) is believed
    assert stage.vision.trouble == ("" if believed else "vision sent nonsense")


def test_its_log_lines_are_clean_and_no_name_makes_a_logger(
    stage: Stage, caplog: pytest.LogCaptureFixture
) -> None:
    loggers = len(logging.root.manager.loggerDict)
    for number in range(100):
        stage.child.report(
            Logged(logging.ERROR, f"a{number}\n{'x' * 4000}", "text\x1b[2J 100 %s\n\x07E\n\tF")
        )
        stage.vision.poll(stage.clock.now)
    assert len(logging.root.manager.loggerDict) == loggers
    lines = [one for one in caplog.records if one.name.startswith("a")]
    assert len(lines) == 100
    for one in lines:
        assert one.name.isprintable()
        assert len(one.name) < 200
        assert one.getMessage() == "text [2J 100 %s\n  E\n      F"


def test_what_it_says_below_the_level_of_the_log_is_left_out(
    stage: Stage, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        for level in (logging.INFO, logging.WARNING):
            stage.child.report(Logged(level, "eyes", f"level {level}"))
        stage.vision.poll(stage.clock.now)
    assert [one.getMessage() for one in caplog.records if one.name == "eyes"] == ["level 30"]


def test_an_outcome_that_is_told_twice_counts_once(stage: Stage) -> None:
    assert stage.ask("token", unicorn=1.0)
    stage.child.work()
    stage.child._reports *= 2
    assert [one.token for one in stage.vision.poll(stage.clock.now)] == ["token"]
    assert stage.vision.trouble == "vision sent nonsense"


def test_a_frame_judged_before_it_was_ready_is_nonsense(clock: Clock) -> None:
    child = Channel(engine, STEP)
    vision = VisionClient(lambda: child, Config(), None, VISION)
    vision.poll(clock.now)
    child.report(Worker(engine(None), 0).judge(Frame(1, clock.now, np.zeros((8, 8, 3), np.uint8))))
    vision.poll(clock.now)
    assert vision.trouble == "vision sent nonsense"


def test_another_model_after_a_restart_is_told_and_not_taken(
    stage: Stage, caplog: pytest.LogCaptureFixture
) -> None:
    first = stage.vision.ready
    assert first is not None
    stage.child.death = "SIGSEGV"
    stage.turn()
    stage.vision.poll(stage.clock.now)
    stage.child.report(structs.replace(first, model=first.model._replace(id="another")))
    stage.vision.poll(stage.clock.now)
    assert stage.vision.trouble == "vision cannot be loaded"
    assert "it is another now, not painted-1: restart the companion" in caplog.text


def test_a_full_channel_is_a_lost_process(stage: Stage) -> None:
    stage.ask("waits", drum=1.0)
    stage.child.full = True
    assert not stage.ask("does not fit", drum=1.0)
    stage.lost(stage.vision.poll(stage.clock.now), "waits")
    assert stage.vision.trouble == "vision hangs"


def test_reports_that_take_long_to_read_wait_for_the_next_turns(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slowly(packed: bytes) -> object:
        stage.clock.now += 0.015
        report: object = decode(packed)
        return report

    monkeypatch.setattr("companion.vision.client.decode", slowly)
    for read in range(1, 6):
        stage.child.live(CameraStatus(CameraState.DELIVERING, read=read), None)
    stage.child.death = "was killed"
    for read in (2, 4):
        stage.vision.poll(stage.clock.now)
        assert (stage.vision.camera.read, stage.vision.trouble) == (read, "")
    stage.vision.poll(stage.clock.now)
    assert stage.vision.trouble == "vision died (was killed)"


def test_what_is_too_long_to_be_sent_is_a_lost_process_and_no_end_of_the_supervisor(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    def too_long(_: object) -> bytes:
        raise CodecError("a message of 70000000 bytes")

    monkeypatch.setattr("companion.vision.client.encode_trusted", too_long)
    assert not stage.vision.tune(Settings())
    stage.vision.poll(stage.clock.now)
    assert stage.vision.trouble == "vision hangs"


def test_the_waits_before_a_new_start_double_to_a_minute_and_it_never_gives_up(stage: Stage) -> None:
    starts: list[float] = []
    while len(starts) < 9:
        before = len(stage.children)
        stage.child.death = "SIGSEGV"
        stage.vision.poll(stage.clock.now)
        died = stage.clock.now
        while len(stage.children) == before:
            stage.vision.poll(stage.clock.now)
            stage.clock.now += 0.5
        starts.append(stage.clock.now - 0.5 - died)
        stage.turn()
    assert starts == [0.0, 2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0, 60.0]


def test_one_that_ran_for_a_minute_begins_anew(stage: Stage) -> None:
    for _ in range(3):
        stage.child.death = "SIGSEGV"
        stage.silence(5.0)
        stage.until_ready()
        stage.turn(VISION.longest + 1.0)
        before = len(stage.children)
        stage.child.death = "SIGSEGV"
        stage.vision.poll(stage.clock.now)
        stage.vision.poll(stage.clock.now)
        assert len(stage.children) == before + 1, "at once"
        stage.until_ready()
        stage.turn(VISION.longest + 1.0)


def test_three_deaths_in_ten_minutes_and_it_is_not_to_be_relied_on_until_they_are_over(stage: Stage) -> None:
    for number in range(1, 4):
        stage.child.death = "SIGSEGV"
        stage.vision.poll(stage.clock.now)
        assert stage.vision.watchdog.unreliable is (number == 3)
        stage.silence(5.0)
        stage.until_ready()
        stage.turn(60.0)
    assert stage.vision.watchdog.unreliable
    stage.turn(600.0)
    assert not stage.vision.watchdog.unreliable


def test_one_that_cannot_be_started_is_tried_again(stage: Stage, caplog: pytest.LogCaptureFixture) -> None:
    stage.refuses = OSError(12, "Cannot allocate memory")
    stage.child.death = "SIGKILL"
    stage.silence(1.0)
    assert stage.vision.trouble == "vision cannot be started"
    assert "Cannot allocate memory" in caplog.text
    assert not stage.ask("token", drum=1.0)
    stage.refuses = None
    stage.silence(10.0)
    stage.until_ready()
    assert stage.vision.trouble == ""


def test_a_perceiver_that_fails_to_load_at_a_restart_is_told_and_tried_again(
    stage: Stage, caplog: pytest.LogCaptureFixture
) -> None:
    stage.child.death = "SIGSEGV"
    stage.turn()
    stage.vision.poll(stage.clock.now)
    broken = stage.child
    broken.report(Failed("the bundle /opt/eyes is gone: put it back"))
    stage.vision.poll(stage.clock.now)
    assert broken.death == "closed"
    assert stage.vision.trouble == "vision cannot be loaded"
    assert "the bundle /opt/eyes is gone: put it back" in caplog.text
    stage.silence(3.0)
    assert stage.child is not broken
    stage.until_ready()
    assert stage.vision.trouble == ""


def test_a_process_that_cannot_be_started_for_two_days_is_tried_once_a_minute(clock: Clock) -> None:
    def launch() -> LoopbackVision:
        raise OSError("no such file")

    vision = VisionClient(launch, Config(), None, VISION)
    for _ in range(2 * 24 * 60):
        clock.now += 60.0
        vision.poll(clock.now)
        vision.poll(clock.now + 0.02)
    assert vision.watchdog.restarted == pytest.approx(2 * 24 * 60, abs=10)
    assert vision.trouble == "vision cannot be started"


def test_what_it_says_of_the_camera_is_kept_and_forgotten_when_it_dies(stage: Stage) -> None:
    status = CameraStatus(CameraState.DELIVERING, read=7)
    stage.child.report(Alive(status, stage.clock.now))
    stage.vision.poll(stage.clock.now)
    assert (stage.vision.camera, stage.vision.delivered_at) == (status, stage.clock.now)
    stage.child.death = "SIGSEGV"
    stage.vision.poll(stage.clock.now)
    assert stage.vision.delivered_at is None
    assert stage.vision.camera.reason == "ended: SIGSEGV"


def test_where_it_is_is_told_some_five_times_a_second(stage: Stage) -> None:
    for _ in range(100):
        stage.clock.now += 0.02
        stage.vision.situation(Place(1.0, 2.0), None, stage.clock.now, moving=True)
    stage.child.live(CameraStatus(), None)
    stage.turn()
    told = [one for one in stage.child.requests if isinstance(one, Situation)]
    assert told[0] == Situation(Place(1.0, 2.0), rate=10.0)
    assert 9 <= len(told) <= 11


def test_what_ways_are_planned_for_is_told_and_what_was_planned_comes_back(stage: Stage) -> None:
    errand = Errand(Route(((0.0, 0.0), (9.0, 0.0)), 3.0), Outline(0.6, 0.3, 1.5), 1.0)
    stage.clock.now += 1.0
    stage.vision.situation(Place(), None, stage.clock.now, moving=True, errand=errand)
    stage.child.live(CameraStatus(), None)
    stage.turn()
    assert [one.errand for one in stage.child.requests if isinstance(one, Situation)] == [errand]
    made = Planned(Plan(1.0, Pose(1.0, 2.0, 3.0), 2.0, arcs=((0.5, 3.0),), clear=3.0, gap=0.4))
    stage.child.report(made)
    assert [one.report for one in stage.vision.poll(stage.clock.now)] == [made]


def test_each_new_report_of_the_lean_is_told_at_once(stage: Stage) -> None:
    for number in range(4):
        stage.clock.now += 0.02
        lean = MotionReport(stage.clock.now, 0.1 * number, 0.0, 0.0, 0.0)
        for _ in range(2):
            stage.vision.situation(Place(), lean, stage.clock.now, moving=True)
    stage.child.live(CameraStatus(), None)
    stage.turn()
    told = [one.motion for one in stage.child.requests if isinstance(one, Situation)]
    assert [round(one.pitch, 1) for one in told if one is not None] == [0.0, 0.1, 0.2, 0.3]


def test_a_closed_one_has_no_process_and_takes_nothing(stage: Stage) -> None:
    stage.vision.close()
    stage.vision.close()
    assert stage.child.death == "closed"
    assert stage.vision.fileno() is None
    assert not stage.ask("token", drum=1.0)
