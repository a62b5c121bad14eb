"""Packs and unpacks the TUNNEL payloads summary (45001) and call (45002). Little-endian, <= 128 bytes.

The operator's answer (45003) and its acknowledgement (45004) are in `answers`.
"""

from __future__ import annotations

from dataclasses import dataclass

from companion.wire import layouts
from companion.wire.ids import VERSION, Kind, Outcome, Policy, Reasons, Stage, State
from companion.wire.packing import (
    Fractions,
    PayloadError,
    Reader,
    box_to_u16,
    fraction_to_u16,
    i16_to_signed,
    signed_to_i16,
    text_to_bytes,
    u16_to_box,
    u16_to_fraction,
)

SECTORS = 16
UNKNOWN_SECTOR = 255
_SECTOR_SCALE = 200
_NO_COORDINATE = 0x7FFFFFFF
_NO_HEADING = 0xFFFF


def check_version(version: int) -> None:
    """Raise PayloadError unless `version` is the version of our own layouts."""
    if version != VERSION:
        raise PayloadError(f"payload version {version}, this end speaks {VERSION}: update the older end")


@dataclass(frozen=True)
class Summary:
    """Summarizes the newest frame, once a second. Packs to 47 bytes.

    sequence: rises by one, so that receivers see losses. current_id: open call or hold, 0 for none.
    frame_age_ms: capture to sending. latency_ms: capture to assessment (65535: that or more, for both).
    roi_traversability, roi_uncertainty, worst_tile: [0, 1] or None. similarity: [-1, 1] or None.
    field_of_view: horizontal, degrees, 0 unknown. words: hash of all words in use.
    dropped: summaries not sent for lack of byte budget. sectors: the drivable share, in [0, 1] or None, of 16
    image columns of equal width from the left.
    """

    state: State
    policy: Policy
    reasons: Reasons
    sequence: int
    current_id: int
    frame_id: int
    frame_age_ms: int
    latency_ms: int
    roi_traversability: float | None
    roi_uncertainty: float | None
    worst_tile: float | None
    similarity: float | None
    field_of_view: int
    words: int
    dropped: int
    sectors: tuple[float | None, ...]

    def pack(self) -> bytes:
        """Pack into the payload's bytes."""
        sectors = [
            UNKNOWN_SECTOR if share is None else round(min(1.0, max(0.0, share)) * _SECTOR_SCALE)
            for share in self.sectors
        ]
        return layouts.SUMMARY.struct.pack(
            VERSION,
            self.state,
            self.policy,
            self.reasons,
            self.sequence & 0xFFFF,
            self.current_id,
            self.frame_id & 0xFFFFFFFF,
            min(self.frame_age_ms, 0xFFFF),
            min(self.latency_ms, 0xFFFF),
            fraction_to_u16(self.roi_traversability),
            fraction_to_u16(self.roi_uncertainty),
            fraction_to_u16(self.worst_tile),
            signed_to_i16(self.similarity),
            self.field_of_view,
            self.words,
            min(self.dropped, 0xFFFF),
            *sectors,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> Summary:
        """Unpack and check a payload. Raises PayloadError."""
        reader = Reader(payload)
        (version, state, policy, reasons, sequence, current, frame, age, latency, *rest) = reader.take(
            layouts.SUMMARY.struct
        )
        reader.end()
        check_version(version)
        traversability, uncertainty, tile, similarity, view, words, dropped, *sectors = rest
        if any(_SECTOR_SCALE < raw < UNKNOWN_SECTOR for raw in sectors):
            raise PayloadError("a sector is out of range")
        try:
            return cls(
                state=State(state),
                policy=Policy(policy),
                reasons=Reasons(reasons),
                sequence=sequence,
                current_id=current,
                frame_id=frame,
                frame_age_ms=age,
                latency_ms=latency,
                roi_traversability=u16_to_fraction(traversability),
                roi_uncertainty=u16_to_fraction(uncertainty),
                worst_tile=u16_to_fraction(tile),
                similarity=i16_to_signed(similarity),
                field_of_view=view,
                words=words,
                dropped=dropped,
                sectors=tuple(None if raw == UNKNOWN_SECTOR else raw / _SECTOR_SCALE for raw in sectors),
            )
        except ValueError as error:
            raise PayloadError(str(error)) from error


@dataclass(frozen=True)
class CallData:
    """Describes a call or hold for programs. Packs to 54 bytes, plus the length of the picture's path.

    id: from the one counter of calls and holds. holding: the vehicle stands because of it. test: a test call.
    roi, worst_tile_box: (left, top, right, bottom) in fractions of the call's frame, or None.
    roi_uncertainty, worst_tile, drivable_share: [0, 1] or None. similarity: [-1, 1] or None.
    age_s: since it was announced. latitude, longitude: degrees; heading: degrees from north; None unknown.
    word_count, words: number and hash of the words in use.
    picture: its path on the file server, at most 60 bytes; "" for none.
    why: the figures that call, and what they lack, in words; "" where not known. The payload has no room for
    it: its text says it, and its files do.
    """

    id: int
    kind: Kind
    stage: Stage
    outcome: Outcome
    reasons: Reasons
    holding: bool
    test: bool
    frame_id: int
    age_s: int
    roi: Fractions | None
    worst_tile_box: Fractions | None
    roi_uncertainty: float | None
    worst_tile: float | None
    drivable_share: float | None
    similarity: float | None
    latitude: float | None
    longitude: float | None
    heading: float | None
    word_count: int
    words: int
    picture: str = ""
    why: str = ""

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
    def unpack(cls, payload: bytes) -> CallData:
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
