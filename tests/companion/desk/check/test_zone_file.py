"""The files of `companion check --zone`: what is written is read again, and rubbish is said."""

from __future__ import annotations

import json
import math
import os
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.light import Light
from companion.desk.check import zone_file
from companion.desk.check.zone_file import (
    Zone,
    ZoneArc,
    ZoneFileError,
    ZoneLook,
    ZoneMark,
    parsed_zone,
    read_zone_files,
    write_zone,
)

_AT = "20261127T234500Z"
_LOOK: dict[str, Any] = {
    "frames": 20,
    "noticed_frames": 19,
    "reasons": ("blocked",),
    "light": Light(118.0, 20.0),
    "at": _AT,
}
_MARK: dict[str, Any] = {**_LOOK, "line": "ahead", "bearing_deg": 0.0, "elsewhere": False}
ZONE = Zone(
    at=_AT,
    program="0.1.0",
    identity="0123456789ab",
    model="builtin",
    words={"grass": 1.0, "été": -1.0},
    thresholds={"roi": 0.3, "tile": None},
    region={"left": 0.3},
    mount={"height": None},
    stop={"speed": 1.5, "needs": 5.0},
    thing="box",
    distances=(1.0, 2.0),
    verdict="too short",
    covers=False,
    empty=ZoneLook(**_LOOK),
    marks=(
        ZoneMark(**_MARK, distance_m=2.0, noticed=True, in_picture=True),
        ZoneMark(**_MARK, distance_m=1.0, noticed=False, in_picture=False, ground_m=1.1),
    ),
    arcs=(ZoneArc(**_LOOK, distance_m=2.0, from_deg=-34.0, to_deg=34.0),),
)


def test_a_zone_is_read_as_it_was_written(tmp_path: Path) -> None:
    path = write_zone(tmp_path, ZONE)
    assert path == tmp_path / "zone" / f"{_AT}.json"
    assert read_zone_files(tmp_path) == ([ZONE], [])
    told = json.loads(path.read_bytes())
    assert {"line", "bearing_deg", "distance_m", "frames", "noticed", "light"} <= set(told["marks"][0])


def test_the_newest_files_are_kept_and_no_other_file_is_touched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zone_file, "MOST_FILES", 3)
    (tmp_path / "zone").mkdir()
    (tmp_path / "zone" / "notes.json").write_text("mine")
    for second in range(6):
        write_zone(tmp_path, replace(ZONE, at=f"2026112{second}T000000Z"))
    names = sorted(path.name for path in (tmp_path / "zone").iterdir())
    assert "notes.json" in names
    zones, _ = read_zone_files(tmp_path)
    assert [one.at for one in zones] == [f"2026112{n}T000000Z" for n in (3, 4, 5)]
    assert read_zone_files(tmp_path, most=1) == (zones[-1:], [])


def test_a_zone_that_was_measured_without_a_clock_is_not_deleted_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zone_file, "MOST_FILES", 1)
    write_zone(tmp_path, ZONE)
    assert write_zone(tmp_path, replace(ZONE, at="19700101T000500Z")).exists()


def test_a_folder_that_is_not_there_has_no_zone(tmp_path: Path) -> None:
    assert read_zone_files(tmp_path) == ([], [])


def test_a_file_that_is_none_is_said_and_left_out(tmp_path: Path) -> None:
    write_zone(tmp_path, ZONE)
    (tmp_path / "zone" / "20261127T000000Z.json").write_bytes(b"rubbish")
    os.mkfifo(tmp_path / "zone" / "20261127T000001Z.json")
    (tmp_path / "zone" / "20261127T000002Z.json").mkdir()
    zones, left_out = read_zone_files(tmp_path)
    assert zones == [ZONE]
    assert len(left_out) == 3
    assert all("is left out: " in one for one in left_out)


@pytest.mark.parametrize(
    "change",
    [
        {"version": 2},
        {"version": "\x1b[2J"},
        {"format": "other"},
        {"at": "../../../etc/passwd"},
        {"at": "20269999T999999Z"},
        {"thing": "\x1b[2J"},
        {"words": {"grass": None}},
        {"words": {"grass": 2}},
        {"thresholds": {"roi": math.nan}},
        {"marks": {}},
        {"marks": [{}] * 500},
        {"covers": 1},
        {"empty": {**_LOOK, "frames": 0, "noticed_frames": 0}},
        {"empty": {**_LOOK, "frames": 3, "noticed_frames": 4}},
        {"empty": {**_LOOK, "light": {"mean": 256.0, "darkest": 0.0}}},
        {"empty": {**_LOOK, "at": "now"}},
        {"empty": {"frames": 3, "noticed_frames": 2, "at": _AT}},
        {"distances": [1, "2"]},
        {"mount": {"a\x1bb": 1.0}},
        {"mount": {f"m{number}": 1.0 for number in range(65)}},
    ],
)
def test_figures_out_of_range_are_refused(tmp_path: Path, change: dict[str, Any]) -> None:
    told = json.loads(write_zone(tmp_path, ZONE).read_bytes())
    with pytest.raises(ZoneFileError) as refused:
        parsed_zone(json.dumps(told | change, default=asdict).encode())
    assert str(refused.value).isprintable(), "it is shown in a terminal"


def test_what_could_not_be_read_again_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ZoneFileError):
        write_zone(tmp_path, replace(ZONE, thing="two\nlines"))
    assert not (tmp_path / "zone").exists()


_JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=9), inner, max_size=4),
    max_leaves=8,
)
_KEYS = sorted(json.loads(json.dumps(asdict(ZONE))))


@given(st.dictionaries(st.sampled_from(_KEYS), _JSON, max_size=3))
def test_no_content_raises_anything_else(change: dict[str, Any]) -> None:
    told = {"format": zone_file.FORMAT, "version": zone_file.VERSION, **asdict(ZONE), **change}
    with suppress(ZoneFileError):
        parsed_zone(json.dumps(told).encode())


@given(st.binary(max_size=60))
def test_no_bytes_raise_anything_else(content: bytes) -> None:
    with pytest.raises(ZoneFileError):
        parsed_zone(content)
