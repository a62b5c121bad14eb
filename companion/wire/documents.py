"""Reads the rover's JSON documents. What is missing or of another kind is left out.

A later version may differ, and a radio is not trusted: each value is checked, lists and texts are bounded.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import Any

from anytraverse.errors import AnyTraverseError
from anytraverse.preferences import MAX_WORDS, check_weight, clean_word
from companion.wire.ids import Kind, Outcome, Reasons, Stage, words_hash
from companion.wire.packing import Fractions
from companion.wire.parameters import MAX_PARAMETERS, ROI
from companion.wire.parameters import MAX_WORDS as MOST_IN_VOCABULARY
from companion.wire.payloads import CallData

LONGEST = 300
"""Characters of a text."""
MOST_ROWS = 64
"""Answers of a call, and checks."""
_PICTURE = re.compile(r"/(calls|scenes)/[0-9a-f]{1,16}(-large|-raw)?\.jpg", re.ASCII)
PICTURES = {"small": "", "raw": "-raw", "large": "-large"}
"""Pictures of a call by size -> what their files' names have behind the number."""
_REASONS = {one.name.lower(): one for one in Reasons if one.name and one}


class DocumentError(ValueError):
    """Reports a document that is none; the text says what it is instead."""


@dataclass(frozen=True)
class KnownPlace:
    """The remembered place whose words are in force by a match. picture: its path, "" for none."""

    call_id: int | None
    similarity: float | None
    needed: float | None
    changed: Mapping[str, tuple[float | None, float | None]]
    picture: str


@dataclass(frozen=True)
class NearestScene:
    """The answered scene most like a call's. call_id: of the call that taught it, None: of another rover.

    words: weight by word, of those that came with that answer. picture: its path, "" for none.
    """

    call_id: int | None
    similarity: float
    words: Mapping[str, float]
    picture: str


@dataclass(frozen=True)
class StateFile:
    """What counts now, of /state.json. words: weight by word. open_call: None for no call or hold."""

    starting: bool
    words: Mapping[str, float]
    vocabulary: tuple[str, ...]
    settings: Mapping[str, float]
    known_place: KnownPlace | None
    open_call: CallData | None
    hold_refused: str
    held_by: str
    model: str
    version: str


@dataclass(frozen=True)
class Check:
    """One row of /check.json. verdict: "pass", "skip", "warn" or "fail". text: what to do."""

    name: str
    verdict: str
    text: str


@dataclass(frozen=True)
class GivenAnswer:
    """One answer in a call's record. sender: system and component. at: seconds since 1970.

    transaction: of its payload, 0 where it has none.
    """

    at: float | None
    sender: tuple[int, int] | None
    transaction: int
    motion: str
    operations: tuple[str, ...]
    result: str
    text: str


@dataclass(frozen=True)
class CallRecord:
    """A call as its rover recorded it. outcome: "" while it is open. picture, raw, large: paths, or ""."""

    id: int
    reasons: Reasons
    roi_uncertainty: float | None
    worst_tile: float | None
    worst_tile_box: Fractions | None
    drivable_share: float | None
    similarity: float | None
    latitude: float | None
    longitude: float | None
    words: str
    outcome: str
    closed: float | None
    answers: tuple[GivenAnswer, ...]
    nearest: NearestScene | None
    picture: str
    raw: str
    large: str


def picture_path(number: int, size: str) -> str:
    """Return the path of a picture of a call or hold. size: one of `PICTURES`."""
    return f"/calls/{number}{PICTURES[size]}.jpg"


def read_state(content: bytes) -> StateFile:
    """Read /state.json. Raises DocumentError for what is no JSON object."""
    return state_from(_object(content))


def state_from(told: Mapping[str, Any]) -> StateFile:
    """Take the content of /state.json."""
    words = _weights(told.get("words"))
    settings = {
        name: value
        for name, raw in list(_mapping(told.get("settings")).items())[:MAX_PARAMETERS]
        if (value := _number(raw, -1e6, 1e6)) is not None
    }
    return StateFile(
        starting=told.get("state") == "starting",
        words=words,
        vocabulary=tuple(
            word for raw in _list(told.get("vocabulary"))[:MOST_IN_VOCABULARY] if (word := _word(raw))
        ),
        settings=settings,
        known_place=_known_place(told.get("known_place")),
        open_call=_open_call(told, settings, words),
        hold_refused=_text(told.get("hold_refused")),
        held_by=_text(told.get("held_by")),
        model=_text(told.get("model")),
        version=_text(told.get("version")),
    )


def read_checks(content: bytes) -> tuple[Check, ...]:
    """Read /check.json. Raises DocumentError."""
    rows = map(_mapping, _list(_object(content).get("checks"))[:MOST_ROWS])
    return tuple(
        Check(_text(row.get("check")), _text(row.get("verdict")), _text(row.get("text"))) for row in rows
    )


def read_record(content: bytes) -> CallRecord:
    """Read /calls/N.json. Raises DocumentError."""
    return record_from(_object(content))


def record_from(told: Mapping[str, Any]) -> CallRecord:
    """Take the content of /calls/N.json. Raises DocumentError for one without an id."""
    place = _mapping(told.get("place"))
    number = _number(told.get("id"), 1, 0xFFFF)
    if number is None:
        raise DocumentError("the record of a call has no id")
    return CallRecord(
        id=int(number),
        reasons=_reasons(told.get("reasons")),
        roi_uncertainty=_number(told.get("roi_uncertainty"), 0, 1),
        worst_tile=_number(told.get("worst_tile"), 0, 1),
        worst_tile_box=_box(told.get("worst_tile_box")),
        drivable_share=_number(told.get("drivable_share"), 0, 1),
        similarity=_number(told.get("similarity"), -1, 1),
        latitude=_number(place.get("latitude"), -90, 90),
        longitude=_number(place.get("longitude"), -180, 180),
        words=_text(told.get("words")),
        outcome=_text(told.get("outcome")),
        closed=_number(told.get("closed"), 0, 1e11),
        answers=tuple(map(_answer, _list(told.get("answers"))[-MOST_ROWS:])),
        nearest=_nearest(_mapping(told.get("nearest"))),
        picture=_picture(told.get("picture")),
        raw=_picture(told.get("raw")),
        large=_picture(told.get("large")),
    )


def _object(content: bytes) -> Mapping[str, Any]:
    try:
        told = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise DocumentError("it is not JSON") from error
    if not isinstance(told, dict):
        raise DocumentError("it is not an object")
    return told


def _open_call(
    told: Mapping[str, Any], settings: Mapping[str, float], words: Mapping[str, float]
) -> CallData | None:
    """Read the open call or hold. Its region of interest is that of now; a test is not told as one."""
    shown = _mapping(told.get("open"))
    number, frame = _number(shown.get("id"), 1, 0xFFFF), _number(shown.get("frame_id"), 0, 0xFFFFFFFF)
    kind = {"call": Kind.CALL, "hold": Kind.HOLD}.get(_text(shown.get("kind")))
    stage = {"open": Stage.OPEN, "answered": Stage.ANSWERED, "clear": Stage.CLEAR}.get(
        _text(shown.get("stage"))
    )
    if number is None or frame is None or kind is None or stage is None:
        return None
    return CallData(
        id=int(number),
        kind=kind,
        stage=stage,
        outcome=Outcome.NONE,
        reasons=_reasons(told.get("reasons")),
        holding=shown.get("holding") is True,
        test=False,
        frame_id=int(frame),
        age_s=int(_number(shown.get("age"), 0, 1e9) or 0),
        roi=_box([settings.get(name) for name in ROI.values()]),
        worst_tile_box=_box(shown.get("worst_tile_box")),
        roi_uncertainty=_number(shown.get("roi_uncertainty"), 0, 1),
        worst_tile=_number(shown.get("worst_tile"), 0, 1),
        drivable_share=_number(shown.get("drivable_share"), 0, 1),
        similarity=_number(shown.get("similarity"), -1, 1),
        latitude=None,
        longitude=None,
        heading=None,
        word_count=len(words),
        words=words_hash(words),
        picture=_picture(shown.get("picture")),
    )


def _known_place(raw: Any) -> KnownPlace | None:
    if not isinstance(raw, dict):
        return None
    call_id = _number(raw.get("call"), 1, 0xFFFF)
    changed: dict[str, tuple[float | None, float | None]] = {}
    for name, pair in list(_mapping(raw.get("changed")).items())[: 2 * MAX_WORDS]:
        word = _word(name)
        if word and isinstance(pair, list) and len(pair) == 2:
            changed[word] = _number(pair[0], -1, 1), _number(pair[1], -1, 1)
    return KnownPlace(
        None if call_id is None else int(call_id),
        _number(raw.get("similarity"), -1, 1),
        _number(raw.get("needed"), -1, 1),
        changed,
        _picture(raw.get("picture")),
    )


def _nearest(told: Mapping[str, Any]) -> NearestScene | None:
    number, similarity = _number(told.get("call"), 1, 0xFFFF), _number(told.get("similarity"), -1, 1)
    if similarity is None:
        return None
    call_id = None if number is None else int(number)
    return NearestScene(call_id, similarity, _weights(told.get("words")), _picture(told.get("picture")))


def _answer(raw: Any) -> GivenAnswer:
    told = _mapping(raw)
    sender = [_number(one, 0, 255) for one in _list(told.get("sender"))]
    known = [int(one) for one in sender if one is not None]
    return GivenAnswer(
        _number(told.get("at"), 0, 1e11),
        (known[0], known[1]) if len(known) == len(sender) == 2 else None,
        int(_number(told.get("transaction"), 0, 0xFFFFFFFF) or 0),
        _text(told.get("motion")),
        tuple(map(_text, _list(told.get("operations"))[:MOST_ROWS])),
        _text(told.get("result")),
        _text(told.get("text")),
    )


def _weights(raw: Any) -> dict[str, float]:
    found = {}
    for name, value in list(_mapping(raw).items())[:MAX_WORDS]:
        word, weight = _word(name), _number(value, -1, 1)
        if word and weight is not None:
            found[word] = check_weight(word, weight)
    return found


def _word(raw: Any) -> str:
    try:
        return clean_word(raw) if isinstance(raw, str) else ""
    except AnyTraverseError:
        return ""


def _reasons(raw: Any) -> Reasons:
    named = [_REASONS.get(one, Reasons.NONE) for one in _list(raw) if isinstance(one, str)]
    return reduce(or_, named, Reasons.NONE)


def _box(raw: Any) -> Fractions | None:
    sides = [_number(one, 0, 1) for one in _list(raw)]
    known = [one for one in sides if one is not None]
    if len(known) != 4 or len(sides) != 4 or not (known[0] < known[2] and known[1] < known[3]):
        return None
    return known[0], known[1], known[2], known[3]


def _number(raw: Any, low: float, high: float) -> float | None:
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        return None
    return float(raw) if low <= raw <= high and math.isfinite(raw) else None


def _text(raw: Any) -> str:
    return raw[:LONGEST] if isinstance(raw, str) else ""


def _picture(raw: Any) -> str:
    """Return the path of a picture, "" for what is none."""
    return raw if isinstance(raw, str) and _PICTURE.fullmatch(raw) else ""


def _mapping(raw: Any) -> Mapping[str, Any]:
    return raw if isinstance(raw, dict) else {}


def _list(raw: Any) -> list[Any]:
    return raw if isinstance(raw, list) else []
