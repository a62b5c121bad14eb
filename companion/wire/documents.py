"""Reads the rover's JSON documents. What is missing or of another kind is left out.

A later version may differ, and a radio is not trusted: each value is checked, lists and texts are bounded.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from anytraverse.preferences import MAX_WORDS
from companion.wire.call_report import RECORD_MEMBERS, STATE_MEMBERS, CallReport, picture_of, reasons_of
from companion.wire.ids import Stage, words_hash
from companion.wire.json_values import (
    DocumentError,
    box_of,
    list_of,
    mapping_of,
    number_of,
    read_object,
    text_of,
    weights_of,
    whole_of,
    word_of,
)
from companion.wire.parameters import MAX_PARAMETERS, ROI
from companion.wire.parameters import MAX_WORDS as MOST_IN_VOCABULARY

MOST_CHECKS = 64
MOST_GIVEN = 32
"""Words that are out of use and were given before."""

FROM_ABOVE = "/maps/from_above.png"
"""Where the ground from above is served."""


@dataclass(frozen=True)
class KnownPlace:
    """The remembered place whose words are in force by a match. picture: its path, "" for none."""

    call_id: int | None
    similarity: float | None
    needed: float | None
    changed: Mapping[str, tuple[float | None, float | None]]
    picture: str


@dataclass(frozen=True)
class StateFile:
    """What counts now, of /state.json. words: weight by word. open_call: None for no call or hold.

    given: weight by word, of those that are out of use and were given before. tapped: those in use that were
    tapped in pictures. guide_refused: "" where policy guide would be given, None where that is not told.
    """

    starting: bool
    words: Mapping[str, float]
    given: Mapping[str, float]
    vocabulary: tuple[str, ...]
    tapped: tuple[str, ...]
    settings: Mapping[str, float]
    known_place: KnownPlace | None
    open_call: CallReport | None
    hold_refused: str
    guide_refused: str | None
    held_by: str
    model: str
    version: str


@dataclass(frozen=True)
class CheckRow:
    """One row of /check.json. verdict: "pass", "skip", "warn" or "fail". text: what to do."""

    name: str
    verdict: str
    text: str


def read_state(content: bytes) -> StateFile:
    """Read /state.json. Raises DocumentError for what is no JSON object."""
    return state_from(read_object(content))


def state_from(told: Mapping[str, Any]) -> StateFile:
    """Take the content of /state.json."""
    words = weights_of(told.get("words"))
    settings = {
        name: value
        for name, raw in list(mapping_of(told.get("settings")).items())[:MAX_PARAMETERS]
        if (value := number_of(raw, -1e6, 1e6)) is not None
    }
    return StateFile(
        starting=told.get("state") == "starting",
        words=words,
        given=weights_of(told.get("given"), MOST_GIVEN),
        vocabulary=_words(told.get("vocabulary"), MOST_IN_VOCABULARY),
        tapped=_words(told.get("tapped"), MAX_WORDS),
        settings=settings,
        known_place=_known_place(told.get("known_place")),
        open_call=_open_call(told, settings, words),
        hold_refused=text_of(told.get("hold_refused")),
        guide_refused=None if told.get("guide_refused") is None else text_of(told["guide_refused"]),
        held_by=text_of(told.get("held_by")),
        model=text_of(told.get("model")),
        version=text_of(told.get("version")),
    )


def _words(raw: Any, most: int) -> tuple[str, ...]:
    return tuple(word for one in list_of(raw)[:most] if (word := word_of(one)))


def read_checks(content: bytes) -> tuple[CheckRow, ...]:
    """Read /check.json. Raises DocumentError."""
    rows = map(mapping_of, list_of(read_object(content).get("checks"))[:MOST_CHECKS])
    return tuple(
        CheckRow(text_of(row.get("check")), text_of(row.get("verdict")), text_of(row.get("text")))
        for row in rows
    )


def read_record(content: bytes) -> CallReport:
    """Read /calls/N.json. Raises DocumentError, for one without an id too."""
    return CallReport.read(read_object(content), RECORD_MEMBERS)


def _open_call(
    told: Mapping[str, Any], settings: Mapping[str, float], words: Mapping[str, float]
) -> CallReport | None:
    """Read the open call or hold. Its region of interest is that of now; a test is not told as one."""
    try:
        call = CallReport.read(
            mapping_of(told.get("open")), STATE_MEMBERS, ("id", "kind", "stage", "frame_id")
        )
    except DocumentError:
        return None
    if call.stage is Stage.CLOSED:
        return None
    return replace(
        call,
        reasons=reasons_of(told.get("reasons")),
        roi=box_of([settings.get(name) for name in ROI.values()]),
        word_count=len(words),
        words=words_hash(words),
    )


def _known_place(raw: Any) -> KnownPlace | None:
    if not isinstance(raw, dict):
        return None
    call_id = whole_of(raw.get("call"), 1, 0xFFFF)
    changed: dict[str, tuple[float | None, float | None]] = {}
    for name, pair in list(mapping_of(raw.get("changed")).items())[: 2 * MAX_WORDS]:
        word = word_of(name)
        if word and isinstance(pair, list) and len(pair) == 2:
            changed[word] = number_of(pair[0], -1, 1), number_of(pair[1], -1, 1)
    return KnownPlace(
        call_id,
        number_of(raw.get("similarity"), -1, 1),
        number_of(raw.get("needed"), -1, 1),
        changed,
        picture_of(raw.get("picture")),
    )
