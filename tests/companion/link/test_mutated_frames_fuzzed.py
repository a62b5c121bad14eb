"""Whole frames, wrong in any other way: a tenth of what `python -m bench.link fuzz` puts in."""

from __future__ import annotations

from typing import Any

import pytest

from anytraverse.operations import ForgetWord, SetWord
from bench.link.fuzz import Broken, Fuzz, well_formed
from companion.link.inbound import ParameterRequest
from companion.link.link import Link
from companion.link.parser import Parser
from companion.wire.answers import Answer, Via
from companion.wire.ids import Motion

FRAMES = 100_000
REQUESTS = {"ParameterRequest", "PolicyRequest", "ResetRequest"} | {
    via.value for via in Via if via is not Via.PAGE
}
REPLIES = {"HEARTBEAT", "COMMAND_ACK", "PARAM_VALUE", "PARAM_EXT_ACK", "TUNNEL", "FILE_TRANSFER_PROTOCOL"}


def test_mutated_frames_let_nothing_escape_and_nobody_in() -> None:
    told = Fuzz(1).run(FRAMES)
    assert told.bad == 0
    assert set(told.requests) == REQUESTS
    assert set(told.sent) >= REPLIES
    assert {"sender", "target", "range", "payload", "command", "version"} <= set(told.rejected)


def test_a_link_that_believed_a_stranger_would_be_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.link.access_control.AccessControl.may_change", lambda *_: True)
    with pytest.raises(Broken, match="not from one that may"):
        Fuzz(1).run(5000)


def test_a_link_that_kept_what_it_heard_would_be_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    feed, kept = Parser.feed, list[Any]()

    def keep(parser: Parser, data: bytes, now: float, *, whole: bool) -> list[Any]:
        messages = feed(parser, data, now, whole=whole)
        kept.extend(messages)
        return messages

    monkeypatch.setattr(Parser, "feed", keep)
    with pytest.raises(Broken, match="memory"):
        Fuzz(1).run(5000)


def test_a_link_that_fell_silent_would_be_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    tick = Link.tick
    monkeypatch.setattr(Link, "tick", lambda link, now: None if now > 5.0 else tick(link, now))
    with pytest.raises(Broken, match="heartbeat"):
        Fuzz(1).run(20_000)


def test_what_the_daemon_could_not_believe_is_known() -> None:
    def answer(weight: float, target: int = 1) -> Answer:
        return Answer(target, Motion.GO, (SetWord("drum", weight),), sender=(255, 190), via=Via.COMMAND)

    assert well_formed(answer(0.5), set())
    assert not well_formed(answer(1.5), set())
    assert not well_formed(answer(0.5, 70_000), set())
    assert not well_formed(ParameterRequest((255, 190), "AT_X", 1.0), {"AT_Y"})
    assert not well_formed(
        Answer(0, Motion.NONE, (ForgetWord("a"),) * 17, sender=(255, 190), via=Via.TEXT), set()
    )
    assert not well_formed(Answer(0, Motion.GO, sender=(255, 190), via=Via.TUNNEL), set())
