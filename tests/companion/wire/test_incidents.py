"""What is told of incident files: read back as it was, and within bounds whatever comes."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.wire.incidents import (
    MOST_KEPT,
    MOST_NUMBER,
    SHORT,
    Incidents,
    Packed,
    read_incidents,
    read_name,
)
from companion.wire.packing import clean

CALL = st.integers(-MOST_NUMBER, 0xFFFF)
"""A call, the last minute, or a recording."""
TEXT = st.text(min_size=1, max_size=40).map(clean)
PACKED = st.builds(Packed, st.integers(0, 10**8), CALL, st.integers(0, 10**9), st.integers(0, 10**9), TEXT)
TOLD = st.builds(
    Incidents,
    st.none() | CALL,
    st.none() | st.tuples(CALL, TEXT.filter(bool)),
    st.lists(PACKED, max_size=MOST_KEPT).map(tuple),
)
JSON: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=12),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from(["name", "bytes", "short", "what", "why"]), inner)
    ),
    max_leaves=12,
)


@given(TOLD)
def test_what_a_rover_tells_is_read_back(told: Incidents) -> None:
    assert read_incidents(json.dumps(told.document()).encode()) == told
    for one in told.packed:
        for kind in ("", SHORT):
            assert read_name(f"{one.name}{kind}.zip") == (one.number, one.call, kind == SHORT)


def test_what_a_rover_says_of_them_is_cleaned() -> None:
    evil = "\x1b[2J gone \u202e"
    failed, packed = {"what": "C7", "why": evil}, {"name": "0012-C7", "bytes": 9, "short": 9, "note": evil}
    told = read_incidents(json.dumps({"failed": failed, "packed": [packed]}).encode())
    assert (told.failed, told.packed[0].note) == ((7, "[2J gone"), "[2J gone")


@given(st.dictionaries(st.sampled_from(["packing", "failed", "packed"]), JSON))
def test_whatever_comes_is_read_within_bounds(document: dict[str, Any]) -> None:
    told = read_incidents(json.dumps(document).encode())
    assert len(told.packed) <= 2 * MOST_KEPT
    assert told.packing is None or -MOST_NUMBER <= told.packing <= 99_999


@pytest.mark.parametrize(
    "name",
    [
        "",
        "0012-C7",
        "0012-C7.zip/..",
        "../0012-C7.zip",
        ".0012-C7.zip",
        "0012-C7.zip\n",
        "0012-R0.zip",
        "12-C7.zip",
        "\u0661234-C7.zip",
    ],
)
def test_other_names_are_none(name: str) -> None:
    assert read_name(name) is None


def test_the_page_names_every_key() -> None:
    told = Incidents(7, (7, "why"), (Packed(1, 7, 2, 3),)).document()
    page = (Path(__file__).parents[3] / "docs" / "protocol.md").read_text()
    section = page.split("### Incident files")[1].split("\n### ")[0].partition("`/incidents.json`:")[2]
    keys = {*told, *told["failed"], *told["packed"][0]}
    assert keys == set(re.findall(r"`([a-z]+)`", section))
