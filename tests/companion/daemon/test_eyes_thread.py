"""The real thread of the eyes, with a perceiver that is told what to do."""

from __future__ import annotations

import select
import threading
import time
from collections.abc import Callable, Iterator

import pytest
from companion.eyes import MAX_JOBS, MAX_RESULTS, Applied, Eyes, Judged, Result

from anytraverse.answers import Changes
from anytraverse.assessment import Reason
from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame, Image
from anytraverse.judging import Settings
from anytraverse.memory import first_memory
from anytraverse.preferences import Preferences
from companion import eyes as module
from tests.anytraverse.conftest import Painted
from tests.companion.daemon.rig import picture

PATIENCE = 5.0


class Slot:
    """A camera that gives what it is given."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.news = threading.Condition()

    def put(self, *frames: Frame) -> None:
        """These come next."""
        with self.news:
            self.frames += frames
            self.news.notify()

    def take(self, timeout: float) -> Frame | None:
        """The next one."""
        with self.news:
            self.news.wait_for(lambda: bool(self.frames), timeout)
            return self.frames.pop(0) if self.frames else None


class Gate(Painted):
    """Painted eyes whose `encode` waits while the gate is shut."""

    def __init__(self) -> None:
        super().__init__()
        self.open = threading.Event()
        self.open.set()
        self.entered = threading.Event()
        self.fail: Exception | None = None

    def encode(self, image: Image) -> Image:
        """The picture itself, once the gate is open."""
        self.entered.set()
        self.open.wait(PATIENCE)
        if self.fail is not None:
            raise self.fail
        return super().encode(image)


class Stage:
    """Running eyes."""

    def __init__(self, period: float = 0.0, freshness: float = 1.0) -> None:
        self.perceiver, self.slot = Gate(), Slot()
        memory = first_memory(self.perceiver.model_id, Preferences.parse("grass: 1; rock: -1"))
        self.engine = AnyTraverse(self.perceiver, Settings(freshness=freshness), memory)
        self.eyes = Eyes(self.engine, self.slot, period)
        self.frame_id = 0

    def show(self, thing: str = "") -> None:
        """One frame, taken now."""
        self.frame_id += 1
        self.slot.put(Frame(self.frame_id, time.monotonic(), picture(thing)))

    def results(self, fits: Callable[[list[Result]], bool]) -> list[Result]:
        """All results, once they fit."""
        found: list[Result] = []
        deadline = time.monotonic() + PATIENCE
        while not fits(found):
            assert time.monotonic() < deadline, found
            select.select([self.eyes.fileno()], [], [], 0.1)
            found += self.eyes.results()
        return found

    def ask(self, token: object, **weights: float) -> bool:
        """Words without a call."""
        return self.eyes.answer(token, Changes(weights), call=None, call_id=0, go=False)


@pytest.fixture
def stage() -> Iterator[Stage]:
    stage = Stage()
    stage.eyes.start()
    yield stage
    stage.perceiver.open.set()
    stage.eyes.stop()


def one(results: list[Result]) -> bool:
    return len(results) >= 1


def test_frames_are_judged_and_the_descriptor_tells(stage: Stage) -> None:
    stage.show()
    (judged,) = stage.results(one)
    assert isinstance(judged, Judged)
    assert judged.assessment.ok
    assert judged.memory.reference is not None
    assert select.select([stage.eyes.fileno()], [], [], 0)[0] == [], "all is read"


def test_an_answer_is_applied_before_the_next_frame_with_its_token(stage: Stage) -> None:
    token = object()
    assert stage.ask(token, drum=-1.0)
    (applied,) = stage.results(one)
    assert isinstance(applied, Applied)
    assert applied.token is token
    assert applied.memory.preferences["drum"] == -1.0


def test_an_answer_that_the_engine_refuses_comes_back_with_the_reason(stage: Stage) -> None:
    stage.ask("token", unicorn=1.0)
    (applied,) = stage.results(one)
    assert isinstance(applied, Applied)
    assert "unicorn" in str(applied.error)
    assert "unicorn" not in applied.memory.preferences


def test_an_answer_on_which_the_perceiver_breaks_comes_back_too(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stage.perceiver, "meaning", lambda _: 1 / 0)
    stage.ask("token", drum=1.0)
    (applied,) = stage.results(one)
    assert isinstance(applied, Applied)
    assert str(applied.error) == "the perceiver failed on it: see the companion's log"


def test_a_perceiver_that_raises_makes_a_fault_and_the_thread_goes_on(stage: Stage) -> None:
    stage.perceiver.fail = RuntimeError("out of memory")
    stage.show()
    (judged,) = stage.results(one)
    assert isinstance(judged, Judged)
    assert judged.assessment.reasons == {Reason.FAULT}
    stage.perceiver.fail = None
    stage.show()
    (judged,) = stage.results(one)
    assert isinstance(judged, Judged)
    assert judged.assessment.ok


def test_the_log_of_a_broken_perceiver_is_not_flooded(stage: Stage, caplog: pytest.LogCaptureFixture) -> None:
    stage.perceiver.fail = RuntimeError("out of memory")
    for _ in range(5):
        stage.show()
    stage.results(lambda found: len(found) == 5)
    assert sum("could not be judged" in record.message for record in caplog.records) == 1


def test_a_frame_that_took_too_long_to_judge_is_a_fault_with_its_age() -> None:
    stage = Stage(freshness=0.05)
    stage.perceiver.open.clear()
    stage.eyes.start()
    stage.show()
    assert stage.perceiver.entered.wait(PATIENCE)
    time.sleep(0.08)
    stage.perceiver.open.set()
    (judged,) = stage.results(one)
    stage.eyes.stop()
    assert isinstance(judged, Judged)
    assert judged.assessment.reasons == {Reason.FAULT}
    assert judged.assessment.age > 0.08


def test_hung_eyes_take_no_jobs_and_stopping_does_not_wait_for_them(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "HUNG_AFTER", 0.05)
    stage.perceiver.open.clear()
    stage.show()
    assert stage.perceiver.entered.wait(PATIENCE)
    time.sleep(0.08)
    assert not stage.ask("token", drum=1.0)
    assert not stage.eyes.retune(Settings())
    started = time.monotonic()
    stage.eyes.stop(timeout=0.05)
    assert time.monotonic() - started < 1.0
    assert stage.eyes.fileno() >= 0, "the thread may still write to it"


def test_waiting_jobs_are_bounded(stage: Stage) -> None:
    stage.perceiver.open.clear()
    stage.show()
    assert stage.perceiver.entered.wait(PATIENCE)
    taken = [stage.ask(number, drum=1.0) for number in range(MAX_JOBS + 2)]
    assert taken == [True] * MAX_JOBS + [False] * 2
    stage.perceiver.open.set()
    found = stage.results(lambda found: len(found) == 1 + MAX_JOBS)
    assert [applied.token for applied in found if isinstance(applied, Applied)] == list(range(MAX_JOBS))


def test_unread_results_are_bounded_and_no_answer_is_lost_among_them(stage: Stage) -> None:
    stage.ask("token", drum=1.0)
    for _ in range(MAX_RESULTS + 20):
        stage.show()
    deadline = time.monotonic() + PATIENCE
    while stage.perceiver.encoded < MAX_RESULTS + 20 and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.02)
    found = stage.eyes.results()
    assert len(found) <= MAX_RESULTS + 1
    assert isinstance(found[0], Applied)
    last = found[-1]
    assert isinstance(last, Judged)
    assert last.assessment.frame.id == stage.frame_id


def test_of_a_faster_camera_frames_are_left_out_and_none_is_kept_waiting() -> None:
    stage = Stage(period=0.1)
    stage.eyes.start()
    for _ in range(30):
        stage.show()
        time.sleep(0.033)
    found = [result for result in stage.eyes.results() if isinstance(result, Judged)]
    stage.eyes.stop()
    assert 6 <= len(found) <= 13
    ages = sorted(judged.assessment.age for judged in found)
    assert ages[len(ages) // 2] < 0.02


def test_stopping_gives_the_descriptors_back() -> None:
    stage = Stage()
    stage.eyes.start()
    stage.eyes.stop()
    assert stage.eyes.fileno() == -1
    stage.eyes.stop()
