"""Answers by a table."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.wire.call_report import CallReport
from companion.wire.ids import Kind, Reasons, Stage
from gcs_plugin.client.rovers import TrackedCall
from gcs_plugin.terminal.script import EXAMPLE, Script, ScriptError


def script(*rules: dict[str, Any]) -> Script:
    return Script.parse(json.dumps(rules))


def call_of(data: CallReport) -> TrackedCall:
    return TrackedCall(data, 0.0, 0.0, serial=data.id)


def test_the_first_rule_that_fits_answers(thing_call: CallReport) -> None:
    table = script(
        {"reasons": ["unknown_scene"], "answer": "grass: 1, go"},
        {"reasons": ["unknown_object"], "answer": "tap drum -1 go"},
        {"answer": "stay"},
    )
    assert table.answer(1, call_of(thing_call), 0.0) == "tap drum -1 go"


def test_all_reasons_of_a_rule_must_be_among_the_calls(thing_call: CallReport) -> None:
    table = script({"reasons": ["unknown_object", "unknown_scene"], "answer": "go"})
    assert table.answer(1, call_of(thing_call), 0.0) is None
    both = replace(thing_call, reasons=Reasons.UNKNOWN_OBJECT | Reasons.UNKNOWN_SCENE | Reasons.BLOCKED)
    assert table.answer(1, call_of(both), 1.0) == "go"


def test_a_call_that_stays_open_is_left_to_the_next_rule(thing_call: CallReport) -> None:
    table = script({"answer": "bush: -1 go"}, {"answer": "tap drum -1 go"})
    answers = [table.answer(1, call_of(thing_call), now) for now in (0.0, 1.0, 2.0)]
    assert answers == ["bush: -1 go", "tap drum -1 go", None]


def test_a_rule_is_used_so_many_times_and_no_more(thing_call: CallReport) -> None:
    table = script({"answer": "go", "times": 2})
    calls = [replace(thing_call, id=number) for number in (1, 2, 3)]
    assert [table.answer(1, call_of(call), 0.0) for call in calls] == ["go", "go", None]


def test_nth_means_the_nth_call_that_fits_the_rest(thing_call: CallReport) -> None:
    table = script({"kind": "call", "nth": 2, "answer": "go"})
    hold = replace(thing_call, id=5, kind=Kind.HOLD)
    calls = [thing_call, hold, replace(thing_call, id=8), replace(thing_call, id=9)]
    assert [table.answer(1, call_of(call), 0.0) for call in calls] == [None, None, "go", None]
    assert table.answer(1, call_of(thing_call), 1.0) is None


def test_after_counts_from_when_the_stage_was_reached(thing_call: CallReport) -> None:
    table = script({"answer": "go", "after": 2}, {"answer": "stay"})
    assert table.answer(1, call_of(thing_call), 10.0) is None
    assert table.answer(1, call_of(thing_call), 11.9) is None
    assert table.answer(1, call_of(thing_call), 12.0) == "go"


def test_a_stage_that_comes_again_is_answered_again(thing_call: CallReport) -> None:
    table = script({"when": "clear", "answer": "go"})
    clear = replace(thing_call, stage=Stage.CLEAR)
    stages = (thing_call, clear, clear, thing_call, clear)
    assert [table.answer(1, call_of(call), 0.0) for call in stages] == [None, "go", None, None, "go"]


def test_kind_and_holding_choose(thing_call: CallReport) -> None:
    table = script({"kind": "hold", "holding": True, "answer": "go"}, {"holding": False, "answer": "stay"})
    assert table.answer(1, call_of(thing_call), 0.0) is None
    assert table.answer(1, call_of(replace(thing_call, holding=False)), 1.0) == "stay"
    assert table.answer(1, call_of(replace(thing_call, id=8, kind=Kind.HOLD)), 2.0) == "go"


def test_two_rovers_with_the_same_id_are_two_calls(thing_call: CallReport) -> None:
    table = script({"answer": "go"})
    assert [table.answer(system, call_of(thing_call), 0.0) for system in (1, 2, 1)] == ["go", "go", None]


def test_the_example_in_the_error_text_is_a_script() -> None:
    Script.parse(EXAMPLE)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "not JSON"),
        ("[" * 5000, "not JSON"),
        ("{}", "a list of 1"),
        ("[]", "a list of 1"),
        ("[7]", "rule 1 is not an object"),
        ("[{}]", '"answer" is a line'),
        ('[{"answer": "go"}, {"answer": "nonsense"}]', "rule 2: "),
        ('[{"answer": "7 go"}]', "without rover and id"),
        ('[{"answer": "quit"}]', '"answer" is a line'),
        ('[{"answer": "go", "wehn": "clear"}]', '"wehn" is unknown'),
        ('[{"answer": "go", "when": "closed"}]', "open, answered, clear"),
        ('[{"answer": "go", "reasons": "unknown_object"}]', "is a list"),
        ('[{"answer": "go", "reasons": ["ufo"]}]', "unknown_scene"),
        ('[{"answer": "go", "kind": 1}]', "call, hold"),
        ('[{"answer": "go", "times": 0}]', "counts from 1"),
        ('[{"answer": "go", "nth": true}]', "not int"),
        ('[{"answer": "go", "after": -1}]', "0 to 3600"),
        ('[{"answer": "go", "after": NaN}]', "0 to 3600"),
        ('[{"answer": "go", "holding": "yes"}]', "not bool"),
    ],
)
def test_a_wrong_table_is_refused_with_the_rule_and_the_remedy(text: str, said: str) -> None:
    with pytest.raises(ScriptError) as caught:
        Script.parse(text)
    assert said in str(caught.value)


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["answer", "when", "reasons", "nth", "times", "after", "kind", "x"]), inner
        )
    ),
    max_leaves=8,
)


@settings(max_examples=60, deadline=None)
@given(_JSON)
def test_any_json_is_a_script_or_a_clear_refusal(value: Any) -> None:
    refusal = "x"
    try:
        Script.parse(json.dumps(value))
    except ScriptError as error:
        refusal = str(error)
    assert refusal
