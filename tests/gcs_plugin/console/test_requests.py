"""What the page posts is checked: each body is a request or is refused with a sentence."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.operations import ForgetWord, SetWord, Tap
from companion.pages.requests import RequestError
from companion.wire.answers import Answer
from companion.wire.delivery import split
from companion.wire.ids import Motion, Policy
from gcs_plugin.console.requests import FileRequest, SetPolicyRequest, UndoRequest, read_request

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=60),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=12), inner, max_size=5),
    max_leaves=12,
)
KEYS = ["tap", "word", "weight", "box", "frame", "forget", "forget_call", "new_episode", "other_place"]
CHANGE = st.dictionaries(st.sampled_from([*KEYS, "cancel_incident"]), JSON, max_size=5)
ALIKE = st.fixed_dictionaries(
    {"rover": st.integers(0, 256) | JSON},
    optional={
        "call": st.integers(0, 70000) | JSON,
        "motion": st.sampled_from(["go", "stay", "look", "none"]) | JSON,
        "changes": st.lists(CHANGE, max_size=3) | JSON,
        "policy": st.sampled_from(["hold", "off"]) | JSON,
        "what": st.sampled_from(["large", "check", "ground"]) | JSON,
    },
)
KINDS = st.sampled_from(["answer", "policy", "undo", "fetch", "other"])


def read(kind: str, **told: Any) -> Any:
    rover, request = read_request(kind, json.dumps({"rover": 1, **told}).encode())
    assert rover == told.get("rover", 1)
    return request


def test_a_tap_with_a_name_and_a_motion_is_one_answer() -> None:
    box = [0.41, 0.55, 0.6, 0.81]
    changes = [{"tap": "Drum", "weight": -1, "box": box, "frame": 4711}, {"word": "grass", "weight": 0.5}]
    request = read("answer", call=7, motion="go", changes=changes)
    tap = Tap(4711, (0.41, 0.55, 0.6, 0.81), "drum", -1.0)
    assert request == Answer(7, Motion.GO, (tap, SetWord("grass", 0.5)))


def test_policies_undoing_and_files_are_requests() -> None:
    assert read("policy", policy="hold") == SetPolicyRequest(Policy.HOLD)
    assert read("policy", policy="guide") == SetPolicyRequest(Policy.GUIDE)
    assert read("undo", call=7) == UndoRequest(7)
    assert read("fetch", what="large", call=7) == FileRequest("large", 7)
    assert read("fetch", what="ground") == FileRequest("ground", 0)
    forgotten = read("answer", motion="none", changes=[{"forget": "bush"}])
    assert forgotten == Answer(0, Motion.NONE, (ForgetWord("bush"),))


@pytest.mark.parametrize(
    ("told", "why"),
    [
        ({"motion": "go"}, "needs the call"),
        ({"motion": "none"}, "needs a motion"),
        ({"motion": "drive", "call": 7}, "motion is one of"),
        ({"motion": "go", "call": 0}, "call is a whole number"),
        ({"motion": "go", "call": True}, "call is a whole number"),
        ({"motion": "go", "call": 7, "changes": [{"word": "a", "weight": 2}]}, "weight"),
        ({"motion": "go", "call": 7, "changes": [{"word": "a", "weight": float("nan")}]}, "weight"),
        ({"motion": "go", "call": 7, "changes": [{"word": "a: 1; b", "weight": 1}]}, "leave them out"),
        ({"motion": "go", "call": 7, "changes": [{"tap": "a", "weight": 1, "box": [0, 0, 1, 1]}]}, "frame"),
        (
            {"motion": "go", "call": 7, "changes": [{"tap": "a", "weight": 1, "box": [0.5, 0, 0.5, 1]}]},
            "left before",
        ),
        ({"motion": "go", "call": 7, "changes": [{"word": "a", "weight": 1}] * 2}, "stands twice"),
        ({"motion": "go", "call": 7, "changes": [{"word": "a", "weight": 1}] * 40}, "32 at most"),
        ({"rover": 256, "motion": "go", "call": 7}, "rover is a whole number"),
    ],
)
def test_what_cannot_be_is_refused_with_what_is_wrong(told: dict[str, Any], why: str) -> None:
    with pytest.raises(RequestError, match=why):
        read("answer", **told)


@pytest.mark.slow
@given(KINDS, st.binary(max_size=200) | (JSON | ALIKE).map(lambda told: json.dumps(told).encode()))
def test_any_body_is_a_request_that_fits_the_wire_or_is_refused(kind: str, body: bytes) -> None:
    try:
        rover, request = read_request(kind, body)
    except RequestError:
        return
    assert 1 <= rover <= 255
    if isinstance(request, Answer):
        for one in request.operations:
            if isinstance(one, SetWord | Tap):
                assert -1 <= one.weight <= 1
                assert one.word == one.word.lower()
            assert split(replace(request, operations=(one,), transaction=1))
