"""Requests about incident files and recordings reach whoever carries them out, and answer no call."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest

from anytraverse.operations import SetWord
from companion.daemon.requests import FilesRequests
from companion.wire.answers import (
    Acknowledgement,
    Answer,
    AnyOperation,
    CancelIncident,
    PackIncident,
    RecordingWish,
    Via,
    Wish,
)
from companion.wire.ids import Motion, Result

DELETE = RecordingWish(12, Wish.DELETE)


class Desk:
    """Who packs and deletes here, what they were asked for, and what was acknowledged."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, int]] = []
        self.told: list[Acknowledgement] = []
        self.later: list[Callable[[Result, str], None]] = []
        answers = SimpleNamespace(acknowledge=lambda _answer, ack, _now: self.told.append(ack))
        link, vision = SimpleNamespace(answers=answers), SimpleNamespace(words={})
        self.requests = FilesRequests(cast(Any, link), cast(Any, vision))
        self.requests.deleter = cast(Any, self)
        self.requests.packer = cast(Any, SimpleNamespace(ask=self.pack, cancel=self.cancel))

    def pack(self, call: int, _now: float) -> tuple[Result, str]:
        self.asked.append(("pack", call))
        return Result.APPLIED, "it is being packed"

    def cancel(self, call: int, _now: float) -> tuple[Result, str]:
        self.asked.append(("cancel", call))
        return Result.APPLIED, "no more"

    def ask(self, number: int, tell: Callable[[Result, str], None]) -> None:
        self.asked.append(("delete", number))
        self.later.append(tell)

    def receive(self, *operations: AnyOperation, via: Via = Via.PAGE, motion: Motion = Motion.NONE) -> bool:
        return self.requests.receive(Answer(0, motion, operations, 5, via=via), 1.0)


@pytest.mark.parametrize(
    ("operation", "asked"),
    [
        (PackIncident(7), ("pack", 7)),
        (CancelIncident(7), ("cancel", 7)),
        (RecordingWish(12, Wish.PACK), ("pack", -12)),
        (RecordingWish(12, Wish.CANCEL), ("cancel", -12)),
    ],
)
def test_packing_is_asked_for_from_anywhere(operation: AnyOperation, asked: tuple[str, int]) -> None:
    desk = Desk()
    assert desk.receive(operation, via=Via.TUNNEL)
    assert desk.asked == [asked]
    assert [ack.result for ack in desk.told] == [Result.APPLIED]


def test_a_deletion_is_acknowledged_once_it_is_done() -> None:
    desk = Desk()
    assert desk.receive(DELETE)
    assert (desk.asked, desk.told) == ([("delete", 12)], [])
    desk.later[0](Result.REFUSED, "it is being written")
    assert [(ack.transaction, ack.result, ack.text) for ack in desk.told] == [
        (5, Result.REFUSED, "it is being written")
    ]


def test_only_the_page_may_have_a_recording_deleted() -> None:
    desk = Desk()
    assert desk.receive(DELETE, via=Via.TUNNEL)
    assert desk.asked == []
    assert [ack.result for ack in desk.told] == [Result.REFUSED]


@pytest.mark.parametrize(
    ("operations", "motion"),
    [
        ((DELETE,), Motion.GO),
        ((DELETE, DELETE), Motion.NONE),
        ((PackIncident(1), SetWord("a", 1.0)), Motion.NONE),
    ],
)
def test_what_does_not_come_alone_is_refused(operations: tuple[AnyOperation, ...], motion: Motion) -> None:
    desk = Desk()
    assert desk.receive(*operations, motion=motion)
    assert desk.asked == []
    assert [ack.result for ack in desk.told] == [Result.REFUSED]


def test_other_answers_are_for_others() -> None:
    assert not Desk().receive(SetWord("grass", 1.0))
