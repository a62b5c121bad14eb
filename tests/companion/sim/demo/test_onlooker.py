"""How the demo finds out what a call is about."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from companion.sim.demo.onlooker import Onlooker, Shown
from companion.sim.field.control import FieldError

BOX, REGION = [0.4, 0.5, 0.5, 0.6], [0.35, 0.46, 0.65, 0.95]


class Field:
    """Notes which picture was looked at; those before `kept_from` are gone."""

    def __init__(self, kept_from: float = 0.0) -> None:
        self.kept_from = kept_from
        self.looked: list[tuple[list[float], float | None]] = []

    def look(self, box: Sequence[float], at: float | None) -> dict[str, Any]:
        if at is not None and at < self.kept_from:
            raise FieldError("no picture of that time is kept: ask sooner")
        self.looked.append((list(box), at))
        return {"kind": "drum", "zone": "meadow", "thing": "drum-1", "patch": None, "surprise": True}


def summary(frame: int, age: float) -> dict[str, Any]:
    return {"frame_id": frame, "frame_age_ms": 1000 * age}


def told(field: Field) -> Onlooker:
    """Frame 40 was taken at 3.9 s, frame 50 at 4.9 s."""
    onlooker = Onlooker(field)
    onlooker.summary(summary(40, 0.1), 4.0)
    onlooker.summary(summary(50, 0.2), 5.1)
    return onlooker


def test_the_picture_of_the_calls_own_frame_is_looked_at() -> None:
    field = Field()
    seen = told(field).about({"frame_id": 47, "worst_tile_box": BOX, "roi": REGION})
    assert seen == Shown("drum", "meadow", thing="drum-1", surprise=True)
    [(box, at)] = field.looked
    assert box == BOX
    assert at == pytest.approx(4.6)


def test_a_call_that_points_at_nothing_is_about_its_region_of_interest() -> None:
    field = Field()
    told(field).about({"frame_id": 50, "worst_tile_box": None, "roi": REGION})
    [(box, at)] = field.looked
    assert box == REGION
    assert at == pytest.approx(4.9)


def test_the_newest_picture_stands_for_one_that_is_kept_no_more() -> None:
    field = Field(kept_from=10.0)
    told(field).about({"frame_id": 50, "worst_tile_box": BOX, "roi": REGION})
    assert field.looked == [(BOX, None)]


def test_nothing_is_said_before_a_summary_has_come_or_without_a_picture() -> None:
    call = {"frame_id": 50, "worst_tile_box": BOX, "roi": REGION}
    assert Onlooker(Field()).about(call) is None

    class Gone(Field):
        def look(self, *_: object) -> dict[str, Any]:
            raise FieldError("the field does not answer: connect again")

    assert told(Gone()).about(call) is None
