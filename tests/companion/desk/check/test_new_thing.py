"""Whether what the picture shows may be what a person carried to a mark."""

from __future__ import annotations

import pytest

from companion.desk.check.new_thing import NewThing


@pytest.mark.parametrize(
    ("thing", "distance", "bearing", "stands"),
    [
        (NewThing(2.1, 1.0, 0.2), 2.0, 0.0, True),
        (NewThing(1.8, 0.0, 0.2), 4.0, 0.0, False),
        (NewThing(4.0, 0.0, 0.2), 2.0, 0.0, False),
        (NewThing(6.0, 0.0, 2.5), 4.0, 0.0, True),
        (NewThing(2.0, 14.0, 0.2), 2.0, 0.0, False),
        (NewThing(1.0, 14.0, 0.2), 1.0, 0.0, True),
        (NewThing(2.0, -179.0, 0.2), 2.0, 179.0, True),
        (NewThing(1.5, 0.0, 0.1, cut=True), 0.5, 0.0, True),
        (NewThing(1.5, 0.0, 0.1, cut=True), 4.0, 0.0, False),
        (NewThing(), 4.0, 0.0, True),
    ],
)
def test_a_thing_stands_on_a_mark_within_a_cell_or_a_share_of_its_place(
    thing: NewThing, distance: float, bearing: float, stands: bool
) -> None:
    assert thing.stands_at(distance, bearing) is stands
