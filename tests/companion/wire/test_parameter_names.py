import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.wire import parameters
from companion.wire.parameters import Parameter, ParameterError, build, word_parameter


def names(listed: tuple[Parameter, ...]) -> list[str]:
    return [entry.name for entry in listed]


def test_the_list_holds_the_settings_and_a_weight_for_every_configured_word() -> None:
    listed = build(["dirt path", "bush"], {"bush": -1.0}, {"AT_THR_ROI": 0.25})
    assert names(listed) == [
        "AT_THR_ROI",
        "AT_THR_SCENE",
        "AT_THR_TILE",
        "AT_THR_TRAV",
        "AT_POLICY",
        "AT_W_DIRT_PATH",
        "AT_W_BUSH",
        "AT_SHD_HOLDS",
        "AT_SHD_HOURS",
        "AT_SHD_SCENE",
        "AT_SHD_OBJECT",
        "AT_SHD_BLOCKED",
        "AT_SHD_FAULT",
        "AT_ROI_L",
        "AT_ROI_T",
        "AT_ROI_R",
        "AT_ROI_B",
        "AT_SUM_HZ",
        "AT_NUM_HZ",
        "AT_BUDGET",
        "AT_ANSWER",
        "AT_TAP_WORD",
    ]
    assert [entry.value for entry in listed if entry.word] == [-2.0, -1.0]
    assert listed[0].value == 0.25


def test_words_become_upper_case_letters_digits_and_underscores() -> None:
    assert word_parameter("dry grass") == "AT_W_DRY_GRASS"
    assert word_parameter("Böschung") == "AT_W_BOSCHUNG"
    assert word_parameter("very long-grown hedge") == "AT_W_VERY_LONG_G"


def test_words_with_one_name_are_refused_by_both_names() -> None:
    with pytest.raises(ParameterError, match=r'"gravel road left" and "gravel road right".*alias'):
        build(["gravel road left", "gravel road right"], {}, {})


def test_an_alias_parts_them() -> None:
    listed = build(
        ["gravel road left", "gravel road right"], {}, {}, aliases={"gravel road right": "GRAVEL_R"}
    )
    assert names(listed)[5:7] == ["AT_W_GRAVEL_ROAD", "AT_W_GRAVEL_R"]


@pytest.mark.parametrize(
    ("word", "alias"), [("草", None), ("grass", "TOO_LONG_ALIAS"), ("grass", "a b"), ("", None)]
)
def test_a_word_without_a_usable_name_is_refused(word: str, alias: str | None) -> None:
    with pytest.raises(ParameterError, match="alias of 1 to 11 characters"):
        word_parameter(word, alias)


def test_more_words_than_fit_are_refused() -> None:
    with pytest.raises(ParameterError, match="25 words"):
        build([f"word {number}" for number in range(25)], {}, {})


def test_a_weight_of_a_word_that_is_not_configured_is_refused() -> None:
    with pytest.raises(ParameterError, match='"mud" is not in the configured vocabulary'):
        build(["grass"], {"mud": -1.0}, {})


@pytest.mark.parametrize("value", [1.5, -1.5, math.nan, math.inf])
def test_a_weight_out_of_range_is_refused_with_the_range(value: float) -> None:
    with pytest.raises(ParameterError, match=r"AT_W_GRASS.*-1 to 1 or -2"):
        build(["grass"], {"grass": value}, {})


def test_a_setting_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ParameterError, match="AT_THR_RIO"):
        build([], {}, {"AT_THR_RIO": 0.5})


def test_the_policy_is_a_whole_number() -> None:
    policy = next(entry for entry in build([], {}, {}) if entry.name == parameters.POLICY)
    assert [value for value in (0, 0.5, 1, 3, 4, 5) if policy.accepts(value)] == [0, 1, 3, 4]


@given(st.lists(st.text(max_size=30), max_size=24, unique=True))
def test_every_vocabulary_gives_distinct_wire_names_or_is_refused(vocabulary: list[str]) -> None:
    try:
        listed = build(vocabulary, {}, {})
    except ParameterError:
        return
    assert len(set(names(listed))) == len(listed) <= parameters.MAX_PARAMETERS
    assert all(
        len(entry.name) <= 16 and entry.name.isascii() and entry.name.startswith("AT_") for entry in listed
    )
