"""What is kept of calls that are closed, for people to read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from anytraverse.regions import Box
from companion.calls.decisions import Call
from companion.places import place_figures


@dataclass(frozen=True)
class CallRecord:
    """A closed call. closed_at: seconds since 1970. outcome: as in wire.ids.Outcome, lower case.

    record: frame id, reasons, place and figures that the call was made for. answers: as recorded.
    """

    id: int
    closed_at: float
    outcome: str
    record: Mapping[str, Any]
    answers: tuple[Mapping[str, Any], ...] = ()


def _sides(box: Box) -> list[float]:
    return [round(side, 4) for side in (box.left, box.top, box.right, box.bottom)]


def record_of(call: Call) -> dict[str, Any]:
    """The figures of a call as JSON values."""
    seen = call.seen
    roi, tile = (seen.roi, seen.tile) if seen is not None else (None, None)
    return {
        "frame_id": call.frame_id,
        "reasons": sorted(reason.value for reason in call.reasons),
        "words": seen.words.format() if seen is not None else None,
        "roi_uncertainty": roi.uncertainty if roi is not None else None,
        "worst_tile": tile.uncertainty if tile is not None else None,
        "worst_tile_box": _sides(tile.box) if tile is not None else None,
        "drivable_share": roi.drivable_share if roi is not None else None,
        "similarity": seen.similarity if seen is not None else None,
        "place": place_figures(call.place),
    }
