"""Both ends of the wire in virtual time: the companion's link and the operator's client."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from anytraverse.operations import Operation, SetWord
from companion.sim.loopback_link import LoopbackLink
from companion.wire import ids
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.call_report import CallReport
from companion.wire.delivery import DeliveryStatus
from companion.wire.payloads import Summary
from gcs_plugin.client import events as ev
from gcs_plugin.client.client import OperatorClient


class Both:
    """A rehearsed link whose every frame the client hears, and the other way round."""

    def __init__(self, sender: tuple[int, int] = (255, 190)) -> None:
        self.link = LoopbackLink()
        self.client = OperatorClient()
        self.told: list[ev.Event] = []
        self._sender = sender
        self._heard = 0

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            for message in self.client.outgoing(self.link.now):
                self.link.send(message, self._sender)
            self.link.run(0.05)
            for frame in self.link.frames[self._heard :]:
                self.client.receive(frame.message, frame.at)
            self._heard = len(self.link.frames)
            self.told += self.client.events()

    def of(self, kind: type[Any]) -> list[Any]:
        return [event for event in self.told if isinstance(event, kind)]

    def requests(self) -> list[Answer]:
        return self.link.reported(Answer)


@pytest.fixture
def both(thing_call: CallReport, quiet_summary: Summary) -> Callable[..., Both]:
    def made(sender: tuple[int, int] = (255, 190)) -> Both:
        pair = Both(sender)
        pair.link.link.set_state(ids.State.CALLING, thing_call.id, ids.Policy.HOLD)
        pair.link.link.summary(quiet_summary, 0.0)
        pair.link.link.alerts.announce(thing_call, "C7 unknown thing ahead 38%: go/stay/word", 0.0)
        pair.run(3.0)
        return pair

    return made


def acknowledgement(request: Answer, result: ids.Result = ids.Result.APPLIED) -> Acknowledgement:
    return Acknowledgement(
        request.transaction, request.target, result, ids.Stage.CLOSED, ids.Outcome.ANSWERED,
        0.1, 0.2, ids.Reasons.NONE, 1, "C7 closed: answered, thank you",
    )  # fmt: skip


def test_what_the_link_announces_the_client_knows(both: Callable[..., Both], thing_call: CallReport) -> None:
    pair = both()
    assert [event.call for event in pair.of(ev.CallAnnounced)] == [thing_call]
    assert [event.text for event in pair.of(ev.TextReceived)][:1] == [
        "C7 unknown thing ahead 38%: go/stay/word"
    ]
    assert pair.of(ev.NotUnderstood) == []
    rover = pair.client.rovers[1]
    assert (rover.state, rover.current_id, rover.counters.summaries_lost) == (ids.State.CALLING, 7, 0)
    pair.client.request_parameters(1)
    pair.run(3.0)
    assert rover.words() == {"grass": 1.0}


FIGURES = "unknown 71% in yellow frame, over 25% calls"


def test_why_a_call_is_open_is_known_from_its_text(both: Callable[..., Both], thing_call: CallReport) -> None:
    pair = both()
    pair.link.link.alerts.announce(replace(thing_call, id=8, frame_id=5000), f"C8 {FIGURES}", pair.link.now)
    pair.run(3.0)
    rover = pair.client.rovers[1]
    assert (rover.calls[7].data.why, rover.calls[8].data.why) == ("", FIGURES)
    assert pair.of(ev.CallAnnounced)[-1].call.why == FIGURES
    again = "C8 stays open: new place, .62, .85 needed"
    pair.link.link.alerts.announce(replace(thing_call, id=8, frame_id=5000), again, pair.link.now)
    pair.run(16.0)
    assert rover.calls[8].data.why == "new place, .62, .85 needed"


def test_an_answer_in_parts_arrives_whole_and_its_acknowledgement_comes_back(
    both: Callable[..., Both],
) -> None:
    pair = both()
    words: tuple[Operation, ...] = tuple(SetWord(f"a word of some length, {n}", 0.5) for n in range(12))
    pending = pair.client.answer(1, Answer(7, ids.Motion.GO, words), pair.link.now)
    pair.run(6.0)
    (request,) = pair.requests()
    assert (request.target, request.motion, request.operations) == (7, ids.Motion.GO, words)
    pair.link.link.answers.acknowledge(request, acknowledgement(request), pair.link.now)
    pair.run(1.0)
    assert pending.status is DeliveryStatus.ACKNOWLEDGED
    assert [event.call.outcome for event in pair.of(ev.CallEnded)] == [ids.Outcome.ANSWERED]


def test_a_busy_companion_gets_the_answer_again_and_applies_it_once(both: Callable[..., Both]) -> None:
    pair = both()
    pair.client.answer(1, Answer(7, ids.Motion.GO, ()), pair.link.now)
    pair.run(0.5)
    (request,) = pair.requests()
    pair.link.link.answers.acknowledge(request, acknowledgement(request, ids.Result.BUSY), pair.link.now)
    pair.run(3.0)
    again = pair.requests()[1:]
    assert [one.transaction for one in again] == [request.transaction]
    pair.link.link.answers.acknowledge(again[0], acknowledgement(again[0]), pair.link.now)
    pair.run(10.0)
    assert len(pair.requests()) == 2
    assert [event.acknowledgement.result for event in pair.of(ev.Acknowledged)] == [
        ids.Result.BUSY,
        ids.Result.APPLIED,
    ]


def test_a_ground_station_that_may_not_answer_is_told_and_the_call_stays_open(
    both: Callable[..., Both],
) -> None:
    pair = both((42, 190))
    pair.client.answer(1, Answer(7, ids.Motion.GO, ()), pair.link.now)
    pair.run(3.0)
    assert pair.requests() == []
    assert [event.acknowledgement.result for event in pair.of(ev.Acknowledged)] == [ids.Result.DENIED]
    assert len(pair.client.rovers[1].open_calls()) == 1
