"""Tells what a recording holds, without reading all of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from companion.observers.recording.contents import read_json
from companion.observers.recording.foxglove import NS
from companion.observers.recording.reading import messages, summary
from companion.observers.recording.topics import TOPICS, Topic
from companion.wire.json_values import whole_of

MOST_TOLD = 200
"""Things that happened which are told of one recording."""
_APART = 10 * NS
"""Between two faults, at least, if both are told."""
_TOLD = frozenset({"call opened", "call closed", "hold started", "would hold"})


class Happened(NamedTuple):
    """A thing that happened. at: ns since 1970. what: a decision, or "fault". id: of call or hold, else 0."""

    at: int
    what: str
    id: int = 0

    @property
    def text(self) -> str:
        """For a person."""
        return f"{self.what} {self.id}" if self.id else self.what


class Listed(NamedTuple):
    """What a recording holds. begin, end: ns since 1970, 0 without a message. frames: pictures.

    finished: whether it has its index. more: whether more happened than `happened` has.
    """

    begin: int
    end: int
    frames: int
    finished: bool
    happened: tuple[Happened, ...]
    more: bool


def listed(path: Path, check: Callable[[], object] = lambda: None) -> Listed:
    """List a recording. check: called at each step; a TimeoutError of it leaves out what happened later.

    Raises OSError.
    """
    found = summary(path, check)
    frames = found.counts.get(TOPICS[Topic.CAMERA].name, 0)
    happened: list[Happened] = []
    more, faulty, fault_at = False, False, -_APART
    decisions = TOPICS[Topic.DECISIONS].name
    try:
        for one in messages(path, {decisions, TOPICS[Topic.STATE].name}, check=check):
            content, at = read_json(one.message.data), one.message.log_time
            if one.channel.topic != decisions:
                before, faulty = faulty, content.get("state") == "fault"
                what, number = "fault" if faulty and not before and at - fault_at >= _APART else "", None
                fault_at = at if faulty else fault_at
            else:
                what, number = str(content.get("decision")), whole_of(content.get("id"), 1, 0xFFFF)
            if what not in {*_TOLD, "fault"}:
                continue
            if len(happened) == MOST_TOLD:
                more = True
                break
            happened.append(Happened(at, what, number or 0))
    except TimeoutError:
        more = True
    return Listed(found.begin, found.end, frames, found.finished, tuple(happened), more)
