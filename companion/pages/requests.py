"""Reads an answer that a page posts. Each value is checked; a RequestError says what is wrong. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from anytraverse.errors import PreferencesError
from anytraverse.operations import ForgetCall, ForgetWord, NewEpisode, OtherPlace, SetWord, Tap, taps_of
from anytraverse.preferences import check_weight, clean_word
from companion.wire import json_values
from companion.wire.answers import Answer, AnyOperation, CancelIncident, Wish
from companion.wire.call_report import CallReport
from companion.wire.ids import Motion, Stage
from companion.wire.incidents import MOST_NUMBER
from companion.wire.packing import Fractions

MOST_POSTED = 16 << 10
"""Bytes of a request."""
MOST_CHANGES = 32
_MOTIONS = {"none": Motion.NONE, "go": Motion.GO, "stay": Motion.STAY, "look": Motion.LOOK_AGAIN}


class RequestError(ValueError):
    """Reports a request that cannot be carried out; its text is for a person."""


def read_object(body: bytes) -> Mapping[str, Any]:
    """Read the body of a POST. Raises RequestError."""
    try:
        return json_values.read_object(body, "the request")
    except json_values.DocumentError as error:
        raise RequestError(str(error)) from error


def read_answer(told: Mapping[str, Any]) -> Answer:
    """Read an answer. Its target is 0 for words alone, and for what answers no call. Raises RequestError."""
    motion = _MOTIONS.get(told["motion"]) if isinstance(told.get("motion"), str) else None
    if motion is None:
        raise RequestError(f"motion is one of {', '.join(_MOTIONS)}")
    raw = told.get("changes", [])
    if not isinstance(raw, list) or len(raw) > MOST_CHANGES:
        raise RequestError(f"changes is a list of {MOST_CHANGES} at most")
    operations = tuple(map(_operation, raw))
    words = [one.word for one in operations if isinstance(one, SetWord | Tap | ForgetWord)]
    twice = next((word for word in words if words.count(word) > 1), None)
    if twice is not None:
        raise RequestError(f'"{twice}" stands twice: keep one')
    taps = sum(isinstance(one, Tap) for one in operations)
    if taps > 1:
        raise RequestError("one tap in an answer")
    call = 0 if told.get("call") is None else whole(told, "call", 1, 0xFFFF)
    if not call and (motion is not Motion.NONE or taps):
        raise RequestError("an answer needs the call that it is for")
    if motion is Motion.NONE and not operations:
        raise RequestError("an answer without words needs a motion")
    return Answer(call, motion, operations)


def check_answer(answer: Answer, call: CallReport | None, current: int) -> None:
    """Check an answer against the call that it names, None for one that is not known.

    current: id of the open call or hold, 0 for none. Raises RequestError where it may not be sent.
    """
    frames = {tap.frame_id for tap in taps_of(answer.changes)}
    if frames and (call is None or frames != {call.frame_id}):
        raise RequestError("you tapped in an older picture, so nothing was sent: tap in the new one")
    if answer.target and (call is None or call.stage is Stage.CLOSED):
        raise RequestError(f"call {answer.target} is closed already, so nothing was sent")
    alone = OtherPlace | CancelIncident
    to_none = answer.motion is Motion.NONE and all(isinstance(one, alone) for one in answer.operations)
    if not answer.target and current and not to_none:
        raise RequestError("a call is open: words now would answer it, so send them as its answer")


def read_incident(told: Mapping[str, Any]) -> int:
    """Read for which call an incident file is asked; 0: the last minute. Raises RequestError."""
    return 0 if told.get("call") is None else whole(told, "call", 1, 0xFFFF)


def read_recording(told: Mapping[str, Any]) -> tuple[int, Wish]:
    """Read which recording is meant, and what is to become of it. Raises RequestError."""
    wishes = {wish.name.lower(): wish for wish in Wish}
    wish = wishes.get(told["wish"]) if isinstance(told.get("wish"), str) else None
    if wish is None:
        raise RequestError(f"wish is one of {', '.join(wishes)}")
    return whole(told, "number", 1, MOST_NUMBER), wish


def whole(told: Mapping[str, Any], name: str, low: int, high: int) -> int:
    """Return a whole number of a request. Raises RequestError for any other value."""
    value = told.get(name)
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise RequestError(f"{name} is a whole number of {low} to {high}")
    return value


def _operation(told: Any) -> AnyOperation:
    if not isinstance(told, dict):
        raise RequestError("a change is an object")
    kinds: dict[str, Callable[[Mapping[str, Any]], AnyOperation]] = {
        "tap": _tap,
        "word": lambda one: SetWord(_word(one["word"]), _weight(one)),
        "forget": lambda one: ForgetWord(_word(one["forget"])),
        "forget_call": lambda one: ForgetCall(whole(one, "forget_call", 1, 0xFFFF)),
        "new_episode": lambda _: NewEpisode(),
        "other_place": lambda one: OtherPlace(whole(one, "other_place", 0, 0xFFFF)),
        "cancel_incident": lambda one: CancelIncident(whole(one, "cancel_incident", 0, 0xFFFF)),
    }
    named = [name for name in kinds if name in told]
    if len(named) != 1:
        raise RequestError(f"a change has one of {', '.join(kinds)}")
    return kinds[named[0]](told)


def _tap(told: Mapping[str, Any]) -> Tap:
    box, word, weight = _box(told.get("box")), _word(told["tap"]), _weight(told)
    return Tap(whole(told, "frame", 0, 0xFFFFFFFF), box, word, weight)


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


def _box(raw: Any) -> Fractions:
    if not isinstance(raw, list) or len(raw) != 4 or not all(_is_fraction(side) for side in raw):
        raise RequestError("a box is left, top, right, bottom in fractions of the picture")
    left, top, right, bottom = (round(float(side), 4) for side in raw)
    if not (left < right and top < bottom):
        raise RequestError("a box has its left before its right, and its top above its bottom")
    return left, top, right, bottom


def _is_fraction(side: Any) -> bool:
    return not isinstance(side, bool) and isinstance(side, int | float) and 0 <= side <= 1
