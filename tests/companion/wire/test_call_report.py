"""A report comes back from each document that it is written into, and nothing else gets in."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.wire.call_report import (
    FIGURES_MEMBERS,
    MOST_ANSWERS,
    RECORD_MEMBERS,
    STATE_MEMBERS,
    CallReport,
    GivenAnswer,
    NearestScene,
)
from companion.wire.ids import Kind, Outcome, Reasons, Stage
from companion.wire.json_values import LONGEST, DocumentError
from tests.companion.wire.test_documents import JSON
from tests.companion.wire.test_documents import RECORD as WRITTEN

SHARE = st.none() | st.integers(0, 10_000).map(lambda raw: raw / 10_000)
DEGREES = st.none() | st.integers(-9000, 9000).map(lambda raw: raw / 100)
SIDES = st.lists(st.integers(0, 10_000), min_size=4, max_size=4, unique=True).map(sorted)
REPORTS = st.builds(
    CallReport,
    id=st.integers(1, 0xFFFF),
    kind=st.sampled_from(Kind),
    stage=st.sampled_from(Stage),
    outcome=st.sampled_from(Outcome),
    reasons=st.integers(0, 15).map(Reasons),
    holding=st.booleans(),
    frame_id=st.integers(0, 0xFFFFFFFF),
    age_s=st.integers(0, 0xFFFF),
    worst_tile_box=st.none() | SIDES.map(lambda s: (s[0] / 1e4, s[1] / 1e4, s[2] / 1e4, s[3] / 1e4)),
    roi_uncertainty=SHARE,
    worst_tile=SHARE,
    drivable_share=SHARE,
    similarity=SHARE,
    latitude=DEGREES,
    longitude=DEGREES,
    heading=DEGREES,
    time=st.none() | st.integers(0, 4_000_000_000).map(float),
    attitude=st.none() | st.just((1.5, -2.25, 90.0)),
    judged_by=st.none() | st.sampled_from(["grass: 1; tümpel ü: -0.5", "grass: 1"]),
    why=st.sampled_from(["", "new place, .91 like C3, .94 needed"]),
    nearest=st.none()
    | st.builds(
        NearestScene, st.none() | st.integers(1, 9), st.just(0.91), st.just({"ü": -1.0}), st.just("")
    ),
    picture=st.sampled_from(["", "/calls/7.jpg"]),
    closed=st.none() | st.integers(0, 10**9).map(float),
    answers=st.lists(
        st.builds(
            GivenAnswer,
            st.none() | st.just(1.79e9),
            st.none() | st.just((255, 190)),
            st.integers(0, 0xFFFFFFFF),
            st.sampled_from(["go", "none"]),
            st.just(("tümpel ü: -1", "grass: 1")),
            st.just("applied"),
            st.just("noted"),
        ),
        max_size=2,
    ).map(tuple),
)


@given(REPORTS)
def test_a_report_comes_back_from_the_state_and_from_its_record(report: CallReport) -> None:
    told = json.loads(json.dumps(report.document(STATE_MEMBERS, 4)))
    state = CallReport.read(told, STATE_MEMBERS, STATE_MEMBERS[:3])
    assert json.dumps(state.document(STATE_MEMBERS, 4)) == json.dumps(told)
    assert (state.kind, state.stage, state.age_s) == (report.kind, report.stage, report.age_s)
    told = json.loads(json.dumps(report.document(RECORD_MEMBERS)))
    record = CallReport.read(told, RECORD_MEMBERS)
    told_by_record = replace(report, kind=Kind.CALL, stage=Stage.CLOSED, holding=False, age_s=0)
    assert record == told_by_record
    assert record.document(FIGURES_MEMBERS) == report.document(FIGURES_MEMBERS)


@pytest.mark.slow
@given(st.dictionaries(st.sampled_from([*RECORD_MEMBERS, *STATE_MEMBERS]), JSON))
def test_any_values_are_read_within_bounds(told: dict[str, Any]) -> None:
    for members in (STATE_MEMBERS, RECORD_MEMBERS):
        report = CallReport.read({**told, "id": 7}, members)
        CallReport.unpack(report.pack())
        assert len(report.why) <= LONGEST
        assert len(report.answers) <= MOST_ANSWERS


@pytest.mark.parametrize("wrong", [{}, {"id": 0}, {"id": "7"}, {"id": True}, {"id": 0x10000}])
def test_a_call_without_an_id_is_none(wrong: dict[str, Any]) -> None:
    with pytest.raises(DocumentError, match="has no id"):
        CallReport.read({**WRITTEN, "id": None, **wrong}, RECORD_MEMBERS)


def test_a_kind_of_a_later_version_is_none_where_it_is_needed() -> None:
    told = CallReport(7, stage=Stage.OPEN).document(STATE_MEMBERS) | {"kind": "question"}
    with pytest.raises(DocumentError, match="has no kind"):
        CallReport.read(told, STATE_MEMBERS, ("id", "kind"))
