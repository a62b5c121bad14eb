"""The parameter file as pymavlink reads it, whose reader is MAVProxy's with more checks."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.mavftp import MAVFTP

from companion.wire.parameters import ListOptions, Parameter, build, pack

NAMES = st.text("ABCDEFGH_0123", min_size=1, max_size=16)
FLOATS = st.floats(width=32, allow_nan=False, allow_infinity=False)
LISTS = st.lists(st.tuples(NAMES, FLOATS), unique_by=lambda row: row[0], max_size=48)
WHOLE = ListOptions()


def listed(rows: list[tuple[str, float]]) -> list[Parameter]:
    return [Parameter(name, value, value, value) for name, value in rows]


def read(packed: bytes) -> Any:
    return MAVFTP.ftp_param_decode(packed)


def told(rows: list[tuple[bytes, float, int]]) -> list[tuple[str, float]]:
    return [(name.decode(), value) for name, value, _ in rows]


@settings(max_examples=60)
@given(LISTS)
def test_every_list_is_read_back_whole(rows: list[tuple[str, float]]) -> None:
    packed = pack(listed(rows), WHOLE, {})
    assert told(read(packed).params) == rows
    assert struct.unpack("<HHH", packed[:6]) == (0x671B, len(rows), len(rows))


@settings(max_examples=60)
@given(LISTS, st.data())
def test_with_defaults_each_has_its_own_where_it_is_known(
    rows: list[tuple[str, float]], data: st.DataObject
) -> None:
    known = data.draw(st.dictionaries(st.sampled_from([name for name, _ in rows] or ["A"]), FLOATS))
    found = read(pack(listed(rows), ListOptions(with_defaults=True), known))
    assert told(found.params) == rows
    defaults = [value for _, value in told(found.defaults or [])]
    assert defaults == pytest.approx([known.get(name, value) for name, value in rows], abs=1e-6)


def test_without_being_asked_no_default_is_told() -> None:
    assert read(pack(listed([("A", 1.0)]), WHOLE, {"A": 2.0})).defaults is None


def test_a_part_of_the_list_says_how_many_there_are() -> None:
    rows = [(f"AT_{number}", float(number)) for number in range(5)]
    for asked, expected in [
        (ListOptions(3), rows[3:]),
        (ListOptions(1, 2), rows[1:3]),
        (ListOptions(0, 9), rows),
    ]:
        packed = pack(listed(rows), asked, {})
        assert told(read(packed).params) == expected
        assert struct.unpack_from("<HH", packed, 2) == (len(expected), 5)
    with pytest.raises(ValueError, match="none from 5 on"):
        pack(listed(rows), ListOptions(5), {})


def test_names_share_what_they_begin_with() -> None:
    """A short name is told behind a long one too, and the last letter always."""
    rows = [("AT_W_DRY_GRASS", 1.0), ("AT_W_DRY", 0.5), ("AT_W_DRY_GRASS_2", 0.0), ("A" * 16, 1.0)]
    assert told(read(pack(listed(rows), WHOLE, {})).params) == rows
    assert len(pack(build(["grass", "dry grass"], {}, {}), WHOLE, {})) < 270


@pytest.mark.parametrize(
    ("query", "asked"),
    [
        ("", ListOptions()),
        ("withdefaults=1", ListOptions(with_defaults=True)),
        ("start=5&count=10", ListOptions(5, 10)),
        ("count=10&withdefaults=0&start=65534&other=x", ListOptions(65534, 10)),
    ],
)
def test_what_is_asked_for_is_read_in_any_order(query: str, asked: ListOptions) -> None:
    assert ListOptions.read(query) == asked


@pytest.mark.parametrize(
    "query", ["start=65535", "count=-1", "start=", "withdefaults=2", "start=१", "count=1.5"]
)
def test_what_is_no_number_of_parameters_is_refused(query: str) -> None:
    with pytest.raises(ValueError, match="is not a number up to"):
        ListOptions.read(query)
