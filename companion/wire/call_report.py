"""Defines the report of a call or hold: what radio, files, journal and pages tell of it.

On the radio it is the TUNNEL payload 45002, little-endian, at most 128 bytes. Elsewhere it is a JSON object,
of which each document has some members: `STATE_MEMBERS`, `FIGURES_MEMBERS` or `RECORD_MEMBERS`. A later
version may differ, and a radio is not trusted: each value that is read is checked, lists and texts are
bounded.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import asdict, dataclass
from enum import IntEnum
from functools import reduce
from operator import or_
from typing import Any, NamedTuple

from companion.wire import layouts
from companion.wire.ids import VERSION, Kind, Outcome, Reasons, Stage
from companion.wire.json_values import (
    DocumentError,
    box_of,
    list_of,
    mapping_of,
    number_of,
    place_attributes,
    place_document,
    text_of,
    weights_of,
    whole_of,
)
from companion.wire.packing import (
    Fractions,
    PayloadError,
    Reader,
    box_to_u16,
    clean,
    fraction_to_u16,
    i16_to_signed,
    signed_to_i16,
    text_to_bytes,
    u16_to_box,
    u16_to_fraction,
)
from companion.wire.payloads import check_version

STATE_MEMBERS = (
    "id", "kind", "stage", "holding", "age", "frame_id", "why", "worst_tile_box", "distance",
    "roi_uncertainty", "worst_tile", "drivable_share", "similarity", "picture",
)  # fmt: skip
"""Members of what /state.json tells of the open call or hold."""
FIGURES_MEMBERS = (
    "frame_id", "reasons", "words", "roi_uncertainty", "worst_tile", "worst_tile_box", "drivable_share",
    "similarity", "place",
)  # fmt: skip
"""Members of a closed call in the journal."""
RECORD_MEMBERS = (
    "id",
    *FIGURES_MEMBERS,
    "why",
    "nearest",
    "picture",
    "large",
    "raw",
    "outcome",
    "closed",
    "answers",
)
"""Members of /calls/N.json."""
ONLY_RECORDED = frozenset(
    {"distance", "judged_by", "time", "attitude", "nearest", "large", "raw", "closed", "answers"}
)
"""Attributes of a report that no message tells, but a record or a document."""
MOST_ANSWERS = 64
PICTURES = {"small": "", "raw": "-raw", "large": "-large"}
"""Pictures of a call by size -> what their files' names have behind the number."""
_PICTURE = re.compile(r"/(calls|scenes)/[0-9a-f]{1,16}(-large|-raw)?\.jpg", re.ASCII)
_REASONS = {one.name.lower(): one for one in Reasons if one.name and one}
_NO_COORDINATE = 0x7FFFFFFF
_NO_HEADING = 0xFFFF


@dataclass(frozen=True)
class NearestScene:
    """The answered scene most like a call's. call_id: of the call that taught it, None: of another rover.

    words: weight by word, of those that came with that answer. picture: its path, "" for none.
    """

    call_id: int | None
    similarity: float
    words: Mapping[str, float]
    picture: str

    def document(self) -> dict[str, Any]:
        """Return it as JSON values."""
        return {
            "call": self.call_id,
            "similarity": round(self.similarity, 4),
            "words": dict(self.words),
            "picture": self.picture,
        }


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
class CallReport:
    """Tells of a call or hold. As a payload it has 54 bytes, plus the length of the picture's path.

    id: from the one counter of calls and holds. holding: the vehicle stands because of it. test: a test call.
    roi, worst_tile_box: (left, top, right, bottom) in fractions of the call's frame, or None.
    roi_uncertainty, worst_tile, drivable_share: [0, 1] or None. similarity: [-1, 1] or None.
    age_s: since it was announced. latitude, longitude: degrees; heading: degrees from north; None unknown.
    word_count, words: number and hash of the words in use.
    picture: its path on the file server, at most 60 bytes; "" for none.

    The payload has no room for the others.
    why: the figures that call, and what they lack, in words; "" where not known. Its text says it, too.
    distance: metres from the vehicle's front to the near end of `worst_tile_box` on the ground; None unknown.
    judged_by: the words by which its frame was judged, None unknown. time: seconds since 1970 when it opened.
    attitude: roll, pitch and yaw then, degrees. large, raw: paths of larger pictures, with a judgement and
    without a mark. closed: seconds since 1970, None while it is open.
    """

    id: int
    kind: Kind = Kind.CALL
    stage: Stage = Stage.CLOSED
    outcome: Outcome = Outcome.NONE
    reasons: Reasons = Reasons.NONE
    holding: bool = False
    test: bool = False
    frame_id: int = 0
    age_s: int = 0
    roi: Fractions | None = None
    worst_tile_box: Fractions | None = None
    roi_uncertainty: float | None = None
    worst_tile: float | None = None
    drivable_share: float | None = None
    similarity: float | None = None
    latitude: float | None = None
    longitude: float | None = None
    heading: float | None = None
    word_count: int = 0
    words: int = 0
    picture: str = ""
    why: str = ""
    distance: float | None = None
    judged_by: str | None = None
    time: float | None = None
    attitude: tuple[float, float, float] | None = None
    nearest: NearestScene | None = None
    large: str = ""
    raw: str = ""
    closed: float | None = None
    answers: tuple[GivenAnswer, ...] = ()

    def document(self, members: Iterable[str], digits: int | None = None) -> dict[str, Any]:
        """Return these members as JSON values. digits: of figures, None: all."""
        told = {name: _MEMBERS[name].write(self) for name in members}
        if digits is None:
            return told
        return {name: round(one, digits) if isinstance(one, float) else one for name, one in told.items()}

    @classmethod
    def read(
        cls, told: Mapping[str, Any], members: Iterable[str], needed: Collection[str] = ("id",)
    ) -> CallReport:
        """Take these members of a JSON object. What is missing or of another kind is left out.

        Raises DocumentError where one of `needed` is.
        """
        found: dict[str, Any] = {}
        for name in members:
            read = _MEMBERS[name].read(told.get(name))
            read = {attribute: value for attribute, value in read.items() if value is not None}
            if name in needed and not read:
                raise DocumentError(f"what is told of a call has no {name}")
            found |= read
        return cls(**found)

    def pack(self) -> bytes:
        """Pack into the payload's bytes."""
        return layouts.CALL.struct.pack(
            VERSION,
            self.kind,
            self.stage,
            self.outcome,
            self.reasons,
            self.holding | self.test << 1,
            self.id,
            self.frame_id & 0xFFFFFFFF,
            min(self.age_s, 0xFFFF),
            *box_to_u16(self.roi),
            *box_to_u16(self.worst_tile_box),
            fraction_to_u16(self.roi_uncertainty),
            fraction_to_u16(self.worst_tile),
            fraction_to_u16(self.drivable_share),
            signed_to_i16(self.similarity),
            _NO_COORDINATE if self.latitude is None else round(self.latitude * 1e7),
            _NO_COORDINATE if self.longitude is None else round(self.longitude * 1e7),
            _NO_HEADING if self.heading is None else round(self.heading % 360 * 100) % 36_000,
            self.word_count,
            self.words,
        ) + text_to_bytes(self.picture, 60)

    @classmethod
    def unpack(cls, payload: bytes) -> CallReport:
        """Unpack and check a payload. Raises PayloadError."""
        reader = Reader(payload)
        (version, kind, stage, outcome, reasons, flags, call_id, frame, age, *rest) = reader.take(
            layouts.CALL.struct
        )
        picture = reader.text()
        reader.end()
        check_version(version)
        roi, tile_box, figures = rest[0:4], rest[4:8], rest[8:12]
        latitude, longitude, heading, word_count, words = rest[12:]
        try:
            return cls(
                id=call_id,
                kind=Kind(kind),
                stage=Stage(stage),
                outcome=Outcome(outcome),
                reasons=Reasons(reasons),
                holding=bool(flags & 1),
                test=bool(flags & 2),
                frame_id=frame,
                age_s=age,
                roi=u16_to_box((roi[0], roi[1], roi[2], roi[3])),
                worst_tile_box=u16_to_box((tile_box[0], tile_box[1], tile_box[2], tile_box[3])),
                roi_uncertainty=u16_to_fraction(figures[0]),
                worst_tile=u16_to_fraction(figures[1]),
                drivable_share=u16_to_fraction(figures[2]),
                similarity=i16_to_signed(figures[3]),
                latitude=None if latitude == _NO_COORDINATE else latitude / 1e7,
                longitude=None if longitude == _NO_COORDINATE else longitude / 1e7,
                heading=None if heading == _NO_HEADING else heading / 100,
                word_count=word_count,
                words=words,
                picture=picture,
            )
        except ValueError as error:
            raise PayloadError(str(error)) from error


def picture_path(number: int, size: str) -> str:
    """Return the path of a picture of a call or hold. size: one of `PICTURES`."""
    return f"/calls/{number}{PICTURES[size]}.jpg"


def picture_of(raw: Any) -> str:
    """Return the path of a picture, "" for what is none."""
    return raw if isinstance(raw, str) and _PICTURE.fullmatch(raw) else ""


def reason_names(reasons: Reasons) -> list[str]:
    """Name the reasons, as pages and files do."""
    return [name for name, one in _REASONS.items() if one in reasons]


def reasons_of(raw: Any) -> Reasons:
    """Return the reasons that are named in a list."""
    named = [_REASONS.get(one, Reasons.NONE) for one in list_of(raw) if isinstance(one, str)]
    return reduce(or_, named, Reasons.NONE)


def _answer(raw: Any) -> GivenAnswer:
    told = mapping_of(raw)
    sender = [whole_of(one, 0, 255) for one in list_of(told.get("sender"))]
    known = [one for one in sender if one is not None]
    return GivenAnswer(
        number_of(told.get("at"), 0, 1e11),
        (known[0], known[1]) if len(known) == len(sender) == 2 else None,
        whole_of(told.get("transaction"), 0, 0xFFFFFFFF) or 0,
        text_of(told.get("motion")),
        tuple(map(text_of, list_of(told.get("operations"))[:MOST_ANSWERS])),
        text_of(told.get("result")),
        text_of(told.get("text")),
    )


def _nearest(raw: Any) -> NearestScene | None:
    told = mapping_of(raw)
    similarity = number_of(told.get("similarity"), -1, 1)
    if similarity is None:
        return None
    call_id = whole_of(told.get("call"), 1, 0xFFFF)
    return NearestScene(call_id, similarity, weights_of(told.get("words")), picture_of(told.get("picture")))


class _Member(NamedTuple):
    """A member of a JSON object: its value by a report, and the attributes by what is read as its value."""

    name: str
    write: Callable[[CallReport], Any]
    read: Callable[[Any], dict[str, Any]]


def _member(
    name: str, read: Callable[[Any], Any], write: Callable[[Any], Any] = lambda value: value, of: str = ""
) -> _Member:
    """of: the attribute, where it is named otherwise. read: returns None for what is none."""
    attribute = of or name
    return _Member(name, lambda report: write(getattr(report, attribute)), lambda raw: {attribute: read(raw)})


def _named(name: str, kind: type[IntEnum]) -> _Member:
    """Make a member that is told by name, null for 0."""
    by_name = {one.name.lower(): one for one in kind if one}
    return _member(name, lambda raw: by_name.get(text_of(raw)), lambda one: one.name.lower() if one else None)


def _number(name: str, low: float, high: float) -> _Member:
    return _member(name, lambda raw: number_of(raw, low, high))


def _whole(name: str, low: int, high: int, of: str = "") -> _Member:
    return _member(name, lambda raw: whole_of(raw, low, high), of=of)


_MEMBERS = {
    one.name: one
    for one in (
        _whole("id", 1, 0xFFFF),
        _named("kind", Kind),
        _named("stage", Stage),
        _member("holding", lambda raw: raw is True),
        _whole("age", 0, 10**9, of="age_s"),
        _whole("frame_id", 0, 0xFFFFFFFF),
        _member("reasons", reasons_of, lambda reasons: sorted(reason_names(reasons))),
        _member("why", lambda raw: clean(text_of(raw))),
        _member("words", lambda raw: text_of(raw) or None, of="judged_by"),
        _member("worst_tile_box", box_of, lambda box: box and [round(side, 4) for side in box]),
        _number("distance", 0, 1000),
        _number("roi_uncertainty", 0, 1),
        _number("worst_tile", 0, 1),
        _number("drivable_share", 0, 1),
        _number("similarity", -1, 1),
        _Member("place", place_document, place_attributes),
        _member("nearest", _nearest, lambda one: one and one.document()),
        _member("picture", picture_of),
        _member("large", picture_of),
        _member("raw", picture_of),
        _named("outcome", Outcome),
        _member("closed", lambda raw: number_of(raw, 0, 1e11), lambda at: at and round(at, 2)),
        _member(
            "answers",
            lambda raw: tuple(map(_answer, list_of(raw)[-MOST_ANSWERS:])),
            lambda given: list(map(asdict, given)),
        ),
    )
}
