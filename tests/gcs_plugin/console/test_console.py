"""The console and the companion's link, both real, in virtual time."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from anytraverse.operations import ForgetCall, ForgetWord, SetWord, Tap
from companion.pages.requests import RequestError
from companion.sim.loopback_link import LoopbackLink
from companion.storage.served_tree import Document, Documents, MissingError, ServedFolder, Tree
from companion.wire import ids
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.call_report import CallReport
from companion.wire.payloads import Summary
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.console.console import Console
from gcs_plugin.console.requests import read_request
from gcs_plugin.console.rover_page import RoverPage

JPEG = bytes.fromhex("ffd8ffe000104a46494600010100000100010000ffc0001108006000800301220002110103110100")
PNG = bytes.fromhex("89504e470d0a1a0a0000000d4948445200000001000000010800000000") + bytes(200)
WORDS = {"grass": 1.0}
TEXT = "C7 unknown thing ahead 38%: go/stay/word"
WALL = 1_790_000_000.0
BOX = [0.41, 0.55, 0.6, 0.81]


class Desk:
    """A console, and the link of a companion that has state, records and pictures."""

    def __init__(
        self,
        call: CallReport,
        summary: Summary,
        more: Mapping[str, Document | ServedFolder] | None = None,
        folder: Path | None = None,
        pages: Mapping[int, RoverPage] | None = None,
    ) -> None:
        """more: that it serves. folder, pages: of the console, for incident files."""
        self.files: dict[str, bytes] = {"7.jpg": JPEG + bytes(1400), "7-large.jpg": JPEG + bytes(6000)}
        self.state: dict[str, Any] = {"state": "ok", "words": WORDS, "vocabulary": ["grass", "gravel"]}

        def read(name: str) -> bytes:
            if name not in self.files:
                raise MissingError(name)
            return self.files[name]

        calls = Documents(lambda: {name: len(told) for name, told in self.files.items()}, read)
        state = Document(lambda: json.dumps(self.state).encode())
        self.link = LoopbackLink(tree=Tree({"state.json": state, "calls": calls, **(more or {})}))
        self.call = replace(call, picture="/calls/7.jpg")
        self.summary = replace(summary, words=ids.words_hash(WORDS))
        self.console = Console(OperatorClient(), None, folder, pages)
        self.console.client.ids = 255, 190
        self._heard = 0
        self.hears = True

    def announce(self) -> None:
        self.link.link.set_state(ids.State.CALLING, self.call.id, ids.Policy.HOLD)
        self.link.link.alerts.announce(self.call, TEXT, self.link.now)

    def run(self, seconds: float) -> None:
        client = self.console.client
        for _ in range(round(seconds / 0.05)):
            for message in client.outgoing(self.link.now):
                self.link.send(message)
            if round(self.link.now / 0.05) % 20 == 0:
                client.receive(self._autopilot(), self.link.now)
                self.link.link.summary(self.summary, self.link.now)
            self.link.run(0.05)
            for frame in self.link.frames[self._heard :]:
                if self.hears:
                    client.receive(frame.message, frame.at)
            self._heard = len(self.link.frames)
            self.console.step(self.link.now, WALL + self.link.now)

    @staticmethod
    def _autopilot() -> Any:
        """The heartbeat of an armed ArduPilot rover in AUTO, as the autopilot sends it to the ground."""
        sender, receiver = mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None)
        sent = mavlink.MAVLink_heartbeat_message(10, 3, 0x81, 10, 4, 3).pack(sender)
        return receiver.parse_buffer(sent)[0]

    def until(self, fits: Callable[[], bool], seconds: float = 40.0) -> None:
        deadline = self.link.now + seconds
        while not fits():
            assert self.link.now < deadline, self.rover()
            self.run(0.2)

    def rover(self) -> dict[str, Any]:
        (rover,) = self.console.documents(self.link.now)
        return rover

    def shown(self) -> dict[str, Any]:
        return next(call for call in self.rover()["calls"] if call["id"] == 7)

    def post(self, kind: str, **told: Any) -> str:
        request = read_request(kind, json.dumps({"rover": 1, **told}).encode())
        return self.console.carry_out(*request, self.link.now, WALL + self.link.now)

    def requests(self) -> list[Answer]:
        return self.link.reported(Answer)

    def acknowledge(self, result: ids.Result, stage: ids.Stage, text: str = "") -> None:
        outcome = ids.Outcome.ANSWERED if stage is ids.Stage.CLOSED else ids.Outcome.NONE
        request = self.requests()[-1]
        figures = (0.12, 0.2, ids.Reasons.NONE, 1, text)
        ack = Acknowledgement(request.transaction, request.target, result, stage, outcome, *figures)
        self.link.link.answers.acknowledge(request, ack, self.link.now)


@pytest.fixture
def desk(thing_call: CallReport, quiet_summary: Summary) -> Iterator[Desk]:
    made = Desk(thing_call, quiet_summary)
    made.link.link.set_state(ids.State.OK, 0, ids.Policy.HOLD)
    made.run(5.0)
    yield made
    json.dumps(made.console.documents(made.link.now))


def test_before_a_call_state_words_and_policy_are_known(desk: Desk) -> None:
    desk.until(lambda: bool(desk.rover()["words_known"]))
    rover = desk.rover()
    assert (rover["state"], rover["policy"], rover["up"]) == ("ok", "hold", True)
    assert rover["vehicle"] == {"mode": "AUTO", "armed": True}
    assert rover["words"] == [
        {"word": "grass", "weight": 1.0, "fixed": True},
        {"word": "gravel", "weight": None, "fixed": True},
    ]
    assert rover["calls"] == []


def test_policy_guide_is_offered_where_the_rover_would_give_it(desk: Desk) -> None:
    desk.until(lambda: bool(desk.rover()["words_known"]))
    assert not desk.rover()["offers_guide"], "a companion that does not tell of it has no such policy"


@pytest.mark.parametrize(("refused", "offered"), [("", True), ("GUIDE refused: set [guide] radius", False)])
def test_policy_guide_is_offered_by_what_the_rover_says(desk: Desk, refused: str, offered: bool) -> None:
    desk.state |= {"guide_refused": refused, "model": "told anew"}
    desk.link.link.set_state(ids.State.BLOCKED, 0, ids.Policy.HOLD)
    desk.until(lambda: desk.rover()["model"] == "told anew")
    assert desk.rover()["offers_guide"] is offered
    assert "guide is asked for" in desk.post("policy", policy="guide")


def test_a_rover_in_policy_guide_shows_it_and_that_it_drives_round_something(desk: Desk) -> None:
    desk.link.link.set_state(ids.State.OK, 0, ids.Policy.GUIDE)
    desk.run(2.0)
    rover = desk.rover()
    assert (rover["policy"], rover["offers_guide"], rover["guiding"]) == ("guide", True, False)
    desk.link.link.set_state(ids.State.OK, 0, ids.Policy.GUIDE, guiding=True)
    desk.run(2.0)
    assert desk.rover()["guiding"]


def test_a_call_comes_with_its_picture_its_reason_and_what_to_do(desk: Desk) -> None:
    desk.announce()
    desk.run(0.5)
    desk.until(lambda: "small" in desk.shown()["pictures"])
    call = desk.shown()
    assert call["open"]
    assert call["reason"].startswith("Unknown thing in the middle: ")
    assert call["box"] == pytest.approx(BOX, abs=1e-3)
    assert call["size"] == [128, 96]
    assert "Name it" in call["todo"]
    assert call["stands"] == "The vehicle is held."
    assert desk.console.picture(1, 7, "small") == desk.files["7.jpg"]
    assert desk.console.picture(1, 7, "large") is None, "a slow link gets it only when asked"
    desk.post("fetch", what="large", call=7)
    desk.until(lambda: desk.console.picture(1, 7, "large") == desk.files["7-large.jpg"])


def test_a_picture_is_said_to_be_on_its_way_only_while_it_is(desk: Desk) -> None:
    desk.announce()
    desk.run(0.2)
    assert desk.shown()["small_note"] == "Its picture is on its way."
    desk.until(lambda: "small" in desk.shown()["pictures"])
    assert desk.shown()["small_note"] == ""


def test_a_call_without_a_picture_is_not_said_to_have_one_on_its_way(desk: Desk) -> None:
    desk.call = replace(desk.call, picture="")
    desk.announce()
    desk.run(3.0)
    assert (desk.shown()["pictures"], desk.shown()["small_note"]) == ({}, "")


def test_a_picture_that_is_announced_before_it_is_written_comes_soon(desk: Desk) -> None:
    desk.until(lambda: bool(desk.rover()["words_known"]))
    picture = desk.files.pop("7.jpg")
    desk.announce()
    desk.run(0.5)
    desk.files["7.jpg"] = picture
    desk.until(lambda: "small" in desk.shown()["pictures"], seconds=4.0)


def test_a_tap_with_a_name_leaves_as_one_answer_and_what_becomes_of_it_is_told(desk: Desk) -> None:
    desk.announce()
    desk.run(3.0)
    changes = [{"tap": "drum", "weight": -1, "box": BOX, "frame": 4711}, {"word": "gravel", "weight": 1}]
    assert desk.post("answer", call=7, motion="go", changes=changes) == "sent"
    desk.until(lambda: bool(desk.requests()))
    (request,) = desk.requests()
    assert (request.target, request.motion) == (7, ids.Motion.GO)
    tap, word = request.operations
    assert isinstance(tap, Tap)
    assert (tap.frame_id, tap.word, tap.weight) == (4711, "drum", -1.0)
    assert word == SetWord("gravel", 1.0)
    assert desk.shown()["answers"][0]["tone"] == "wait"
    desk.acknowledge(ids.Result.APPLIED, ids.Stage.ANSWERED, "C7 blocked by drum: waiting")
    desk.until(lambda: bool(desk.shown()["answers"][0]["settled"]))
    answer = desk.shown()["answers"][0]
    assert answer["said"] == "drum: -1, gravel: 1, go"
    assert answer["tone"] == "good"
    assert "blocked by drum" in answer["text"]
    assert desk.shown()["stage"] == "answered"
    assert desk.rover()["names"][:2] == [["gravel", 1.0], ["drum", -1.0]]
    desk.link.link.set_state(ids.State.OK, 0, ids.Policy.HOLD)
    closed = replace(desk.call, stage=ids.Stage.CLOSED, outcome=ids.Outcome.ANSWERED, holding=False)
    desk.link.link.alerts.announce(closed, "C7 closed: answered, thank you", desk.link.now)
    desk.until(lambda: not desk.shown()["open"])
    desk.until(lambda: "The rover drives on (AUTO)." in [one["text"] for one in desk.shown()["said"]])
    assert desk.shown()["first"] == ""


def test_words_that_do_not_cover_the_thing_leave_the_call_open(desk: Desk) -> None:
    desk.announce()
    desk.run(3.0)
    desk.post("answer", call=7, motion="go", changes=[{"word": "gravel", "weight": 1}])
    desk.until(lambda: bool(desk.requests()))
    desk.acknowledge(ids.Result.NOT_COVERED, ids.Stage.OPEN)
    desk.until(lambda: bool(desk.shown()["answers"][0]["settled"]))
    assert desk.shown()["answers"][0]["tone"] == "bad"
    assert "does not cover" in desk.shown()["answers"][0]["text"]
    assert desk.shown()["open"]


@pytest.mark.parametrize(
    ("told", "why"),
    [
        (
            {
                "call": 7,
                "motion": "go",
                "changes": [{"tap": "drum", "weight": -1, "box": BOX, "frame": 4710}],
            },
            "older picture",
        ),
        ({"call": 8, "motion": "go"}, "closed already"),
        ({"rover": 2, "call": 7, "motion": "go"}, "not heard"),
        ({"motion": "none", "changes": [{"word": "gravel", "weight": 1}]}, "a call is open"),
    ],
)
def test_an_answer_that_may_be_meant_for_something_else_is_not_sent(
    desk: Desk, told: dict[str, Any], why: str
) -> None:
    desk.announce()
    desk.run(3.0)
    with pytest.raises(RequestError, match=why):
        desk.post("answer", **told)
    desk.run(1.0)
    assert desk.requests() == []


def test_without_a_call_words_are_set_at_once(desk: Desk) -> None:
    desk.post("answer", call=None, motion="none", changes=[{"word": "gravel", "weight": 0.5}])
    desk.until(lambda: bool(desk.requests()))
    (request,) = desk.requests()
    assert (request.target, request.motion, request.operations) == (
        0,
        ids.Motion.NONE,
        (SetWord("gravel", 0.5),),
    )


def test_undoing_forgets_the_scene_and_puts_the_words_back(desk: Desk) -> None:
    desk.until(lambda: bool(desk.rover()["words_known"]))
    desk.announce()
    desk.run(3.0)
    changes = [
        {"tap": "drum", "weight": -1, "box": BOX, "frame": 4711},
        {"word": "grass", "weight": 0.5},
    ]
    desk.post("answer", call=7, motion="go", changes=changes)
    desk.until(lambda: bool(desk.requests()))
    desk.acknowledge(ids.Result.APPLIED, ids.Stage.CLOSED)
    desk.link.link.set_state(ids.State.OK, 0, ids.Policy.HOLD)
    desk.until(lambda: bool(desk.shown()["undo"]) and not desk.rover()["current"])
    desk.post("undo", call=7)
    desk.until(lambda: len(desk.requests()) == 2)
    undo = desk.requests()[-1]
    assert (undo.target, undo.motion) == (0, ids.Motion.NONE)
    assert undo.operations == (ForgetCall(7), ForgetWord("drum"), SetWord("grass", 1.0))
    assert not desk.shown()["undo"]


def test_of_a_holds_answer_which_no_scene_remembers_the_words_are_taken_back(desk: Desk) -> None:
    desk.until(lambda: bool(desk.rover()["words_known"]))
    desk.call = replace(desk.call, kind=ids.Kind.HOLD)
    desk.announce()
    desk.run(3.0)
    desk.post("answer", call=7, motion="go", changes=[{"forget": "grass"}])
    desk.until(lambda: bool(desk.requests()))
    desk.acknowledge(ids.Result.APPLIED, ids.Stage.CLOSED)
    desk.link.link.set_state(ids.State.OK, 0, ids.Policy.HOLD)
    desk.until(lambda: bool(desk.shown()["undo"]) and not desk.rover()["current"])
    desk.post("undo", call=7)
    desk.until(lambda: len(desk.requests()) == 2)
    assert desk.requests()[-1].operations == (SetWord("grass", 1.0),)


@pytest.mark.parametrize("motion", ["stay", "look"])
def test_what_taught_nothing_cannot_be_undone(desk: Desk, motion: str) -> None:
    desk.announce()
    desk.run(3.0)
    desk.post("answer", call=7, motion=motion)
    desk.until(lambda: bool(desk.requests()))
    desk.acknowledge(ids.Result.APPLIED, ids.Stage.OPEN)
    desk.until(lambda: bool(desk.shown()["answers"][0]["settled"]))
    assert not desk.shown()["undo"]


def test_the_second_of_two_operators_is_told_who_was_first(desk: Desk) -> None:
    given = {
        "at": 1.0,
        "sender": [254, 190],
        "motion": "go",
        "operations": ["gravel: 1"],
        "result": "applied",
        "text": "",
    }
    desk.files["7.json"] = json.dumps({"id": 7, "answers": [given]}).encode()
    desk.announce()
    desk.run(3.0)
    closed = replace(desk.call, stage=ids.Stage.CLOSED, outcome=ids.Outcome.ANSWERED)
    desk.link.link.set_state(ids.State.OK, 0, ids.Policy.HOLD)
    desk.link.link.alerts.announce(closed, "C7 closed: answered, thank you", desk.link.now)
    desk.until(lambda: "254/190" in desk.shown()["first"])
    assert desk.shown()["first"] == "Ground station 254/190 answered first: gravel: 1, go"


def test_a_console_that_starts_late_rebuilds_the_open_call_from_the_state(desk: Desk) -> None:
    desk.announce()
    desk.hears = False
    desk.run(20.0)
    desk.state["open"] = {
        "id": 7,
        "kind": "call",
        "stage": "open",
        "holding": True,
        "age": 20,
        "frame_id": 4711,
        "picture": "/calls/7.jpg",
        "worst_tile_box": BOX,
        "roi_uncertainty": 0.38,
    }
    desk.state["reasons"] = ["unknown_object"]
    heard_from = desk.link.now
    late = Console(OperatorClient())
    late.client.ids = 255, 190
    desk.console, desk.hears = late, True
    desk.until(lambda: bool(late.desks) and any(call["open"] for call in desk.rover()["calls"]), 8.0)
    assert desk.link.now - heard_from < 8.0
    assert desk.shown()["frame"] == 4711
    desk.until(lambda: "small" in desk.shown()["pictures"])


def test_a_rover_that_is_not_heard_is_sent_nothing_and_the_answer_waits(desk: Desk) -> None:
    desk.announce()
    desk.run(3.0)
    desk.hears = False
    desk.run(4.0)
    assert not desk.rover()["up"]
    assert "not heard" in desk.post("answer", call=7, motion="go")
    desk.run(5.0)
    assert desk.requests() == []
    assert "waits" in desk.shown()["answers"][0]["text"]
    desk.hears = True
    desk.until(lambda: bool(desk.requests()))


def test_texts_and_documents_of_a_hostile_rover_are_cleaned_and_bounded(desk: Desk) -> None:
    evil = "<img src=x onerror=alert(1)>\x1b[31m"
    desk.state |= {"words": {evil: 1.0, "a" * 400: 1.0}, "hold_refused": evil * 1000, "model": evil}
    desk.link.link.texts.send(evil, ids.WARNING, desk.link.now)
    desk.link.link.set_state(ids.State.BLOCKED, 0, ids.Policy.HOLD)
    desk.until(lambda: bool(desk.rover()["model"]))
    assert evil.replace("\x1b", " ") in desk.rover()["texts"][-1]["text"]
    shown = json.dumps(desk.rover())
    assert "\\u001b" not in shown
    assert len(shown) < 20_000


def test_calls_before_the_console_began_are_fetched_when_asked_for(desk: Desk) -> None:
    for number in (65535, 2, 3):
        answers = [{"at": 10.0 * (number % 65535), "operations": [f"tap rock{number}: -1 0.1 0.2 0.3 0.4"]}]
        told = {"id": number, "reasons": ["unknown_object"], "outcome": "answered", "answers": answers}
        desk.files[f"{number}.json"] = json.dumps(told | {"picture": f"/calls/{number}.jpg"}).encode()
        desk.files[f"{number}.jpg"] = JPEG + bytes(700)
    desk.files["x.txt"] = b""
    assert desk.rover()["earlier"] == "unknown"
    desk.post("fetch", what="calls")
    desk.until(
        lambda: [call["id"] for call in desk.rover()["calls"] if call["pictures"]] == [3, 2, 65535], 90.0
    )
    newest = desk.rover()["calls"][0]
    assert (newest["outcome"], newest["open"]) == ("answered", False)
    assert newest["given"] == ["rock3: -1"]
    assert ["rock3", -1.0] in desk.rover()["names"]
    assert desk.rover()["earlier"] == "known"


def test_the_ground_from_above_is_fetched_when_asked_for_and_again(
    thing_call: CallReport, quiet_summary: Summary
) -> None:
    served = {"from_above.png": PNG}
    maps = Documents(lambda: {name: len(told) for name, told in served.items()}, served.__getitem__)
    desk = Desk(thing_call, quiet_summary, {"maps": maps})
    desk.until(lambda: bool(desk.console.desks))
    assert desk.rover()["ground"] == {"picture": "", "coming": False, "problem": ""}
    assert desk.console.ground(1) is None
    desk.post("fetch", what="ground")
    assert desk.rover()["ground"]["coming"]
    desk.until(lambda: not desk.rover()["ground"]["coming"])
    first = desk.rover()["ground"]["picture"]
    assert (desk.console.ground(1), first) == (PNG, "/pictures/1/ground.png?1")
    for rubbish in (b"<html>", b"", PNG[:9]):
        served["from_above.png"] = rubbish
        desk.post("fetch", what="ground")
        desk.until(lambda: not desk.rover()["ground"]["coming"])
        assert desk.console.ground(1) == PNG, "rubbish replaces nothing"
        assert desk.rover()["ground"]["problem"]
    served["from_above.png"] = PNG + b"1"
    desk.post("fetch", what="ground")
    desk.until(lambda: desk.console.ground(1) == PNG + b"1")
    assert desk.rover()["ground"]["picture"] != first


def test_where_the_ground_is_not_known_the_console_says_so(desk: Desk) -> None:
    desk.until(lambda: bool(desk.console.desks))
    desk.post("fetch", what="ground")
    desk.until(lambda: bool(desk.rover()["ground"]["problem"]), 60.0)
    assert not desk.rover()["ground"]["picture"]


@pytest.mark.slow
def test_what_the_state_does_not_tell_is_asked_for_ever_more_rarely(desk: Desk) -> None:
    asked = 0
    desk.summary = replace(desk.summary, words=1)  # words that /state.json does not have
    fetch = desk.console.client.fetch

    def counted(system: int, path: str, now: float) -> Any:
        nonlocal asked
        asked += path == "/state.json"
        return fetch(system, path, now)

    desk.console.client.fetch = counted  # type: ignore[assignment,method-assign]
    desk.run(300.0)
    assert 4 <= asked <= 9


def test_a_record_with_any_operations_gives_only_names_that_are_words(desk: Desk) -> None:
    hostile = [
        "rock: -.....",
        "a: 1.2.3",
        "log: -1",
        "<b>: 1",
        "x" * 300 + ": 1",
        "y: 9",
        ":",
        "tap d: -1 0 0 1 1",
    ]
    answers = [{"at": 1.0, "operations": hostile}]
    desk.files["3.json"] = json.dumps({"id": 3, "outcome": "answered", "answers": answers}).encode()
    desk.post("fetch", what="calls")
    desk.until(lambda: [call["id"] for call in desk.rover()["calls"]] == [3])
    assert dict(desk.rover()["names"]) == {"log": -1.0, "<b>": 1.0, "d": -1.0}


def test_what_was_answered_in_a_similar_scene_is_told_with_its_picture(desk: Desk) -> None:
    nearest = {"call": 3, "similarity": 0.91, "words": {"drum": -1, "gravel": 0.5}, "picture": "/calls/3.jpg"}
    pictures = {"picture": "/calls/7.jpg", "raw": "/calls/7-raw.jpg"}
    desk.files["7.json"] = json.dumps({"id": 7, "nearest": nearest, **pictures}).encode()
    desk.files["3.jpg"], desk.files["7-raw.jpg"] = JPEG + bytes(900), JPEG + bytes(3000)
    desk.announce()
    desk.run(0.5)
    desk.until(lambda: bool((desk.shown()["nearest"] or {}).get("picture")))
    told = desk.shown()["nearest"]
    assert told["text"] == "Most like call C3 (0.91): the answer was drum -1, gravel 0.5."
    assert told["words"] == [["drum", -1.0], ["gravel", 0.5]]
    assert desk.console.picture(1, 7, "nearest") == desk.files["3.jpg"]
    assert "raw" not in desk.shown()["pictures"]
    desk.until(lambda: "raw" in desk.shown()["pictures"])
    desk.run(10.0)
    assert "large" not in desk.shown()["pictures"], "a radio gets the judgement only when asked"


def test_an_answer_of_this_console_in_a_similar_scene_is_told_as_such(desk: Desk) -> None:
    desk.announce()
    desk.run(3.0)
    desk.post("answer", call=7, motion="go", changes=[])
    desk.until(lambda: bool(desk.requests()))
    desk.acknowledge(ids.Result.APPLIED, ids.Stage.CLOSED)
    desk.until(lambda: bool(desk.shown()["answers"][0]["settled"]))
    nearest = {"call": 7, "similarity": 0.6, "words": {}, "picture": "/calls/7.jpg"}
    desk.files["8.json"] = json.dumps({"id": 8, "nearest": nearest, "picture": "/calls/8.jpg"}).encode()
    desk.files["8.jpg"] = JPEG + bytes(800)
    desk.state["settings"] = {"AT_THR_SCENE": 0.8}
    desk.call = replace(desk.call, id=8, frame_id=4800, picture="/calls/8.jpg")
    desk.announce()

    def told() -> dict[str, Any]:
        return next((one["nearest"] or {} for one in desk.rover()["calls"] if one["id"] == 8), {})

    desk.until(lambda: bool(told().get("picture")))
    far = "Not much like any place that was answered; nearest is call C7 (0.60): you said go."
    desk.until(lambda: told()["text"] == far)
    assert told()["picture"].startswith("/pictures/1/7/small.jpg"), "it is here already"


def test_on_a_quick_link_the_frame_without_marks_comes_before_the_judgement(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gcs_plugin.console.fetched.QUICK_FOR_LARGE", 500.0)
    told = {"id": 7, "picture": "/calls/7.jpg", "raw": "/calls/7-raw.jpg"}
    desk.files |= {"7.json": json.dumps(told).encode(), "7-raw.jpg": JPEG + bytes(3000)}
    desk.announce()
    desk.run(0.5)
    desk.until(lambda: "raw" in desk.shown()["pictures"])
    assert "large" not in desk.shown()["pictures"]
    desk.until(lambda: "large" in desk.shown()["pictures"])


def test_a_call_shows_the_number_that_is_needed_and_does_not_repeat_it_below(desk: Desk) -> None:
    desk.call = replace(desk.call, reasons=ids.Reasons.UNKNOWN_SCENE, drivable_share=None)
    text = "C7 new place, .91 like C3, .94 needed: go/word"
    desk.link.link.set_state(ids.State.CALLING, 7, ids.Policy.HOLD)
    desk.link.link.alerts.announce(desk.call, text, desk.link.now)
    desk.run(3.0)
    assert desk.shown()["reason"] == "New place: 0.91 like C3, known from 0.94 on."
    assert desk.shown()["figures"] == ""
    assert desk.shown()["said"] == []
    assert desk.rover()["texts"][-1]["text"] == text


def test_whoever_is_alerted_hears_of_each_call_once(desk: Desk) -> None:
    told: list[tuple[str, str]] = []
    desk.console._alert = lambda title, text: told.append((title, text))
    desk.announce()
    desk.run(3.0)
    ((title, text),) = told
    assert title == "Rover 1 calls: C7"
    assert text.startswith("C7 unknown")
