"""What the stored stops and zones tell."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.desk.check.stop_file import read_stops, write_stops
from companion.desk.check.zone_file import Zone, ZoneArc, ZoneLook, ZoneMark, write_zone
from companion.desk.evidence.parts import utc
from companion.desk.evidence.stopping import stopping_part
from companion.desk.evidence.zone import zone_part
from companion.vehicle.brakes import Measured
from tests.companion.desk.evidence.told import NOON, figures, sources, table


def test_stops_are_stored_read_and_fitted(tmp_path: Path) -> None:
    path = write_stops(tmp_path, [("HOLD", [Measured(0.5, 1.0), Measured(1.5, 3.9)]), ("GUIDED", [])], NOON)
    (path.parent / "20260101T000000Z.json").write_text("{}")
    (path.parent / "20260102T000000Z.json").write_text("rubbish")
    found, unread = read_stops(tmp_path)
    assert [(one.at, one.mode, len(one.stops)) for one in found] == [(NOON, "HOLD", 2)]
    assert [name for name, _ in unread] == ["20260101T000000Z.json", "20260102T000000Z.json"]
    part = stopping_part(sources(tmp_path))
    told = figures(part.document())
    assert told["slowest stop measured by HOLD"] == 0.5
    assert told["time constant fitted, HOLD"] > 0.0
    assert len(part.unknown) == 2
    assert table(part.document(), f"Stops by HOLD, {utc(NOON)}")[1] == {
        "speed, m/s": 1.5,
        "way to standstill, m": 3.9,
    }


@given(st.binary(max_size=200))
def test_a_file_of_stops_may_hold_anything(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    folder = tmp_path_factory.mktemp("stops")
    (folder / "stops").mkdir()
    (folder / "stops" / "20260101T000000Z.json").write_bytes(content)
    found, unread = read_stops(folder)
    assert len(unread) + len(found) <= 1


def test_a_measured_zone_is_told_with_its_marks(tmp_path: Path) -> None:
    look: dict[str, Any] = {"frames": 10, "reasons": (), "at": "20261127T234500Z"}
    mark = {**look, "line": "middle", "bearing_deg": 0.0, "elsewhere": False}
    marks = (
        ZoneMark(**mark, noticed_frames=10, distance_m=1.0, noticed=True, in_picture=True),
        ZoneMark(**mark, noticed_frames=1, distance_m=2.0, noticed=False, in_picture=False),
    )
    zone = Zone(
        at="20261127T234500Z",
        program="0.1.0",
        identity="abc",
        model="builtin",
        words={"grass": 1.0},
        thresholds={"roi": 0.3},
        region={"near": 0.3},
        mount={"height": 0.5},
        stop={"speed": 1.0, "needs": 1.5},
        thing="a crate <b>",
        distances=(1.0, 2.0, 3.0),
        verdict="",
        marks=marks,
        arcs=(ZoneArc(**look, noticed_frames=5, distance_m=1, from_deg=-30, to_deg=30),),
        empty=ZoneLook(**look, noticed_frames=2),
    )
    write_zone(tmp_path, zone)
    (tmp_path / "zone" / "20261128T000000Z.json").write_text("rubbish")
    part = zone_part(sources(tmp_path))
    told = figures(part.document())
    assert told["20261127T234500Z: marks measured"] == 2
    assert told["20261127T234500Z: farthest mark at which it was noticed"] == 1.0
    assert told["20261127T234500Z: frames with nothing there in which something was noticed"] == 20.0
    assert [one["noticed"] for one in table(part.document(), "Marks of 20261127T234500Z")] == [True, False]
    assert [one.what for one in part.unknown] == [
        "a measured zone",
        "whether the zone covers the stop",
        "1 marks of the newest zone",
    ]
