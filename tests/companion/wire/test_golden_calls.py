"""The payload of a call has the bytes that it had before."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from companion.wire.ids import Kind, Outcome, Reasons, Stage
from tests.companion.link.payloads import CALL, LONG_CALL
from tests.golden import compare

ALL = Reasons.UNKNOWN_SCENE | Reasons.UNKNOWN_OBJECT | Reasons.BLOCKED | Reasons.FAULT


def test_what_is_packed() -> None:
    calls = {
        "a call": CALL,
        "a long path": LONG_CALL,
        "a path in unicode": replace(CALL, picture="/calls/ü" + "é" * 40),
        "a hold": replace(CALL, kind=Kind.HOLD, stage=Stage.CLEAR, reasons=ALL, holding=True, picture=""),
        "a test": replace(CALL, test=True, reasons=Reasons.NONE, roi=None, worst_tile_box=None),
        "closed": replace(
            CALL, stage=Stage.CLOSED, outcome=Outcome.TAKEN_OVER, age_s=70_000, words=2**32 - 1
        ),
        "nothing known": replace(
            CALL,
            roi=None,
            worst_tile_box=None,
            roi_uncertainty=None,
            worst_tile=None,
            drivable_share=float("nan"),
            similarity=None,
            latitude=None,
            longitude=None,
            frame_id=2**32 + 7,
        ),
        "in the south": replace(CALL, latitude=-47.12345678, longitude=-179.9999999, heading=-12.345),
        "in words": replace(
            CALL, why="new place, .91 like C3, .94 needed", similarity=-0.12345, heading=360.0
        ),
    }
    told = {name: call.pack().hex() for name, call in calls.items()}
    compare(Path(__file__).with_name("golden_calls.json"), told)
