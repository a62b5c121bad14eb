"""What is answered on the page is sent until it is acknowledged, and can be taken back."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from anytraverse.operations import ForgetCall, ForgetWord, SetWord, Tap
from companion.observers.page.answering import MOST_WAITING, Answering
from companion.observers.page.calls import shown_calls
from companion.observers.page.messages import PageMessageKind
from companion.observers.page.news import News
from companion.pages.requests import RequestError
from companion.system.datagrams import Datagram
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.ids import PAGE_SENDER, Motion, Result

OPEN = {"id": 7, "kind": "call", "stage": "open", "frame_id": 4711, "age": 3, "holding": True}
TAP = {"tap": "drum", "weight": -1, "box": [0.4, 0.5, 0.6, 0.8], "frame": 4711}


class Desk:
    """An `Answering` whose supervisor is a list, and whose time a test sets."""

    def __init__(self, opened: dict[str, Any] | None = OPEN) -> None:
        self.now = 1000.0
        self.news = News(lambda: self.now)
        self.sent: list[Answer] = []
        self.parts: list[tuple[int, int]] = []
        """Of `sent`: which part each is, of how many."""
        self.answering = Answering(self.news, self.take, lambda: self.now, lambda: 1.8e9 + self.now)
        self.tell(opened)

    def take(self, payload: bytes, at: float) -> None:
        assert at == self.now
        answer, part, parts = Answer.unpack(payload)
        self.sent.append(answer)
        self.parts.append((part, parts))

    def tell(self, opened: dict[str, Any] | None, tapped: tuple[str, ...] = (), **words: float) -> None:
        used = words or {"grass": 1.0}
        state = {"state": "calling", "words": used, "tapped": list(tapped), "open": opened}
        self.news.take(
            Datagram(PageMessageKind.NEWS, {"state": state, "status": {"state": "calling"}, "at": self.now})
        )

    def post(self, **told: Any) -> str:
        return self.answering.answer(json.dumps({"motion": "go", **told}).encode())

    def undo(self, call: int) -> str:
        return self.answering.undo(json.dumps({"call": call}).encode())

    def acknowledge(self, result: Result = Result.APPLIED, text: str = "noted") -> None:
        newest = self.sent[-1]
        bare = Acknowledgement.without_figures(newest.transaction, newest.target, result, text)
        self.answering.acknowledge(replace(bare, roi_uncertainty=0.1, worst_tile=0.2).pack())

    def shown(self, call: int = 7) -> list[tuple[str, str, str]]:
        documents = [one.document() for one in self.answering.by_call()[call].answers]
        return [(one["said"], one["text"], one["tone"]) for one in documents]


def test_an_answer_is_sent_at_once_and_again_each_second_until_it_is_acknowledged() -> None:
    desk = Desk()
    assert desk.post(call=7, changes=[TAP]) == "sent"
    (sent,) = desk.sent
    assert (sent.target, sent.motion) == (7, Motion.GO)
    assert isinstance(sent.operations[0], Tap)
    assert desk.shown() == [("drum: -1, go", "sent", "wait")]
    desk.now += 1.0
    desk.answering.deliver()
    assert desk.sent == [sent, sent]
    desk.acknowledge()
    assert desk.shown() == [("drum: -1, go", "done, now 10% unexplained, worst tile 20%: noted", "good")]
    desk.now += 30.0
    desk.answering.deliver()
    assert len(desk.sent) == 2


def test_an_answer_that_nobody_acknowledges_is_lost_after_a_minute_and_says_so() -> None:
    desk = Desk()
    desk.post(call=7)
    for _ in range(61):
        desk.now += 1.0
        desk.answering.deliver()
    assert desk.shown() == [("go", "LOST: no acknowledgement within 60 s", "bad")]


def test_a_busy_companion_is_asked_again() -> None:
    desk = Desk()
    desk.post(call=7)
    desk.acknowledge(Result.BUSY)
    desk.now += 1.0
    desk.answering.deliver()
    assert len(desk.sent) == 2


def test_an_answer_waits_for_the_one_before_it() -> None:
    desk = Desk()
    desk.post(call=7)
    desk.post(call=7, motion="look")
    assert [one.motion for one in desk.sent] == [Motion.GO]
    desk.acknowledge()
    assert [one.motion for one in desk.sent] == [Motion.GO, Motion.LOOK_AGAIN]


@pytest.mark.parametrize("busy", [False, True])
def test_a_stay_waits_for_no_answer_and_no_go_is_sent_after_it(busy: bool) -> None:
    desk = Desk()
    desk.post(call=7)
    if busy:
        desk.acknowledge(Result.BUSY)
    desk.post(call=7, motion="stay")
    assert [one.motion for one in desk.sent] == [Motion.GO, Motion.STAY]
    for _ in range(61):
        desk.now += 1.0
        desk.answering.deliver()
    assert {one.motion for one in desk.sent[1:]} == {Motion.STAY}
    assert desk.shown()[0] == (
        "go",
        "not acknowledged: the call was closed meanwhile, or stay was said",
        "bad",
    )


def test_a_long_answer_goes_in_parts_and_too_long_a_one_is_refused() -> None:
    desk = Desk()
    words = [{"word": f"a rather long name of a thing {number}", "weight": 1} for number in range(30)]
    desk.post(call=7, changes=words[:6])
    assert desk.parts == [(0, 2), (1, 2)]
    with pytest.raises(RequestError, match="send them in two"):
        desk.post(call=7, changes=words)


def closed(desk: Desk) -> None:
    desk.tell(None)


def older(desk: Desk) -> None:
    desk.tell({**OPEN, "frame_id": 4712})


def silent(desk: Desk) -> None:
    desk.now += 4.0


def too_many(desk: Desk) -> None:
    for _ in range(MOST_WAITING):
        desk.post(call=7)
    desk.sent.clear()


@pytest.mark.parametrize(
    ("happens", "told", "why"),
    [
        (closed, {"call": 7}, "closed already"),
        (older, {"call": 7, "changes": [TAP]}, "older picture"),
        (silent, {"call": 7}, "no news from the companion"),
        (too_many, {"call": 7}, "8 answers wait already"),
        (lambda _: None, {"call": 8}, "closed already"),
        (lambda _: None, {"motion": "none", "changes": [{"word": "mud", "weight": 1}]}, "a call is open"),
        (lambda _: None, {}, "needs the call"),
    ],
)
def test_what_may_not_be_sent_is_refused_with_a_reason(
    happens: Callable[[Desk], None], told: dict[str, Any], why: str
) -> None:
    desk = Desk()
    happens(desk)
    with pytest.raises(RequestError, match=why):
        desk.post(**told)
    assert desk.sent == []


def test_what_an_answer_taught_can_be_taken_back_once_no_call_is_open() -> None:
    desk = Desk()
    desk.post(call=7, changes=[TAP, {"word": "grass", "weight": 0.5}])
    desk.acknowledge()
    with pytest.raises(RequestError, match="answer it first"):
        desk.undo(7)
    desk.tell(None, drum=-1.0, grass=0.5)
    desk.undo(7)
    assert desk.sent[-1].operations == (ForgetCall(7), ForgetWord("drum"), SetWord("grass", 1.0))
    with pytest.raises(RequestError, match="to call 8 is left to undo"):
        desk.undo(8)


def test_words_that_an_answer_made_forgotten_come_back_with_their_weights() -> None:
    desk = Desk()
    desk.tell(OPEN, grass=1.0, rock=-0.5)
    desk.post(call=7, motion="stay", changes=[{"forget": "rock"}, {"word": "mud", "weight": 1}])
    desk.acknowledge()
    desk.tell(OPEN, grass=1.0, mud=1.0)
    desk.post(call=7, changes=[{"forget": "mud"}])
    desk.acknowledge()
    desk.tell(None, grass=1.0)
    desk.undo(7)
    assert desk.sent[-1].operations == (ForgetCall(7), SetWord("rock", -0.5)), "mud is out of use as before"


def test_a_tapped_word_that_an_answer_made_forgotten_stays_so_since_its_examples_are_lost() -> None:
    desk = Desk()
    desk.tell(OPEN, ("gnome",), grass=1.0, gnome=-1.0)
    desk.post(call=7, changes=[{"forget": "gnome"}, {"word": "mud", "weight": 1}])
    desk.acknowledge()
    desk.tell(None, grass=1.0, mud=1.0)
    desk.undo(7)
    assert desk.sent[-1].operations == (ForgetCall(7), ForgetWord("mud"))


def test_of_a_holds_answer_without_a_tap_which_no_scene_remembers_the_words_are_taken_back() -> None:
    desk = Desk({**OPEN, "kind": "hold"})
    desk.post(call=7, motion="go")
    desk.acknowledge()
    assert desk.answering.by_call()[7].document()["undo"] is None
    desk.post(call=7, changes=[{"word": "grass", "weight": 0.5}])
    desk.acknowledge()
    desk.tell(None, grass=0.5)
    desk.undo(7)
    assert desk.sent[-1].operations == (SetWord("grass", 1.0),)


def test_the_scene_of_a_holds_answer_with_a_tap_is_forgotten() -> None:
    desk = Desk({**OPEN, "kind": "hold"})
    desk.post(call=7, changes=[TAP])
    desk.acknowledge()
    desk.tell(None, grass=1.0, drum=-1.0)
    desk.undo(7)
    assert desk.sent[-1].operations == (ForgetCall(7), ForgetWord("drum"))


def test_what_is_being_taken_back_is_not_taken_back_twice_but_again_where_that_failed() -> None:
    desk = Desk()
    desk.post(call=7, changes=[TAP])
    desk.acknowledge()
    desk.tell(None, drum=-1.0)
    desk.undo(7)
    with pytest.raises(RequestError, match="to call 7 is left to undo"):
        desk.undo(7)
    desk.acknowledge(Result.STALE, "C8 was announced just now")
    desk.undo(7)
    desk.acknowledge()
    with pytest.raises(RequestError, match="to call 7 is left to undo"):
        desk.undo(7)


def test_who_waits_for_news_is_woken_by_an_answer() -> None:
    async def wait() -> bool:
        waits = asyncio.create_task(desk.news.more(20.0))
        await asyncio.sleep(0)
        desk.post(call=7)
        return waits in (await asyncio.wait({waits}, timeout=5.0))[0]

    desk = Desk()
    assert asyncio.run(wait())


def test_an_answer_is_shown_once_whatever_its_record_says() -> None:
    desk = Desk()
    desk.post(call=7)
    desk.acknowledge(Result.APPLIED, "noted")
    entry = {"at": 1.8e9, "motion": "go", "operations": [], "text": "before the disk was slow"}
    ours = {**entry, "sender": list(PAGE_SENDER), "transaction": desk.sent[0].transaction}
    others = {**ours, "sender": [255, 190]}
    record = {"id": 7, "answers": [others, ours]}
    (shown,) = shown_calls({"open": OPEN}, 0.0, [record], str, desk.answering.by_call())["calls"]
    assert [one["text"] for one in shown["answers"]] == ["done, now 10% unexplained, worst tile 20%: noted"]
    assert len(shown["said"]) == 1
    (shown,) = shown_calls({"open": OPEN}, 0.0, [record], str, {})["calls"]
    assert len(shown["said"]) == 2, "after the page was started again the record tells of it"


def test_what_became_of_an_answer_to_a_hold_that_is_over_is_still_told() -> None:
    desk = Desk({**OPEN, "id": 9, "kind": "hold"})
    desk.post(call=9)
    desk.acknowledge(Result.STALE, "H9 is over")
    own = desk.answering.by_call()
    assert shown_calls({"open": {**OPEN, "id": 9}}, 0.0, [], str, own)["alone"] == []
    (told,) = shown_calls({}, 0.0, [], str, own)["alone"]
    assert told["text"].endswith("H9 is over")


def test_an_acknowledgement_of_somebody_elses_answer_changes_nothing() -> None:
    desk = Desk()
    desk.post(call=7)
    revision = desk.answering.revision
    unknown = desk.sent[0].transaction % 0xFFFFFFFF + 1
    desk.answering.acknowledge(Acknowledgement.without_figures(unknown, 7, Result.APPLIED, "").pack())
    assert desk.answering.revision == revision
    with pytest.raises(ValueError, match="ends 19 bytes early"):
        desk.answering.acknowledge(b"")
