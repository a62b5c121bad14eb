"""The companion as a MAVLink camera: what it tells, whose taps it takes, and when it is silent."""

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import Tap
from anytraverse.regions import Box
from companion.config.video import CameraSettings
from companion.link.camera import SMALLEST, Tapped, read_tap
from companion.sim.loopback_link import LoopbackLink
from companion.wire.answers import Acknowledgement, Answer, Via
from companion.wire.ids import Motion, Result

CAMERA = 101
GROUND = (255, 190)
ACCEPTED, LATER, DENIED, UNSUPPORTED = 0, 1, 2, 3
POINT, RECTANGLE, STOP = 2004, 2005, 2010
REQUEST, SET_RATE = 512, 511
URL = "rtsp://rover.local:8554/anytraverse"
ANSWER = Answer(7, Motion.NONE, (Tap(3, (0.4, 0.5, 0.6, 0.7), "obstacle", -1.0),))


@pytest.fixture
def stage() -> LoopbackLink:
    stage = LoopbackLink(camera=CameraSettings(CAMERA, 5.0, 75))
    stage.link.camera.url, stage.link.camera.size = URL, (360, 640)
    stage.link.camera.resolve = lambda _tap, _now: ANSWER
    stage.run(0.1)
    return stage


def of_camera(stage: LoopbackLink, kind: str) -> list[Any]:
    return [message for message in stage.sent(kind) if message.get_srcComponent() == CAMERA]


def send(
    stage: LoopbackLink,
    number: int,
    *values: float,
    sender: tuple[int, int] = GROUND,
    target: tuple[int, int] = (1, CAMERA),
    again: int = 0,
) -> None:
    padded = [*values, *[0.0] * (7 - len(values))]
    stage.send(mavlink.MAVLink_command_long_message(*target, number, again, *padded), sender)
    stage.run(0.3)


def ask(stage: LoopbackLink, number: int, *values: float, sender: tuple[int, int] = GROUND) -> int:
    """The result that the camera acknowledged."""
    send(stage, number, *values, sender=sender)
    ack = of_camera(stage, "COMMAND_ACK")[-1]
    assert (ack.command, ack.target_system, ack.target_component) == (number, *sender)
    return int(ack.result)


def test_a_ground_station_finds_the_camera_its_video_and_that_it_can_be_tapped(stage: LoopbackLink) -> None:
    stage.run(2.0)
    beats = of_camera(stage, "HEARTBEAT")
    assert len(beats) == 3
    assert {(one.type, one.autopilot, one.base_mode) for one in beats} == {(mavlink.MAV_TYPE_CAMERA, 8, 0)}
    assert ask(stage, REQUEST, mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION) == ACCEPTED
    (told,) = of_camera(stage, "CAMERA_INFORMATION")
    assert told.flags == 256 + 512 + 1024
    assert (told.resolution_h, told.resolution_v, told.cam_definition_uri) == (640, 360, "")
    assert bytes(told.model_name).rstrip(b"\0") == b"AnyTraverse"
    assert ask(stage, REQUEST, mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION, 1) == ACCEPTED
    unasked, video = of_camera(stage, "VIDEO_STREAM_INFORMATION")
    assert unasked.uri == video.uri, "a client that has just found the camera may not ask"
    assert (video.uri, video.type, video.encoding) == (URL, 0, 1)
    assert (video.stream_id, video.count, video.hfov, video.framerate) == (1, 1, 75, 5.0)


@pytest.mark.parametrize(
    ("number", "kind"),
    [
        (521, "CAMERA_INFORMATION"),
        (522, "CAMERA_SETTINGS"),
        (525, "STORAGE_INFORMATION"),
        (527, "CAMERA_CAPTURE_STATUS"),
        (2504, "VIDEO_STREAM_INFORMATION"),
        (2505, "VIDEO_STREAM_STATUS"),
    ],
)
def test_the_older_requests_are_answered_too_and_anybody_may_read(
    stage: LoopbackLink, number: int, kind: str
) -> None:
    assert ask(stage, number, 1, sender=(42, 1)) == ACCEPTED
    assert len(of_camera(stage, kind)) == 1


@pytest.mark.parametrize("number", [400, 2000, 2500, 31010, 176])
def test_what_a_camera_of_ours_cannot_do_is_unsupported(stage: LoopbackLink, number: int) -> None:
    assert ask(stage, number, 1) == UNSUPPORTED
    assert stage.reported(Answer) == []


def test_without_a_picture_yet_it_is_asked_again_later(stage: LoopbackLink) -> None:
    stage.link.camera.size = None
    assert ask(stage, REQUEST, mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION) == LATER
    stage.link.camera.size, stage.link.camera.url = (480, 640), ""
    assert ask(stage, REQUEST, mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION) == LATER
    beats = len(of_camera(stage, "HEARTBEAT"))
    stage.run(3.0)
    assert len(of_camera(stage, "HEARTBEAT")) == beats, "and it is not heard meanwhile"


def test_each_component_counts_its_own_frames(stage: LoopbackLink) -> None:
    stage.run(4.0)
    for component in (CAMERA, 191):
        numbers = [f.message.get_seq() for f in stage.frames if f.message.get_srcComponent() == component]
        assert len(numbers) >= 4
        assert numbers == list(range(len(numbers)))


def test_a_companion_that_is_no_camera_says_and_answers_nothing_as_one() -> None:
    stage = LoopbackLink()
    stage.run(2.0)
    send(stage, REQUEST, mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION, target=(1, 100))
    assert {frame.message.get_srcComponent() for frame in stage.frames} == {191}
    assert stage.sent("COMMAND_ACK") == []
    # pymavlink's component is 0 unless it is told another.
    send(stage, REQUEST, 148.0, sender=(1, 0), target=(1, 191))
    assert len(stage.sent("COMMAND_ACK")) == 1
    assert stage.sent("STATUSTEXT") == []


def test_a_tap_becomes_an_answer_and_its_result_comes_from_the_camera(stage: LoopbackLink) -> None:
    taps: list[Tapped] = []

    def resolve(tap: Tapped, _now: float) -> Answer:
        taps.append(tap)
        return ANSWER

    stage.link.camera.resolve = resolve
    send(stage, RECTANGLE, 0.75, 0.75, 0.25, 0.5)
    assert taps == [Box(0.25, 0.5, 0.75, 0.75)], "from any corner"
    (answer,) = stage.reported(Answer)
    assert answer == replace(ANSWER, sender=GROUND, via=Via.TRACK_RECTANGLE)
    assert of_camera(stage, "COMMAND_ACK") == []
    stage.link.answers.acknowledge(
        answer, Acknowledgement.without_figures(0, 7, Result.APPLIED, "C7 go?"), stage.now
    )
    stage.run(0.2)
    (ack,) = stage.sent("COMMAND_ACK")
    assert (ack.get_srcComponent(), ack.command, ack.result) == (CAMERA, RECTANGLE, ACCEPTED)
    assert stage.sent("STATUSTEXT")[-1].text == "C7 go?"


def test_a_tap_that_is_sent_again_is_one_tap_even_when_its_call_is_over(stage: LoopbackLink) -> None:
    send(stage, POINT, 0.5, 0.6)
    (answer,) = stage.reported(Answer)
    send(stage, POINT, 0.1, 0.6, sender=(254, 190))
    assert len(stage.reported(Answer)) == 2, "another operator's"
    send(stage, POINT, 0.5, 0.6, again=1)
    stage.link.answers.acknowledge(
        answer, Acknowledgement.without_figures(0, 7, Result.APPLIED, "closed"), stage.now
    )
    stage.link.camera.resolve = lambda _tap, _now: "No call or hold is open: nothing changed"
    send(stage, POINT, 0.5, 0.6, again=2)
    assert len(stage.reported(Answer)) == 2
    assert [ack.result for ack in of_camera(stage, "COMMAND_ACK")] == [ACCEPTED, ACCEPTED]


def test_a_tap_that_means_nothing_is_refused_with_the_reason(stage: LoopbackLink) -> None:
    stage.link.camera.resolve = lambda _tap, _now: "C7 not in the video yet: look, then tap"
    assert ask(stage, POINT, 0.5, 0.5) == LATER
    assert stage.sent("STATUSTEXT")[-1].text == "C7 not in the video yet: look, then tap"
    assert stage.reported(Answer) == []


@pytest.mark.parametrize("number", [POINT, RECTANGLE, STOP, SET_RATE])
def test_who_may_change_nothing_may_not_point_either(stage: LoopbackLink, number: int) -> None:
    assert ask(stage, number, 0.2, 0.2, 0.8, 0.8, sender=(42, 190)) == DENIED
    assert stage.reported(Answer) == []
    assert stage.link.counters.rejected["sender"] == 1


@pytest.mark.parametrize("target", [(0, CAMERA), (1, 0), (2, CAMERA), (1, 100)])
def test_a_tap_for_somebody_else_is_not_taken(stage: LoopbackLink, target: tuple[int, int]) -> None:
    send(stage, POINT, 0.5, 0.5, target=target)
    assert stage.reported(Answer) == []
    assert of_camera(stage, "COMMAND_ACK") == []


@given(st.lists(st.floats(width=32), min_size=4, max_size=4))
def test_any_numbers_are_a_box_in_the_picture_a_point_in_it_or_nothing(sides: list[float]) -> None:
    message = mavlink.MAVLink_command_long_message(1, CAMERA, RECTANGLE, 0, *sides, 0.0, 0.0, 0.0)
    for via in (Via.TRACK_POINT, Via.TRACK_RECTANGLE):
        tapped = read_tap(via, message)
        used = sides[:2] if via is Via.TRACK_POINT else sides
        assert (tapped is None) == any(math.isnan(one) or not 0.0 <= one <= 1.0 for one in used)
        if isinstance(tapped, Box):
            assert tapped.right - tapped.left >= SMALLEST
            assert tapped.bottom - tapped.top >= SMALLEST


def test_what_was_tapped_is_told_at_the_wanted_rate_and_that_it_is_over(stage: LoopbackLink) -> None:
    stage.link.camera.mark(Box(0.4, 0.5, 0.6, 0.7))
    stage.run(2.0)
    assert of_camera(stage, "CAMERA_TRACKING_IMAGE_STATUS") == [], "nobody asked"
    assert ask(stage, SET_RATE, mavlink.MAVLINK_MSG_ID_CAMERA_TRACKING_IMAGE_STATUS, 1000.0) == ACCEPTED
    stage.run(1.8)
    told = of_camera(stage, "CAMERA_TRACKING_IMAGE_STATUS")
    assert 4 <= len(told) <= 5, "twice a second at most"
    assert {(one.tracking_status, one.tracking_mode) for one in told} == {(1, 2)}
    assert (told[0].rec_top_x, told[0].rec_bottom_y) == (pytest.approx(0.4), pytest.approx(0.7))
    stage.link.camera.mark(None)
    stage.run(5.0)
    over = of_camera(stage, "CAMERA_TRACKING_IMAGE_STATUS")[len(told) :]
    assert [one.tracking_status for one in over] == [0, 0, 0], "and then it is quiet"
    ask(stage, SET_RATE, mavlink.MAVLINK_MSG_ID_CAMERA_TRACKING_IMAGE_STATUS, -1.0)
    stage.link.camera.mark(Box(0.4, 0.5, 0.6, 0.7))
    stage.run(2.0)
    assert len(of_camera(stage, "CAMERA_TRACKING_IMAGE_STATUS")) == len(told) + 3
    assert ask(stage, SET_RATE, mavlink.MAVLINK_MSG_ID_CAMERA_TRACKING_IMAGE_STATUS, math.nan) == DENIED


def test_stop_tracking_takes_the_mark_away_and_nothing_else(stage: LoopbackLink) -> None:
    ask(stage, SET_RATE, mavlink.MAVLINK_MSG_ID_CAMERA_TRACKING_IMAGE_STATUS, 500_000.0)
    stage.link.camera.mark(Box(0.4, 0.5, 0.6, 0.7))
    assert ask(stage, STOP) == ACCEPTED
    stage.run(1.0)
    assert of_camera(stage, "CAMERA_TRACKING_IMAGE_STATUS")[-1].tracking_status == 0
    assert stage.reported(Answer) == []


def test_another_camera_under_its_ids_silences_it_and_is_told(stage: LoopbackLink) -> None:
    other = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_CAMERA, 8, 0, 0, 3, 3)
    stage.send(other, (1, CAMERA))
    stage.run(0.2)
    assert stage.sent("STATUSTEXT")[-1].text == "Another camera is 101: set [video] component"
    before = len(of_camera(stage, "HEARTBEAT"))
    send(stage, POINT, 0.5, 0.5)
    stage.run(4.0)
    assert len(of_camera(stage, "HEARTBEAT")) == before
    assert stage.reported(Answer) == []
    stage.run(3.0)
    assert len(of_camera(stage, "HEARTBEAT")) > before, "the other one is gone"
