"""What is recorded fits what happened, and nothing is made for nobody."""

from __future__ import annotations

import json
import logging
import math
from typing import Any, cast

import pytest

from anytraverse.frame import Pose
from companion.daemon.turn import Turn
from companion.guide.plan import Plan
from companion.observers.recording import contents
from companion.observers.recording.messages import RecordedMessage
from companion.observers.recording.topics import Topic
from companion.vision import pictures
from companion.vision.client import VisionResult
from companion.vision.messages import Encode, Encoded, Planned
from companion.wire.ids import Motion
from tests.companion.daemon.rig import MakeRig, Rig

NS = 1_000_000_000


def recorded(rig: Rig) -> list[RecordedMessage]:
    """What was recorded since the last call."""
    return rig.daemon.recording.take()


def of(messages: list[RecordedMessage], topic: Topic) -> list[dict[str, Any]]:
    """The contents of a topic."""
    return [json.loads(one.data) for one in messages if one.topic is topic]


def encodings(rig: Rig) -> list[int]:
    return [request.frame_id for request in rig.child.requests if isinstance(request, Encode)]


def on(rig: Rig) -> Rig:
    rig.daemon.recording.listeners = (1,)
    return rig


def test_nothing_is_made_for_nobody(rig: Rig) -> None:
    with rig.daemon.recording.log_lines():
        rig.see(2.0, "drum")
        logging.getLogger("x").warning("a line")
        rig.see(0.1)
    assert recorded(rig) == []
    assert encodings(rig) == []


def test_each_frame_has_its_assessment_and_one_a_second_its_picture(rig: Rig) -> None:
    before = rig.frame_id
    on(rig).see(5.0)
    found = recorded(rig)
    judged = of(found, Topic.ASSESSMENT)
    assert [one["frame"] for one in judged] == list(range(before + 1, before + 51))
    assert all(one["ok"] and one["reasons"] == [] for one in judged)
    assert judged[-1]["judged_at"] - judged[-1]["captured_at"] < 0.2
    times = {one.sequence: one.at for one in found if one.topic is Topic.ASSESSMENT}
    pictures = [one for one in found if one.topic is Topic.CAMERA]
    assert 5 <= len(pictures) <= 7
    for one in pictures:
        assert one.data.count(b"\xff\xd8\xff") == 1
        assert 0 <= times[one.sequence] - one.at < 0.2 * NS
    for topic in (Topic.TRAVERSABILITY, Topic.UNCERTAINTY, Topic.ANNOTATIONS):
        same = [(one.sequence, one.at) for one in found if one.topic is topic]
        assert same == [(one.sequence, one.at) for one in pictures]
    assert rig.daemon.recording.left_out == 0


def test_a_call_is_recorded_with_its_frame_its_answer_and_the_acknowledgement(rig: Rig) -> None:
    on(rig).see(1.0)
    recorded(rig)
    rig.see(1.0, "drum")
    assert rig.calls.call is not None
    number, frame = rig.calls.call.id, rig.calls.call.frame_id
    rig.word(number, "drum", -1.0, Motion.STAY)
    rig.see(2.0, "drum")
    found = recorded(rig)
    kinds = [one["decision"] for one in of(found, Topic.DECISIONS)]
    assert {"call opened", "hold started"} <= set(kinds)
    (opened,) = [one for one in of(found, Topic.DECISIONS) if one["decision"] == "call opened"]
    assert (opened["id"], opened["frame"], opened["reasons"]) == (number, frame, ["unknown_object"])
    pictured = [one.sequence for one in found if one.topic is Topic.CAMERA]
    assert pictured.count(frame) == 1, "whatever the rate"
    (asked,) = of(found, Topic.REQUESTS)
    assert (asked["request"], asked["target"], asked["motion"]) == ("Answer", number, "stay")
    assert asked["operations"] == [{"word": "drum", "weight": -1.0}]
    (told,) = of(found, Topic.ACKNOWLEDGEMENTS)
    assert (told["target"], told["result"]) == (number, rig.acks[-1].result.name.lower())
    assert set(told["reasons"]) <= {"unknown_object", "blocked"}
    assert of(found, Topic.WORDS)[-1]["words"]["drum"] == -1.0
    assert {one.topic for one in found if one.event} == {Topic.DECISIONS, Topic.ACKNOWLEDGEMENTS}


def test_the_way_that_was_planned_is_recorded(rig: Rig) -> None:
    on(rig).see(0.5)
    recorded(rig)
    plan = Plan(
        rig.clock.now, Pose(1.0, 2.0, 90.0), math.inf, arcs=((0.5, 1.2), (-0.2, 3.0)), clear=4.2, gap=0.4
    )
    event = VisionResult(Planned(plan), rig.vision.memory)
    rig.daemon.recording.happened(event, cast(Turn, None))
    (told,) = of(recorded(rig), Topic.PLAN)
    assert (told["pose"], told["arcs"]) == ([1.0, 2.0, 90.0], [[0.5, 1.2], [-0.2, 3.0]])
    assert (told["route_clear"], told["route_blocked"], told["clear"], told["gap"]) == (None, False, 4.2, 0.4)


def test_what_holds_is_told_at_the_beginning_and_when_it_changes(rig: Rig) -> None:
    on(rig).see(2.0)
    found = recorded(rig)
    for topic in (Topic.SETUP, Topic.WORDS, Topic.SETTINGS, Topic.STATE):
        assert len(of(found, topic)) == 1, topic
    (setup,) = of(found, Topic.SETUP)
    assert setup["model"] == "painted-1"
    assert "[recording]" in setup["config"]
    (settings,) = of(found, Topic.SETTINGS)
    assert settings["parameters"]["AT_ROI_T"] == 0.6
    assert settings["judging"]["thresholds"]["scene"] == settings["parameters"]["AT_THR_SCENE"]
    rig.set("AT_THR_ROI", 0.5)
    rig.set("AT_W_ROCK", 0.25)
    rig.see(1.0)
    found = recorded(rig)
    (settings,) = of(found, Topic.SETTINGS)
    assert settings["judging"]["thresholds"]["roi"] == settings["parameters"]["AT_THR_ROI"] == 0.5
    (words,) = of(found, Topic.WORDS)
    assert words["words"]["rock"] == 0.25
    assert [one["name"] for one in of(found, Topic.REQUESTS)] == ["AT_THR_ROI", "AT_W_ROCK"]
    rig.daemon.recording.listeners = (0,)  # the process died
    rig.see(0.1)
    on(rig).see(1.0)
    assert len(of(recorded(rig), Topic.SETUP)) == 1, "a new process is told again"


def test_a_process_that_is_started_again_beside_another_one_is_told_what_holds(rig: Rig) -> None:
    for listeners in ((1, 1), (0, 1), (2, 1)):
        rig.daemon.recording.listeners = listeners
        rig.see(1.0)
    found = recorded(rig)
    for topic in (Topic.SETUP, Topic.WORDS, Topic.SETTINGS, Topic.STATE):
        assert len(of(found, topic)) >= 2, topic
    rig.see(1.0)
    assert of(recorded(rig), Topic.SETUP) == [], "not again without a new one"


def test_a_fault_is_an_event_and_vehicle_log_and_status_are_there(make_rig: MakeRig) -> None:
    rig = on(make_rig())
    with rig.daemon.recording.log_lines():
        rig.see(1.0)
        rig.daemon.write_status(web={})
        logging.getLogger("a.name").warning("a %s", "line")
        rig.see(0.2)
    found = recorded(rig)
    assert of(found, Topic.STATUS)[0]["state"] == "ok"
    assert any(b"a line" in one.data and b"a.name" in one.data for one in found if one.topic is Topic.LOG)
    assert of(found, Topic.VEHICLE)[-1]["armed"] in (True, False)
    assert not any(one.event for one in found)
    rig.wait(3.0)
    found = recorded(rig)
    assert [one["state"] for one in of(found, Topic.STATE)][-1] == "fault"
    assert any(one.event for one in found if one.topic is Topic.STATE)


def test_a_frame_that_was_left_out_is_counted_and_the_next_one_is_asked_for(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    def left_out(request: Encode, _: object) -> Encoded:
        return Encoded(request.number, request.frame_id)

    with monkeypatch.context() as busy:
        busy.setattr(pictures, "encoded", left_out)
        on(rig).see(0.3)
    assert rig.daemon.recording.left_out >= 2
    asked = encodings(rig)
    rig.see(0.2)
    assert len(encodings(rig)) == len(asked) + 1
    assert [one.sequence for one in recorded(rig) if one.topic is Topic.CAMERA]


def test_what_waits_for_the_end_of_a_turn_is_bounded(rig: Rig) -> None:
    on(rig)
    for number in range(1000):
        rig.daemon.recording.status({"number": number}, rig.clock.now)
    assert [one["number"] for one in of(recorded(rig), Topic.STATUS)] == list(range(500, 1000))


def test_an_error_in_what_is_recorded_costs_that_and_nothing_else(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError

    for name in ("plain", "assessment", "decision", "words", "image"):
        monkeypatch.setattr(contents, name, broken)
    on(rig).see(1.0, "drum")
    rig.daemon.write_status()
    assert rig.calls.call is not None
    rig.word(rig.calls.call.id, "drum", -1.0, Motion.GO)
    rig.see(1.0, "drum")
    assert rig.acks[-1].result.name == "APPLIED"
    assert "recording failed" in caplog.text
    assert len([one for one in caplog.records if "recording failed" in one.getMessage()]) == 1
    monkeypatch.undo()
