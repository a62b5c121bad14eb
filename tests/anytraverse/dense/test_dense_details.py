"""Templates and the part of a manifest that describes a dense model."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.errors import BundleError
from anytraverse.perception.dense.details import (
    GROUP,
    DenseDetails,
    ScoreCalibration,
    as_json,
    check_templates,
    filled,
    read_details,
)

LINES = st.text(st.characters(categories=["L", "N", "P", "Zs"], exclude_characters="{}\u00a0"), max_size=40)
CALIBRATIONS = st.builds(
    ScoreCalibration,
    threshold=st.floats(-2, 2),
    temperature=st.floats(1e-6, 2),
    frames=st.integers(1, 1 << 20),
    chance=st.floats(0, 1),
)
WORDS = st.lists(st.text("abcdefgh ", min_size=1, max_size=9), min_size=GROUP, max_size=30, unique=True)
TEMPLATES = st.lists(
    st.tuples(LINES, LINES).map("{}".join).filter(str.isprintable), min_size=1, max_size=16, unique=True
)
DETAILS = st.builds(
    DenseDetails,
    family=st.sampled_from(["siglip", "tipsv2"]),
    grid=st.integers(2, 1024),
    width=st.integers(1, 1 << 14),
    templates=TEMPLATES.map(tuple),
    words=st.lists(st.text("abc ", min_size=1), max_size=9, unique=True).map(tuple),
    absent=WORDS.map(tuple),
    calibration=st.none() | CALIBRATIONS,
)
RUBBISH = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=9), inner, max_size=4),
    max_leaves=8,
)


@pytest.mark.slow
@given(DETAILS)
def test_what_is_written_is_read_again(details: DenseDetails) -> None:
    assert read_details(json.loads(json.dumps(as_json(details))), "bundle") == details


@pytest.mark.slow
@given(DETAILS, st.data())
def test_a_field_of_rubbish_is_refused_or_means_the_same_kind_of_thing(
    details: DenseDetails, data: Any
) -> None:
    values = as_json(details)
    values[data.draw(st.sampled_from(sorted(values)))] = data.draw(RUBBISH)
    try:
        read = read_details(values, "bundle")
    except BundleError:
        return
    assert json.loads(json.dumps(as_json(read))) == values


@given(LINES, LINES, st.text(max_size=20))
def test_a_template_holds_the_word_whatever_the_word_holds(before: str, after: str, word: str) -> None:
    assert filled(f"{before}{{}}{after}", word) == before + word + after


@pytest.mark.parametrize(
    "templates",
    [
        (),
        ("a photo",),
        ("{} and {}",),
        ("{word}",),
        ("{}}",),
        ("{{}}",),
        ("a\n{}",),
        ("{}", "{}"),
        ("{}" + "a" * 200,),
        tuple(f"{number} {{}}" for number in range(17)),
    ],
)
def test_templates_that_cannot_be_filled_are_refused(templates: tuple[str, ...]) -> None:
    with pytest.raises(BundleError, match="template"):
        check_templates(templates)
