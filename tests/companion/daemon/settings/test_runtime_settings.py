import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.errors import SettingsError
from anytraverse.judging import Settings, Thresholds
from anytraverse.memory import first_memory
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from companion.config import Config
from companion.config.stopping import SMALLEST_ROI
from companion.daemon.settings.runtime import (
    RuntimeSettings,
    first_values,
    first_words,
    judging_values,
    storable_defaults,
    tuned,
)
from companion.wire.parameters import ROI, build

JUDGING = Settings(region=Box(0.333, 0.6, 0.667, 0.95), thresholds=Thresholds(roi=0.3, tile=None))
CONFIGURED = storable_defaults(Config(), JUDGING)
LISTED = {parameter.name: parameter for parameter in build((), {}, {})}
JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


def fresh(model: str = "a") -> RuntimeSettings:
    return RuntimeSettings(CONFIGURED, model)


def test_every_kept_parameter_is_listed_and_configured_within_its_range() -> None:
    assert all(LISTED[name].accepts(value) for name, value in CONFIGURED.items())


def test_what_was_set_comes_back() -> None:
    before, after = fresh(), fresh()
    before.set("AT_ROI_T", 0.5)
    before.set("AT_THR_TILE", 0.4)
    assert after.restore(before.saved()) == []
    assert after.values == {"AT_ROI_T": 0.5, "AT_THR_TILE": 0.4}
    judging, left_out = after.tuned(JUDGING)
    assert left_out == []
    assert judging_values(judging)["AT_ROI_T"] == 0.5
    assert judging.thresholds.tile == 0.4


def test_thresholds_belong_to_the_model_that_they_were_set_for() -> None:
    before, after = fresh(), fresh("b")
    before.set("AT_THR_ROI", 0.5)
    before.set("AT_THR_TRAV", 0.5)
    assert after.restore(before.saved()) == ["AT_THR_ROI: of another model, as configured"]
    assert after.values == {"AT_THR_TRAV": 0.5}


def test_sides_that_do_not_fit_an_edited_file_go_together() -> None:
    overrides = fresh()
    overrides.set("AT_ROI_L", 0.6)
    overrides.set("AT_SUM_HZ", 2.0)
    narrow = Settings(region=Box(0.2, 0.6, 0.5, 0.95))
    judging, left_out = overrides.tuned(narrow)
    assert judging == narrow
    assert left_out == ["AT_ROI_L as configured: ROI left must be < right"]
    assert overrides.values == {"AT_SUM_HZ": 2.0}


@pytest.mark.parametrize(
    "row",
    [None, [], [0.5], [0.5, 0.6, 1], ["0.5", 0.6], [True, 0.6], [math.nan, 0.6], [7, 0.6], {"a": 1}, "ab"],
)
def test_a_corrupt_entry_is_told_and_dropped_and_the_others_stay(row: Any) -> None:
    overrides = fresh()
    saved = {"model": "a", "values": {"AT_ROI_T": row, "AT_ROI_B": [0.9, 0.95], "AT_POLICY": [2, 0]}}
    assert overrides.restore(saved) == ["AT_ROI_T, AT_POLICY: unreadable, as configured"]
    assert overrides.values == {"AT_ROI_B": 0.9}


@settings(max_examples=100)
@given(
    st.dictionaries(
        st.sampled_from(["model", "values"]), JSON | st.dictionaries(st.sampled_from(list(CONFIGURED)), JSON)
    )
)
def test_no_journal_makes_it_raise_or_leave_a_range(saved: Any) -> None:
    overrides = fresh()
    overrides.restore(saved)
    overrides.tuned(JUDGING)
    assert all(LISTED[name].accepts(value) for name, value in overrides.values.items())


@settings(max_examples=150)
@given(st.dictionaries(st.sampled_from(list(ROI.values())), st.floats(0, 1), min_size=1))
def test_whatever_sides_are_set_the_region_stays_one(sides: dict[str, float]) -> None:
    try:
        box = tuned(JUDGING, sides).region.bounds
    except SettingsError:
        return
    assert box.right - box.left >= SMALLEST_ROI - 1e-5
    assert box.bottom - box.top >= SMALLEST_ROI - 1e-5
    width = 0.2 + (box.bottom - 0.6) * (0.3 - 0.2) / (0.95 - 0.6)  # the vehicle's, where it is nearest
    assert box.right - box.left >= width - 1e-5, "the vehicle fits in"


def test_before_the_perceiver_is_known_what_the_ground_set_counts_as_kept() -> None:
    before = fresh()
    for name, value in {"AT_THR_ROI": 0.5, "AT_THR_TRAV": 0.6, "AT_ROI_T": 0.5, "AT_SUM_HZ": 2.0}.items():
        before.set(name, value)
    values = first_values(Config(), before.saved())
    assert {name: values[name] for name in before.values} == before.values
    assert values["AT_BUDGET"] == Config().link.budget


def test_a_value_that_was_edited_in_the_file_since_counts_as_edited_from_the_first_moment() -> None:
    before = fresh()
    before.set("AT_THR_ROI", 0.5)
    before.set("AT_ROI_T", 0.5)
    edited = replace(
        Config(), thresholds=replace(Config().thresholds, roi=0.2), roi=replace(Config().roi, top=0.7)
    )
    values = first_values(edited, before.saved())
    assert (values["AT_THR_ROI"], values["AT_ROI_T"]) == (0.2, 0.7)


@pytest.mark.slow
@given(
    saved=JSON
    | st.fixed_dictionaries({"model": JSON, "values": st.dictionaries(st.sampled_from(sorted(LISTED)), JSON)})
)
@settings(max_examples=200)
def test_whatever_the_journal_holds_the_first_values_are_ones_that_a_parameter_takes(saved: Any) -> None:
    for name, value in first_values(Config(), saved).items():
        assert LISTED[name].accepts(value)


def test_before_the_perceiver_is_known_the_kept_words_are_in_force_and_edited_ones_win() -> None:
    configured = Preferences.parse("grass: 1; rock: -1")
    memory = first_memory("a", configured)
    memory = memory.using(memory.preferences.merged(Preferences.of({"drum": -0.5, "rock": -0.2}, 3)), {})
    config = replace(Config(), words={"grass": 1.0, "rock": -1.0}, vocabulary=("grass", "rock", "drum"))
    assert dict(first_words(config, memory)) == {"grass": 1.0, "rock": -0.2, "drum": -0.5}
    edited = replace(config, words={"grass": 0.5, "rock": -1.0})
    assert first_words(edited, memory)["grass"] == 0.5
    assert dict(first_words(config, None)) == config.words
