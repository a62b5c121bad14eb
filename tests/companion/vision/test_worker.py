"""What the vision process does with frames and requests, in direct calls: no process, no thread."""

from __future__ import annotations

import time
from dataclasses import astuple, replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from anytraverse.assessment import Finding, Reason
from anytraverse.engine import AnyTraverse
from anytraverse.errors import PerceiverError
from anytraverse.frame import Frame, Image, Pose
from anytraverse.grid import LocalGrid
from anytraverse.grid_map import UNKNOWN
from anytraverse.ground import GroundCamera, GroundRegion
from anytraverse.history import Place
from anytraverse.judging import Settings, Thresholds
from anytraverse.memory import first_memory
from anytraverse.operations import Operation, SetWord, Tap
from anytraverse.roi import RoiFigures
from companion.guide.plan import Errand, Outline, Route
from companion.vehicle.motion import MotionReport
from companion.vision import pictures
from companion.vision.memory_copy import updated
from companion.vision.messages import (
    Apply,
    Done,
    Draw,
    Drawn,
    FrameJudged,
    GroundMap,
    Planned,
    Restore,
    Situation,
    Tune,
)
from companion.vision.worker import RECENT, STORED_FRAMES, Worker
from companion.wire.ids import State
from tests.anytraverse.conftest import AHEAD, HEIGHT, WIDTH, Painted
from tests.companion.daemon.rig import picture
from tests.companion.vision.played import WORDS, heard


class Stage:
    """A worker, its engine and its perceiver; it began with revision 7."""

    def __init__(self) -> None:
        self.perceiver = Painted()
        self.first = first_memory(self.perceiver.model_id, WORDS)
        self.engine = AnyTraverse(self.perceiver, Settings(), self.first)
        self.worker = Worker(self.engine, 7)
        self.frames = self.numbers = 0

    def look(self, thing: str = "", scene: int = 0, *, age: float = 0.0) -> FrameJudged:
        """One frame, taken `age` seconds ago."""
        self.frames += 1
        image = picture(thing, scene=scene)
        return self.worker.judge(Frame(self.frames, time.monotonic() - age, image))

    def ask(self, operations: tuple[Operation, ...], frame_id: int = 0, **given: Any) -> Done:
        """What becomes of an answer."""
        self.numbers += 1
        given = {"call_id": 0, "go": False, "place": None, **given}
        (done,) = self.worker.handle(Apply(self.numbers, operations, frame_id, **given))
        assert isinstance(done, Done)
        assert done.number == self.numbers
        return done

    def draw(self, frame_id: int, *, store: bool, roi: RoiFigures | None = None) -> Drawn:
        """The pictures of a frame."""
        (drawn,) = self.worker.handle(Draw(9, frame_id, "a title", State.CALLING, store, roi=roi))
        assert isinstance(drawn, Drawn)
        return drawn


@pytest.fixture
def stage() -> Stage:
    return Stage()


def fail(_: object) -> Image:
    raise RuntimeError("out of memory")


def test_a_frame_is_judged_and_the_first_one_becomes_the_reference(stage: Stage) -> None:
    looked = stage.look()
    assert looked.assessment.ok
    assert looked.revision == 8
    assert looked.update is not None
    assert (looked.update.base, looked.update.revision) == (7, 8)
    assert updated(stage.first, looked.update).reference is not None
    assert len(looked.sectors) == 16
    assert looked.assessment.frame.captured_at <= looked.at <= time.monotonic()


def test_a_frame_that_changes_nothing_is_told_under_the_revision_that_stands(stage: Stage) -> None:
    stage.look()
    again = stage.look()
    assert (again.revision, again.update) == (8, None)


def test_badly_exposed_pictures_are_a_fault_after_t_and_said_once(
    stage: Stage, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    now = 100.0
    monkeypatch.setattr("companion.vision.worker.time", SimpleNamespace(monotonic=lambda: now))
    stage.engine.settings = replace(Settings(), freshness=1.0)
    found = []
    for number in range(1, 40):
        now += 0.1
        white = np.full((120, 160, 3), 255, np.uint8)
        image = white if 3 < number < 30 else picture()
        looked = stage.worker.judge(Frame(number, now, image))
        faults = [one.figure for one in looked.assessment.findings if one.reason is Reason.FAULT]
        found.append("picture overexposed" in faults)
    assert found == [False] * 14 + [True] * 15 + [False] * 10
    told = [record.getMessage() for record in caplog.records]
    assert told == [
        "picture overexposed: turn the camera out of the sun, or let it expose shorter",
        "the picture is well exposed again",
    ]


def test_a_covered_lens_is_told_as_that(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr("companion.vision.worker.time", SimpleNamespace(monotonic=lambda: now))
    stage.engine.settings = replace(Settings(), freshness=1.0)
    stage.worker.judge(Frame(1, now, picture()))
    for number in range(2, 16):
        now += 0.1
        looked = stage.worker.judge(Frame(number, now, np.zeros((120, 160, 3), np.uint8)))
    faults = [one.figure for one in looked.assessment.findings if one.reason is Reason.FAULT]
    assert faults == ["picture black"]


def test_an_answer_in_words_tells_the_change_of_the_memory(stage: Stage) -> None:
    done = stage.ask((SetWord("drum", -1.0),))
    assert done.error == ""
    assert done.update is not None
    assert updated(stage.first, done.update).preferences["drum"] == -1.0
    assert (done.update.base, done.update.revision) == (7, 8)
    done = stage.ask((SetWord("drum", -0.5),))
    assert done.update is not None
    assert (done.update.base, done.update.revision) == (8, 9)


def test_an_answer_that_the_engine_refuses_tells_the_reason_and_changes_nothing(stage: Stage) -> None:
    done = stage.ask((SetWord("unicorn", 1.0),))
    assert "unicorn" in done.error
    assert (done.outcome, done.update, stage.worker.revision) == (None, None, 7)


def test_an_answer_on_which_the_perceiver_breaks_is_told_too(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stage.perceiver, "meaning", lambda _: 1 / 0)
    done = stage.ask((SetWord("drum", 1.0),))
    assert done.error == "the perceiver failed on it: see the companion's log"
    assert done.update is None


def test_a_perceiver_that_raises_makes_a_fault_and_the_next_frame_is_judged(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(stage.perceiver, "encode", fail)
        assert stage.look().assessment.reasons == {Reason.FAULT}
    assert stage.look().assessment.ok


def test_the_log_of_a_broken_perceiver_is_not_flooded(
    stage: Stage, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(stage.perceiver, "encode", fail)
    for _ in range(5):
        stage.look()
    assert sum("could not be judged" in record.message for record in caplog.records) == 1


def test_a_frame_that_took_too_long_to_judge_is_a_fault_with_its_age(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, encode = time.monotonic(), stage.perceiver.encode

    def slow(image: Image) -> Image:
        nonlocal now
        now += 1.2
        return encode(image)

    monkeypatch.setattr("companion.vision.worker.time.monotonic", lambda: now)
    monkeypatch.setattr(stage.perceiver, "encode", slow)
    looked = stage.look()
    assert looked.assessment.reasons == {Reason.FAULT}
    assert looked.assessment.age == pytest.approx(1.2)
    assert looked.duration == pytest.approx(1.2)


def test_a_frame_that_is_old_already_is_a_fault(stage: Stage) -> None:
    assert stage.look(age=1.5).assessment.reasons == {Reason.FAULT}


def test_it_judges_by_the_settings_that_it_was_told_last(stage: Stage) -> None:
    stage.look()
    before = stage.look("drum").assessment.finding(Reason.UNKNOWN_OBJECT)
    assert before is not None
    assert before.threshold == Settings().thresholds.roi
    calm = Thresholds(roi=1.0, tile=None)
    stage.worker.handle(Tune(1, Settings(thresholds=calm)))
    figures = [finding.figure for finding in stage.look("drum").assessment.bad]
    assert before.figure not in figures


def test_a_call_is_answered_with_its_frame_from_when_it_was_kept(stage: Stage) -> None:
    stage.look()
    asked = stage.look("drum").assessment.frame.id
    stage.draw(asked, store=True)
    for _ in range(3 * RECENT):
        stage.look()
    done = stage.ask((SetWord("drum", 1.0),), asked, call_id=3, go=True, place=Place(47.0, 8.0))
    assert done.outcome is not None
    assert done.outcome.call is not None
    assert done.outcome.call.frame.id == asked
    assert done.outcome.remembered
    (entry,) = [entry for entry in stage.engine.memory.history if entry.call_id == 3]
    assert entry.place == Place(47.0, 8.0)
    assert done.update is not None
    assert [one.call_id for one in done.update.entries] == [3]


def test_without_a_place_of_the_call_it_is_the_vehicles(stage: Stage) -> None:
    asked = stage.look("drum").assessment.frame.id
    stage.draw(asked, store=True)
    stage.worker.handle(Situation(Place(1.0, 2.0)))
    stage.ask((SetWord("drum", 1.0),), asked, call_id=3, go=True)
    entry = next(entry for entry in stage.engine.memory.history if entry.call_id == 3)
    assert entry.place == Place(1.0, 2.0)


def test_a_frame_has_the_lean_of_its_own_moment(stage: Stage) -> None:
    assert stage.look().assessment.frame.lean is None, "nothing was reported"
    captured_at = stage.look().assessment.frame.captured_at
    for after in (0.0, 5.0, 0.1):  # the last is older than the newest, and is not taken
        stage.worker.handle(
            Situation(Place(), motion=MotionReport(captured_at + after, 1.0 + after, -2.0, 0.0, 0.0))
        )
    lean = stage.look().assessment.frame.lean
    assert lean == pytest.approx((1.0, -2.0)), "the report that is nearest in time"


def test_a_frame_has_the_pose_of_its_own_moment(stage: Stage) -> None:
    at = time.monotonic() - 0.3
    moving = MotionReport(at + 0.1, 0.0, 0.0, 0.0, 0.0, Pose(5.0, 0.0, 0.0), speed=2.0)
    stage.worker.handle(Situation(Place(), motion=moving))
    pose = stage.look(age=time.monotonic() - at).assessment.frame.pose
    assert pose == pytest.approx((4.8, 0.0, 0.0), abs=0.02), "0.1 s before the report, at 2 m/s"


def test_reports_of_the_lean_that_come_very_often_push_out_no_older_ones_that_a_late_frame_needs(
    stage: Stage,
) -> None:
    captured_at = stage.look().assessment.frame.captured_at
    for number in range(100):
        lean = MotionReport(captured_at + 0.02 * number, 0.01 * number, 0.0, 0.0, 0.0)
        stage.worker.handle(Situation(Place(), motion=lean))
    lean_then = stage.look().assessment.frame.lean
    assert lean_then is not None
    assert lean_then[0] < 0.1


def in_metres(stage: Stage, lean: tuple[float, float] = (0.0, 0.0)) -> list[GroundMap]:
    """What is told of the ground in three seconds of a drive, as a region in metres is in force."""
    camera = GroundCamera.pinhole(1.0, 20.0, 75.0, WIDTH / HEIGHT)
    ground = GroundRegion(camera, near=1.5, far=4.5, width=1.4, vehicle=0.6)
    region = ground.in_picture(None).region.bounds
    stage.engine.settings = Settings(ground=ground, region=region, freshness=10.0)
    told, now = [], time.monotonic() - 3.0
    for number in range(12):
        at = now + 0.25 * number
        motion = MotionReport(at, *lean, 0.0, 0.0, Pose(0.25 * number, 0.0, 0.0), 1.0)
        stage.worker.handle(Situation(Place(), motion=motion))
        told.append(stage.worker.remember_ground(stage.look(age=time.monotonic() - at).assessment))
    return [one for one in told if one is not None]


def test_the_ground_is_told_once_a_second_where_it_is_known_in_metres(stage: Stage) -> None:
    assert stage.worker.remember_ground(stage.look().assessment) is None
    told = [one.content for one in in_metres(stage)]
    assert len(told) == 3
    assert all(0.9 < later.at - sooner.at < 1.3 for sooner, later in pairwise(told))
    known = [int((one.layers[0] != UNKNOWN).sum()) for one in told]
    assert known[0] < known[1] < known[2], "what it has passed is remembered"


def test_the_ground_is_marked_as_the_vehicle_leans(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[GroundCamera] = []
    monkeypatch.setattr(LocalGrid, "update", lambda _grid, _maps, camera, *_: seen.append(camera))
    in_metres(stage, lean=(3.0, -2.0))
    assert {(camera.pitch, camera.bank) for camera in seen} == {(3.0, -2.0)}


def test_a_frame_with_a_fault_marks_no_ground(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stage.worker, "_camera_faults", lambda *_: [Finding.fault("too dark")])
    assert all((one.content.layers[0] == UNKNOWN).all() for one in in_metres(stage))


def test_a_grid_that_fails_costs_no_frame(
    stage: Stage, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fails(*_: object) -> None:
        raise ValueError("no grid")

    monkeypatch.setattr(LocalGrid, "update", fails)
    assert in_metres(stage) == []
    assert "no grid" in caplog.text
    assert stage.look().assessment.maps is not None


ERRAND = Errand(Route(((-1.0, 0.0), (20.0, 0.0)), 3.0), Outline(0.6, 0.3, 1.5), 1.0)


def ways(stage: Stage) -> list[Planned]:
    """What is planned with a frame, after three seconds of a drive."""
    in_metres(stage)
    at, found = time.monotonic() - 0.2, []
    for number in range(2):
        motion = MotionReport(at + 0.2 * number, 0.0, 0.0, 0.0, 0.0, Pose(3.0 + 0.2 * number, 0.0, 0.0), 1.0)
        stage.worker.handle(Situation(Place(), motion=motion, errand=ERRAND))
        seen = stage.look(age=time.monotonic() - motion.at).assessment
        stage.worker.remember_ground(seen)
        found.append(stage.worker.plan(seen))
    return [one for one in found if one is not None]


def test_a_way_is_planned_with_each_frame_while_there_is_an_errand(stage: Stage) -> None:
    sooner, later = (one.content for one in ways(stage))
    assert later.at == pytest.approx(sooner.at + 0.2, abs=0.1)
    assert 2.5 < sooner.pose.x < later.pose.x < 3.5
    assert later.clear > 2.0
    assert later.route_clear > 2.0
    stage.worker.handle(Situation(Place()))
    assert stage.worker.plan(stage.look().assessment) is None


def test_no_way_is_planned_with_a_frame_that_has_a_fault(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stage.worker, "_camera_faults", lambda *_: [Finding.fault("too dark")])
    assert ways(stage) == []


def test_planning_that_fails_costs_no_frame_and_is_logged_once(
    stage: Stage, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise ValueError("no way")

    monkeypatch.setattr("companion.vision.worker.plan", fails)
    assert ways(stage) == []
    assert caplog.text.count("no way could be planned after frame") == 1


@pytest.mark.parametrize("frame_id", [2, 77])
def test_an_answer_about_a_frame_that_is_gone_is_refused_and_teaches_nothing(
    stage: Stage, frame_id: int
) -> None:
    stage.look()
    stage.look("drum")
    memory = stage.engine.memory
    done = stage.ask((SetWord("drum", 1.0),), frame_id, call_id=3)
    assert "its frame is lost: send it again" in done.error
    assert stage.engine.memory is memory


def test_a_picture_is_of_the_judgement_that_the_call_has_though_words_came_since(stage: Stage) -> None:
    called = stage.look("drum").assessment
    before = stage.draw(called.frame.id, store=False)
    assert stage.ask((SetWord("drum", 1.0),)).outcome is not None
    assert stage.draw(called.frame.id, store=False).panel != before.panel
    drawn = stage.draw(called.frame.id, store=True, roi=called.roi)
    assert drawn.panel == before.panel
    done = stage.ask((SetWord("drum", 0.5),), called.frame.id, call_id=3)
    assert done.outcome is not None
    assert done.outcome.call is not None
    assert stage.draw(called.frame.id, store=False, roi=done.outcome.call.roi).panel != before.panel


def test_only_the_newest_frames_can_be_drawn_and_kept(stage: Stage, caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(RECENT + 1):
        stage.look()
    assert stage.draw(1, store=True) == Drawn(9, 1, "a title")
    assert "frame 1 is gone" in caplog.text
    assert stage.draw(2, store=True).png


def test_of_kept_frames_the_oldest_goes(stage: Stage) -> None:
    for _ in range(STORED_FRAMES + 1):
        stage.draw(stage.look("drum").assessment.frame.id, store=True)
    for _ in range(RECENT):
        stage.look()
    assert "lost" in stage.ask((SetWord("drum", 1.0),), 1, call_id=1).error
    for frame_id in range(2, STORED_FRAMES + 2):
        assert stage.ask((SetWord("drum", 1.0),), frame_id, call_id=frame_id).error == ""


def test_a_frame_that_is_kept_comes_without_loss_and_one_for_the_album_does_not(stage: Stage) -> None:
    looked = stage.look("drum")
    drawn = stage.draw(1, store=False)
    assert drawn.panel
    assert (drawn.thumbnail, drawn.png, drawn.raw) == (b"", b"", b"")
    kept = stage.draw(1, store=True)
    assert kept.thumbnail
    assert (pictures.from_png(kept.png) == looked.assessment.frame.image).all()


def test_a_frame_too_large_to_be_sent_is_kept_all_the_same(
    stage: Stage, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(pictures, "LARGEST_PNG", 100)
    stage.look("drum")
    drawn = stage.draw(1, store=True)
    assert (drawn.png, drawn.stored) == (b"", True)
    assert "no copy of a title" in caplog.text
    assert stage.ask((SetWord("drum", 1.0),), 1, call_id=1).error == ""


def test_a_picture_that_cannot_be_drawn_is_left_out_and_no_fault(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage.look("drum")
    monkeypatch.setattr(pictures, "panel", lambda *_: 1 / 0)
    drawn = stage.draw(1, store=True)
    assert drawn.panel == b""
    assert drawn.png
    assert stage.look().assessment.observation is not None


def test_a_frame_that_comes_back_can_be_answered_and_tapped_in(stage: Stage) -> None:
    png = pictures.to_png(picture("gnome"))
    (done,) = stage.worker.handle(Restore(1, 55, png))
    assert isinstance(done, Done)
    assert done.outcome is not None
    assert done.outcome.call is not None
    assert Reason.UNKNOWN_OBJECT in done.outcome.call.reasons
    told = stage.ask((Tap(55, astuple(AHEAD), "gnome", -1.0),), 55, call_id=4)
    assert told.error == ""
    assert stage.engine.memory.examples["gnome"]


@pytest.mark.parametrize("png", [b"", b"torn", b"\x89PNG\r\n\x1a\n", pictures.to_png(picture())[:-40]])
def test_a_torn_frame_that_comes_back_is_an_error_that_is_told(stage: Stage, png: bytes) -> None:
    (done,) = stage.worker.handle(Restore(1, 55, png))
    assert isinstance(done, Done)
    assert done.error or done.outcome is not None
    assert stage.look().assessment.ok


@pytest.mark.parametrize("text", ["", "a tensor of " + 5000 * "x", "a tensor\n\x1b[2J"])
def test_an_error_without_words_or_of_many_is_told_so_that_it_is_believed(
    stage: Stage, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    def broken(_: Image) -> Image:
        raise PerceiverError(text)

    monkeypatch.setattr(stage.perceiver, "encode", broken)
    (done,) = stage.worker.handle(Restore(1, 55, pictures.to_png(picture())))
    heard(done)
    assert isinstance(done, Done)
    assert done.outcome is None
    monkeypatch.setattr(stage.perceiver, "meaning", broken)
    heard(stage.ask((SetWord("drum", 1.0),)))


def test_what_is_no_picture_is_not_encoded() -> None:
    with pytest.raises(ValueError, match="not an RGB picture"):
        pictures.to_png(np.ones((4, 4), np.uint8))
