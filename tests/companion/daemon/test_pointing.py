"""Somebody points at a thing in the video of a ground station that is not ours."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config.video import CameraSettings
from companion.daemon.live_picture import LEGEND, ShownFrame
from companion.vision import pictures
from companion.vision.messages import Draw
from companion.wire.ids import Policy
from tests.anytraverse.conftest import AHEAD
from tests.companion.daemon.rig import AUTO, HOLD, MakeRig, Rig

POINT, RECTANGLE, ANSWER = 2004, 2005, 31010
ACCEPTED, LATER = 0, 1
SIDES = (AHEAD.left, AHEAD.top, AHEAD.right, AHEAD.bottom)


class Viewer:
    """Somebody who watches the video of a rig, and its video process."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.pictures: list[ShownFrame] = []
        self.since = rig.clock.now
        rig.daemon.pointing.shown_for = self.shown_for
        rig.daemon.video_pictures.watched = True

    def shown_for(self, number: int, now: float) -> float:
        return now - self.since if self.pictures and number == self.pictures[-1].number else 0.0

    def see(self, seconds: float, thing: str = "") -> None:
        for _ in range(round(seconds * 10)):
            self.rig.see(0.1, thing)
            picture = self.rig.daemon.video_pictures.take(self.rig.clock.now)
            if picture is not None:
                if not self.pictures or picture.number != self.pictures[-1].number:
                    self.since = self.rig.clock.now
                self.pictures.append(picture)

    def tap(self, *values: float, thing: str = "drum", number: int = RECTANGLE) -> int:
        """Tap, and return the result that the camera acknowledged."""
        return self.command(100, number, *values, thing=thing)

    def command(self, component: int, number: int, *values: float, thing: str = "drum") -> int:
        padded = [*values, *[0.0] * (7 - len(values))]
        self.rig.stage.send(mavlink.MAVLink_command_long_message(1, component, number, 0, *padded))
        self.see(0.5, thing)
        ack = self.rig.stage.sent("COMMAND_ACK")[-1]
        assert (ack.get_srcComponent(), ack.command) == (component, number)
        return int(ack.result)

    @property
    def draws(self) -> list[Draw]:
        return [one for one in self.rig.child.requests if isinstance(one, Draw) and one.video is not None]


@pytest.fixture
def viewer(make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch) -> Viewer:
    """Watches a rover that stands before a drum that no word explains: call 1."""
    monkeypatch.setattr(Rig, "mavlink_camera", CameraSettings(100, 5.0, 75))
    viewer = Viewer(make_rig())
    viewer.see(0.5)
    viewer.see(3.0, "drum")
    assert viewer.rig.state == ("CALLING", 1)
    return viewer


def word_index(rig: Rig) -> int:
    """The index of the parameter of "drum"."""
    parameters = rig.stage.link.parameters
    return next(one for one in range(48) if getattr(parameters.at(one), "word", "") == "drum")


@pytest.mark.slow
def test_one_tap_and_one_button_are_a_complete_answer(viewer: Viewer) -> None:
    rig = viewer.rig
    assert viewer.tap(*SIDES) == ACCEPTED
    assert rig.vision.words["obstacle"] == -1.0
    assert viewer.command(191, ANSWER, 0, 1) == ACCEPTED
    assert rig.stage.mode == HOLD, "the drum is an obstacle, and it is still there"
    assert "C1 blocked 57% drivable: waiting" in rig.texts
    viewer.see(3.0)
    assert rig.stage.mode == AUTO
    assert rig.state == ("OK", 0)


def test_a_point_in_the_place_that_is_asked_about_means_that_place(viewer: Viewer) -> None:
    place = viewer.rig.daemon.pointing.marks().place
    assert place is not None
    assert viewer.tap(place.left + 0.01, place.bottom - 0.01, number=POINT) == ACCEPTED
    assert "obstacle" in viewer.rig.engine.memory.examples
    (tapped,) = viewer.rig.daemon.pointing.marks().taps
    assert (tapped.left, tapped.bottom) == pytest.approx((place.left, place.bottom), abs=1e-3)


def test_a_point_beside_it_is_a_small_square_in_the_picture(viewer: Viewer) -> None:
    assert viewer.tap(0.99, 0.99, number=POINT) == ACCEPTED
    (box,) = viewer.rig.daemon.pointing.marks().taps
    assert (box.right, box.bottom) == (1.0, 1.0)
    assert box.left == pytest.approx(0.93)


@pytest.mark.slow
def test_the_word_is_chosen_by_a_parameter_for_one_tap(viewer: Viewer) -> None:
    rig = viewer.rig
    index = word_index(rig)
    rig.set("AT_TAP_WORD", float(index))
    viewer.see(0.5, "drum")
    assert rig.echoes("AT_TAP_WORD")[-1] == index
    assert "Tap it: drum -1" in viewer.draws[-1].video.note  # type: ignore[union-attr]
    # Another operator may have aimed while the video still said "obstacle".
    refused(viewer, "C1 not in the video yet: look, then tap")
    viewer.see(2.0, "drum")
    assert viewer.tap(*SIDES) == ACCEPTED
    assert rig.vision.words["drum"] == -1.0
    assert rig.echoes("AT_TAP_WORD")[-1] == -1.0


@pytest.mark.slow
def test_the_word_is_an_obstacle_again_once_the_call_is_over(viewer: Viewer) -> None:
    rig = viewer.rig
    rig.set("AT_TAP_WORD", float(word_index(rig)))
    viewer.see(0.5, "drum")
    viewer.command(191, ANSWER, 0, 1)
    viewer.see(4.0)
    assert rig.state == ("OK", 0)
    assert rig.echoes("AT_TAP_WORD")[-1] == -1.0


def test_the_still_picture_is_requested_in_the_turn_in_which_the_call_opens(viewer: Viewer) -> None:
    still = next(one for one in viewer.draws if one.video is not None and one.video.note != LEGEND)
    assert viewer.rig.calls.call is not None
    assert still.frame_id == viewer.rig.calls.call.frame_id
    later = viewer.draws[viewer.draws.index(still) + 1 :]
    assert all(one.frame_id == still.frame_id for one in later)


def test_a_still_picture_that_could_not_be_drawn_is_requested_again_and_none_poses_as_it(
    viewer: Viewer, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> bytes:
        raise ValueError("no picture")

    shown = viewer.pictures[-1].number
    with monkeypatch.context() as patched:
        patched.setattr(pictures, "video_picture", fail)
        viewer.rig.set("AT_TAP_WORD", float(word_index(viewer.rig)))
        viewer.see(0.5, "drum")
        viewer.pictures.clear()
        viewer.see(2.0, "drum")
        assert viewer.pictures == []
        refused(viewer, "C1 not in the video yet: look, then tap")
    viewer.see(1.5, "drum")
    assert viewer.pictures[-1].number > shown > 0


def test_while_vision_hangs_the_still_picture_is_not_given_as_new(viewer: Viewer) -> None:
    viewer.rig.hung = True
    viewer.see(2.6, "drum")
    viewer.pictures.clear()
    viewer.see(1.5, "drum")
    assert viewer.pictures == []


def test_an_index_that_is_no_words_is_refused(viewer: Viewer) -> None:
    viewer.rig.set("AT_TAP_WORD", 0.0)
    viewer.see(0.5, "drum")
    assert viewer.rig.echoes("AT_TAP_WORD")[-1] == -1.0
    assert "AT_TAP_WORD takes -1 or a word's index: kept" in viewer.rig.texts


@pytest.mark.slow
def test_the_video_stands_still_with_the_place_marked_while_it_is_asked(viewer: Viewer) -> None:
    rig = viewer.rig
    assert rig.calls.call is not None
    assert viewer.pictures[0].frame < rig.calls.call.frame_id
    assert {one.frame for one in viewer.pictures[-3:]} == {rig.calls.call.frame_id}
    still = viewer.draws[-1]
    assert still.title.startswith("C1 unknown ")
    assert still.video is not None
    assert still.video.place is not None
    assert still.video.note == "STILL PICTURE. Tap it: obstacle -1. Then go, or stay"
    drawn = len(viewer.draws)
    viewer.see(2.0, "drum")
    assert len(viewer.draws) == drawn, "it is drawn once, and shown again once a second"
    viewer.tap(*SIDES)
    assert viewer.draws[-1].video.taps != ()  # type: ignore[union-attr]
    viewer.see(6.0, "drum")
    assert viewer.draws[-1].video.note == LEGEND, "answered: now it is live"  # type: ignore[union-attr]
    assert viewer.pictures[-1].frame > rig.calls.current_id


def test_nothing_is_drawn_for_nobody(viewer: Viewer) -> None:
    viewer.rig.daemon.video_pictures.watched = False
    viewer.see(0.3)
    drawn = len(viewer.draws)
    viewer.see(2.0)
    assert len(viewer.draws) == drawn


@pytest.mark.slow
def test_live_pictures_are_no_more_than_wanted(viewer: Viewer) -> None:
    viewer.rig.daemon.video_pictures.watched = False
    viewer.command(191, ANSWER, 0, 1)
    viewer.see(4.0)
    viewer.rig.daemon.video_pictures.watched = True
    before = len(viewer.draws)
    viewer.see(4.0)
    assert 16 <= len(viewer.draws) - before <= 21, "five a second, of ten frames"
    viewer.rig.vision.rate.why = "hot computer"
    before = len(viewer.draws)
    viewer.see(4.0)
    assert 3 <= len(viewer.draws) - before <= 5, "drawing must not take from judging"


def refused(viewer: Viewer, text: str, thing: str = "drum") -> None:
    words = dict(viewer.rig.vision.words)
    assert viewer.tap(*SIDES, thing=thing) == LATER
    assert viewer.rig.texts[-1] == text
    assert dict(viewer.rig.vision.words) == words
    assert viewer.rig.engine.memory.examples == {}


@pytest.mark.slow
def test_a_tap_in_a_video_that_does_not_show_the_calls_frame_changes_nothing(viewer: Viewer) -> None:
    viewer.since = viewer.rig.clock.now - 1.0
    refused(viewer, "C1 not in the video yet: look, then tap")
    viewer.rig.daemon.pointing.shown_for = lambda _frame, _now: 0.0
    viewer.see(6.0, "drum")
    refused(viewer, "C1 not in the video yet: look, then tap")


def test_a_tap_with_nothing_open_changes_nothing(make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Rig, "mavlink_camera", CameraSettings(100, 5.0, 75))
    viewer = Viewer(make_rig(policy=Policy.REPORT))
    viewer.see(2.0)
    refused(viewer, "No call or hold is open: nothing changed", thing="")


def test_a_tap_once_the_reasons_are_gone_changes_nothing(viewer: Viewer) -> None:
    viewer.see(2.0)
    assert viewer.rig.texts[-1] == "C1 clear now, go?"
    refused(viewer, "C1 needs no tap: go or stay", thing="")


@pytest.mark.slow
def test_what_was_tapped_is_marked_until_the_call_is_over(viewer: Viewer) -> None:
    stage = viewer.rig.stage
    viewer.command(100, 511, 275, 500_000)
    viewer.tap(*SIDES)
    viewer.see(1.0, "drum")
    status = stage.sent("CAMERA_TRACKING_IMAGE_STATUS")[-1]
    assert (status.tracking_status, status.rec_top_x) == (1, pytest.approx(AHEAD.left, abs=1e-3))
    viewer.command(191, ANSWER, 0, 1)
    viewer.see(4.0)
    assert stage.sent("CAMERA_TRACKING_IMAGE_STATUS")[-1].tracking_status == 0
    assert viewer.rig.daemon.pointing.marks().taps == ()
