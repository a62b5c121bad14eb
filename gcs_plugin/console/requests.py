"""Reads what the page posts. Each value is checked; a RequestError says what is wrong. Pure."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from anytraverse.errors import PreferencesError
from anytraverse.preferences import check_weight, clean_word
from companion.wire.ids import Motion, Policy
from companion.wire.packing import Fractions
from gcs_plugin.terminal.commands import Change, Elsewhere, Episode, Forget, ForgetAnswer, Reply, Tap, Word

MOST_CHANGES = 32
FILES = ("large", "check", "calls")
_MOTIONS = {
    "none": Motion.NONE,
    "go": Motion.GO,
    "stay": Motion.STAY,
    "look": Motion.LOOK_AGAIN,
}


class RequestError(ValueError):
    """Reports a request that cannot be carried out; its text is for a person."""


@dataclass(frozen=True)
class AnswerRequest:
    """An answer. frame: id of the frame in which was tapped, None without a tap."""

    rover: int
    reply: Reply
    frame: int | None


@dataclass(frozen=True)
class PolicyRequest:
    """A policy that the rover shall have."""

    rover: int
    policy: Policy


@dataclass(frozen=True)
class UndoRequest:
    """Takes back what this console answered to a call."""

    rover: int
    call: int


@dataclass(frozen=True)
class FileRequest:
    """Asks for a file that a slow radio does not get by itself. what: one of `FILES`. call: 0 for none."""

    rover: int
    what: str
    call: int


Request = AnswerRequest | PolicyRequest | UndoRequest | FileRequest


def read_request(kind: str, body: bytes) -> Request:
    """Read the body of a POST to /`kind`. Raises RequestError."""
    try:
        told = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise RequestError("the request is not JSON") from error
    if not isinstance(told, dict):
        raise RequestError("the request is not an object")
    rover = _whole(told, "rover", 1, 255)
    if kind == "answer":
        return _answer(rover, told)
    if kind == "policy":
        return PolicyRequest(rover, _policy(told.get("policy")))
    if kind == "undo":
        return UndoRequest(rover, _whole(told, "call", 1, 0xFFFF))
    if kind == "fetch":
        what = told.get("what")
        if what not in FILES:
            raise RequestError(f"what is one of {', '.join(FILES)}")
        return FileRequest(rover, what, _whole(told, "call", 1, 0xFFFF) if what == "large" else 0)
    raise RequestError("there is no such request")


def _answer(rover: int, told: Mapping[str, Any]) -> AnswerRequest:
    motion = _MOTIONS.get(told["motion"]) if isinstance(told.get("motion"), str) else None
    if motion is None:
        raise RequestError(f"motion is one of {', '.join(_MOTIONS)}")
    raw = told.get("changes", [])
    if not isinstance(raw, list) or len(raw) > MOST_CHANGES:
        raise RequestError(f"changes is a list of {MOST_CHANGES} at most")
    changes = tuple(map(_change, raw))
    words = [change.word for change in changes if isinstance(change, Word | Tap | Forget)]
    twice = next((word for word in words if words.count(word) > 1), None)
    if twice is not None:
        raise RequestError(f'"{twice}" stands twice: keep one')
    taps = [one for one in raw if "tap" in one]
    if len(taps) > 1:
        raise RequestError("one tap in an answer")
    call = None if told.get("call") is None else _whole(told, "call", 1, 0xFFFF)
    if call is None and (motion is not Motion.NONE or taps):
        raise RequestError("an answer needs the call that it is for")
    if motion is Motion.NONE and not changes:
        raise RequestError("an answer without words needs a motion")
    frame = _whole(taps[0], "frame", 0, 0xFFFFFFFF) if taps else None
    return AnswerRequest(rover, Reply(motion, changes, call, rover), frame)


def _change(told: Any) -> Change:
    if not isinstance(told, dict):
        raise RequestError("a change is an object")
    kinds: dict[str, Callable[[Mapping[str, Any]], Change]] = {
        "tap": lambda one: Tap(_word(one["tap"]), _weight(one), _box(one.get("box"))),
        "word": lambda one: Word(_word(one["word"]), _weight(one)),
        "forget": lambda one: Forget(_word(one["forget"])),
        "forget_call": lambda one: ForgetAnswer(_whole(one, "forget_call", 1, 0xFFFF)),
        "new_episode": lambda _: Episode(),
        "other_place": lambda one: Elsewhere(_whole(one, "other_place", 0, 0xFFFF)),
    }
    named = [name for name in kinds if name in told]
    if len(named) != 1:
        raise RequestError(f"a change has one of {', '.join(kinds)}")
    return kinds[named[0]](told)


def _whole(told: Mapping[str, Any], name: str, low: int, high: int) -> int:
    value = told.get(name)
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise RequestError(f"{name} is a whole number of {low} to {high}")
    return value


def _word(raw: Any) -> str:
    if not isinstance(raw, str):
        raise RequestError("a word is text")
    try:
        return clean_word(raw)
    except PreferencesError as error:
        raise RequestError(str(error)) from error


def _weight(told: Mapping[str, Any]) -> float:
    raw = told.get("weight")
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        raise RequestError("a weight is a number of -1 to 1")
    try:
        return check_weight("it", raw)
    except (PreferencesError, OverflowError) as error:
        raise RequestError("a weight is a number of -1 to 1") from error


def _box(raw: Any) -> Fractions | None:
    if raw is None:
        return None
    if not isinstance(raw, list) or len(raw) != 4 or not all(_is_fraction(side) for side in raw):
        raise RequestError("a box is left, top, right, bottom in fractions of the picture")
    left, top, right, bottom = (round(float(side), 4) for side in raw)
    if not (left < right and top < bottom):
        raise RequestError("a box has its left before its right, and its top above its bottom")
    return left, top, right, bottom


def _is_fraction(side: Any) -> bool:
    return not isinstance(side, bool) and isinstance(side, int | float) and 0 <= side <= 1


def _policy(raw: Any) -> Policy:
    try:
        return Policy[str(raw).upper()]
    except KeyError as error:
        raise RequestError("policy is one of report, shadow, hold, off") from error
