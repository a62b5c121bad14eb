"""Packs and unpacks the TUNNEL payload summary (45001). Little-endian, <= 128 bytes.

The call (45002) is in `call_report`, the answer (45003) and its acknowledgement (45004) are in `answers`.
"""

from __future__ import annotations

from dataclasses import dataclass

from companion.wire import layouts
from companion.wire.ids import VERSION, Policy, Reasons, State
from companion.wire.packing import (
    PayloadError,
    Reader,
    fraction_to_u16,
    i16_to_signed,
    signed_to_i16,
    u16_to_fraction,
)

SECTORS = 16
UNKNOWN_SECTOR = 255
_SECTOR_SCALE = 200


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
