"""Reads the rover's JSON documents. What is missing or of another kind is left out.

A later version may differ, and a radio is not trusted: each value is checked, lists and texts are bounded.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import Any

from anytraverse.errors import AnyTraverseError
from anytraverse.preferences import MAX_WORDS, check_weight, clean_word
from companion.wire.ids import Kind, Outcome, Reasons, Stage, words_hash
from companion.wire.json_values import DocumentError, list_of, mapping_of, number_of, read_object, text_of
from companion.wire.packing import Fractions, clean
from companion.wire.parameters import MAX_PARAMETERS, ROI
from companion.wire.parameters import MAX_WORDS as MOST_IN_VOCABULARY
from companion.wire.payloads import CallData

MOST_ROWS = 64
"""Answers of a call, and checks."""
MOST_GIVEN = 32
"""Words that are out of use and were given before."""
_PICTURE = re.compile(r"/(calls|scenes)/[0-9a-f]{1,16}(-large|-raw)?\.jpg", re.ASCII)
PICTURES = {"small": "", "raw": "-raw", "large": "-large"}
"""Pictures of a call by size -> what their files' names have behind the number."""
_REASONS = {one.name.lower(): one for one in Reasons if one.name and one}


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
    """What counts now, of /state.json. words: weight by word. open_call: None for no call or hold.

    given: weight by word, of those that are out of use and were given before.
    """

    starting: bool
    words: Mapping[str, float]
    given: Mapping[str, float]
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
    """A call as its rover recorded it. outcome: "" while it is open. picture, raw, large: paths, or "".

    why: as of `CallData`.
    """

    id: int
    reasons: Reasons
    why: str
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
    return state_from(read_object(content))


def state_from(told: Mapping[str, Any]) -> StateFile:
    """Take the content of /state.json."""
    words = _weights(told.get("words"))
    settings = {
        name: value
        for name, raw in list(mapping_of(told.get("settings")).items())[:MAX_PARAMETERS]
        if (value := number_of(raw, -1e6, 1e6)) is not None
    }
    return StateFile(
        starting=told.get("state") == "starting",
        words=words,
        given=_weights(told.get("given"), MOST_GIVEN),
        vocabulary=tuple(
            word for raw in list_of(told.get("vocabulary"))[:MOST_IN_VOCABULARY] if (word := _word(raw))
        ),
        settings=settings,
        known_place=_known_place(told.get("known_place")),
        open_call=_open_call(told, settings, words),
        hold_refused=text_of(told.get("hold_refused")),
        held_by=text_of(told.get("held_by")),
        model=text_of(told.get("model")),
        version=text_of(told.get("version")),
    )


def read_checks(content: bytes) -> tuple[Check, ...]:
    """Read /check.json. Raises DocumentError."""
    rows = map(mapping_of, list_of(read_object(content).get("checks"))[:MOST_ROWS])
    return tuple(
        Check(text_of(row.get("check")), text_of(row.get("verdict")), text_of(row.get("text")))
        for row in rows
    )


def read_record(content: bytes) -> CallRecord:
    """Read /calls/N.json. Raises DocumentError."""
    return record_from(read_object(content))


def record_from(told: Mapping[str, Any]) -> CallRecord:
    """Take the content of /calls/N.json. Raises DocumentError for one without an id."""
    place = mapping_of(told.get("place"))
    number = number_of(told.get("id"), 1, 0xFFFF)
    if number is None:
        raise DocumentError("the record of a call has no id")
    return CallRecord(
        id=int(number),
        reasons=_reasons(told.get("reasons")),
        why=clean(text_of(told.get("why"))),
        roi_uncertainty=number_of(told.get("roi_uncertainty"), 0, 1),
        worst_tile=number_of(told.get("worst_tile"), 0, 1),
        worst_tile_box=_box(told.get("worst_tile_box")),
        drivable_share=number_of(told.get("drivable_share"), 0, 1),
        similarity=number_of(told.get("similarity"), -1, 1),
        latitude=number_of(place.get("latitude"), -90, 90),
        longitude=number_of(place.get("longitude"), -180, 180),
        words=text_of(told.get("words")),
        outcome=text_of(told.get("outcome")),
        closed=number_of(told.get("closed"), 0, 1e11),
        answers=tuple(map(_answer, list_of(told.get("answers"))[-MOST_ROWS:])),
        nearest=_nearest(mapping_of(told.get("nearest"))),
        picture=_picture(told.get("picture")),
        raw=_picture(told.get("raw")),
        large=_picture(told.get("large")),
    )


def _open_call(
    told: Mapping[str, Any], settings: Mapping[str, float], words: Mapping[str, float]
) -> CallData | None:
    """Read the open call or hold. Its region of interest is that of now; a test is not told as one."""
    shown = mapping_of(told.get("open"))
    number, frame = number_of(shown.get("id"), 1, 0xFFFF), number_of(shown.get("frame_id"), 0, 0xFFFFFFFF)
    kind = {"call": Kind.CALL, "hold": Kind.HOLD}.get(text_of(shown.get("kind")))
    stage = {"open": Stage.OPEN, "answered": Stage.ANSWERED, "clear": Stage.CLEAR}.get(
        text_of(shown.get("stage"))
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
        age_s=int(number_of(shown.get("age"), 0, 1e9) or 0),
        roi=_box([settings.get(name) for name in ROI.values()]),
        worst_tile_box=_box(shown.get("worst_tile_box")),
        roi_uncertainty=number_of(shown.get("roi_uncertainty"), 0, 1),
        worst_tile=number_of(shown.get("worst_tile"), 0, 1),
        drivable_share=number_of(shown.get("drivable_share"), 0, 1),
        similarity=number_of(shown.get("similarity"), -1, 1),
        latitude=None,
        longitude=None,
        heading=None,
        word_count=len(words),
        words=words_hash(words),
        picture=_picture(shown.get("picture")),
        why=clean(text_of(shown.get("why"))),
    )


def _known_place(raw: Any) -> KnownPlace | None:
    if not isinstance(raw, dict):
        return None
    call_id = number_of(raw.get("call"), 1, 0xFFFF)
    changed: dict[str, tuple[float | None, float | None]] = {}
    for name, pair in list(mapping_of(raw.get("changed")).items())[: 2 * MAX_WORDS]:
        word = _word(name)
        if word and isinstance(pair, list) and len(pair) == 2:
            changed[word] = number_of(pair[0], -1, 1), number_of(pair[1], -1, 1)
    return KnownPlace(
        None if call_id is None else int(call_id),
        number_of(raw.get("similarity"), -1, 1),
        number_of(raw.get("needed"), -1, 1),
        changed,
        _picture(raw.get("picture")),
    )


def _nearest(told: Mapping[str, Any]) -> NearestScene | None:
    number, similarity = number_of(told.get("call"), 1, 0xFFFF), number_of(told.get("similarity"), -1, 1)
    if similarity is None:
        return None
    call_id = None if number is None else int(number)
    return NearestScene(call_id, similarity, _weights(told.get("words")), _picture(told.get("picture")))


def _answer(raw: Any) -> GivenAnswer:
    told = mapping_of(raw)
    sender = [number_of(one, 0, 255) for one in list_of(told.get("sender"))]
    known = [int(one) for one in sender if one is not None]
    return GivenAnswer(
        number_of(told.get("at"), 0, 1e11),
        (known[0], known[1]) if len(known) == len(sender) == 2 else None,
        int(number_of(told.get("transaction"), 0, 0xFFFFFFFF) or 0),
        text_of(told.get("motion")),
        tuple(map(text_of, list_of(told.get("operations"))[:MOST_ROWS])),
        text_of(told.get("result")),
        text_of(told.get("text")),
    )


def _weights(raw: Any, most: int = MAX_WORDS) -> dict[str, float]:
    found = {}
    for name, value in list(mapping_of(raw).items())[:most]:
        word, weight = _word(name), number_of(value, -1, 1)
        if word and weight is not None:
            found[word] = check_weight(word, weight)
    return found


def _word(raw: Any) -> str:
    try:
        return clean_word(raw) if isinstance(raw, str) else ""
    except AnyTraverseError:
        return ""


def _reasons(raw: Any) -> Reasons:
    named = [_REASONS.get(one, Reasons.NONE) for one in list_of(raw) if isinstance(one, str)]
    return reduce(or_, named, Reasons.NONE)


def _box(raw: Any) -> Fractions | None:
    sides = [number_of(one, 0, 1) for one in list_of(raw)]
    known = [one for one in sides if one is not None]
    if len(known) != 4 or len(sides) != 4 or not (known[0] < known[2] and known[1] < known[3]):
        return None
    return known[0], known[1], known[2], known[3]


def _picture(raw: Any) -> str:
    """Return the path of a picture, "" for what is none."""
    return raw if isinstance(raw, str) and _PICTURE.fullmatch(raw) else ""
