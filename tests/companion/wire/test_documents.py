"""The rover's documents: what fits is read, the rest is left out, and nothing raises but DocumentError."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.wire.call_report import CallReport, NearestScene
from companion.wire.documents import read_checks, read_record, read_state
from companion.wire.ids import Kind, Reasons, Stage
from companion.wire.json_values import LARGEST, LONGEST, DocumentError

STATE: dict[str, Any] = {
    "state": "holding",
    "reasons": ["unknown_object"],
    "model": "m",
    "words": {"grass": 1.0, "dirt path": 0.5},
    "vocabulary": ["grass", "gravel"],
    "tapped": ["dirt path"],
    "settings": {"AT_ROI_L": 0.3, "AT_ROI_T": 0.5, "AT_ROI_R": 0.7, "AT_ROI_B": 0.95, "AT_THR_ROI": 0.4},
    "open": {
        "id": 7,
        "kind": "call",
        "stage": "open",
        "holding": True,
        "age": 12,
        "frame_id": 4711,
        "why": "unknown 71% in yellow frame, over 25% calls",
        "worst_tile_box": [0.41, 0.55, 0.6, 0.81],
        "distance": 2.13,
        "roi_uncertainty": 0.38,
        "worst_tile": 0.71,
        "drivable_share": 0.9,
        "similarity": 0.97,
        "picture": "/calls/7.jpg",
    },
    "known_place": {
        "call": 3,
        "similarity": 0.96,
        "needed": 0.93,
        "changed": {"gravel": [None, 1]},
        "picture": "/calls/3.jpg",
    },
}
RECORD: dict[str, Any] = {
    "id": 7,
    "reasons": ["unknown_scene"],
    "why": "new place, .91 like C3, .94 needed",
    "place": {"latitude": 47.1, "longitude": 8.2},
    "nearest": {"call": 3, "similarity": 0.91, "words": {"drum": -1}, "picture": "/calls/3.jpg"},
    "raw": "/calls/7-raw.jpg",
    "outcome": "answered",
    "answers": [
        {
            "at": 1.8e9,
            "sender": [254, 190],
            "motion": "go",
            "operations": ["gravel: 1"],
            "result": "applied",
            "text": "ok",
        }
    ],
}
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=60),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=12), inner, max_size=5),
    max_leaves=12,
)


def encoded(told: Any) -> bytes:
    return json.dumps(told).encode()


def test_an_open_call_is_read_as_its_data_on_the_wire_would_be() -> None:
    state = read_state(encoded(STATE))
    call = state.open_call
    assert call is not None
    assert (call.id, call.kind, call.stage, call.frame_id, call.age_s) == (7, Kind.CALL, Stage.OPEN, 4711, 12)
    assert (call.reasons, call.holding, call.picture) == (Reasons.UNKNOWN_OBJECT, True, "/calls/7.jpg")
    assert call.roi == (0.3, 0.5, 0.7, 0.95)
    assert call.why == "unknown 71% in yellow frame, over 25% calls"
    assert CallReport.unpack(call.pack()) == replace(call, why="", distance=None)
    assert state.words == {"grass": 1.0, "dirt path": 0.5}
    assert (state.vocabulary, state.tapped) == (("grass", "gravel"), ("dirt path",))
    assert state.known_place is not None
    assert state.known_place.changed == {"gravel": (None, 1.0)}


def test_a_record_says_who_answered() -> None:
    record = read_record(encoded(RECORD))
    assert record.answers[0].sender == (254, 190)
    assert record.answers[0].operations == ("gravel: 1",)
    assert (record.latitude, record.longitude) == (47.1, 8.2)
    assert record.nearest == NearestScene(3, 0.91, {"drum": -1.0}, "/calls/3.jpg")
    assert record.why == "new place, .91 like C3, .94 needed"
    assert (record.raw, record.large) == ("/calls/7-raw.jpg", "")


@pytest.mark.parametrize("content", [b"", b"[]", b"\xff", b"7", b"[" * 100_000])
def test_what_is_no_object_is_refused(content: bytes) -> None:
    for read in (read_state, read_checks, read_record):
        with pytest.raises(DocumentError):
            read(content)


def test_a_document_far_longer_than_a_rovers_is_not_parsed(monkeypatch: pytest.MonkeyPatch) -> None:
    padded = encoded(STATE).ljust(LARGEST)
    assert read_state(padded) == read_state(encoded(STATE))
    monkeypatch.setattr(json, "loads", None)
    for read in (read_state, read_checks, read_record):
        with pytest.raises(DocumentError, match="is longer than 256 kB"):
            read(padded + b" ")


@pytest.mark.slow
@given(st.sampled_from([STATE, RECORD]), st.lists(st.tuples(st.integers(0, 40), JSON), max_size=4))
def test_documents_with_any_values_in_any_place_are_read_within_bounds(
    document: dict[str, Any], changes: list[tuple[int, Any]]
) -> None:
    told = json.loads(json.dumps(document))
    places = [(told, name) for name in told]
    for inner in (told.get("open"), told.get("known_place"), told.get("nearest"), *told.get("answers", [])):
        places += [(inner, name) for name in inner] if isinstance(inner, dict) else []
    for number, value in changes:
        owner, name = places[number % len(places)]
        owner[name] = value
    content = encoded(told)
    state = read_state(content)
    assert len(state.words) <= 16
    assert all(-1 <= weight <= 1 for weight in state.words.values())
    if state.open_call is not None:
        CallReport.unpack(state.open_call.pack())
    assert all(len(row.text) <= LONGEST for row in read_checks(content))
    try:
        record = read_record(content)
    except DocumentError:
        return
    assert 1 <= record.id <= 0xFFFF
