"""A proposal keeps within the wanted rate, and keeps most of what somebody named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.judging import Settings, Thresholds
from anytraverse.regions import Box
from companion.config import Config, load_config
from companion.config.schema import MountSection, StoppingSection
from companion.desk.drives.drive import DriveError
from companion.desk.tuning.proposal import (
    Candidate,
    fragment,
    grid_of,
    in_time,
    named_times,
    proposed,
    refuse_short,
    variants,
    warnings,
    weighed,
)
from companion.desk.tuning.trial import Combination, MadeCall, TrialOutcome
from companion.vision.warm_up import judging_settings, load_engine
from companion.wire.typed_answers import read_typed

REGION = Box(0.3, 0.5, 0.7, 0.9)
NOW = Combination(0.9, 0.3, 0.8, REGION)
CANDIDATES = st.lists(
    st.builds(
        Candidate,
        st.builds(
            Combination,
            st.sampled_from([0.8, 0.9]),
            st.sampled_from([0.2, 0.3]),
            st.just(0.8),
            st.just(REGION),
        ),
        st.floats(0, 20),
        st.integers(0, 5),
        st.just((0, 0)),
        st.integers(0, 3),
    ),
    min_size=1,
)


@given(CANDIDATES, st.floats(0.1, 20))
def test_none_within_the_wanted_rate_keeps_more_than_the_proposal(
    candidates: list[Candidate], wanted: float
) -> None:
    best = proposed(candidates, NOW, wanted)
    within = [one for one in candidates if one.rate <= wanted]
    if not within:
        assert best.rate == min(one.rate for one in candidates)
        return
    assert best.rate <= wanted
    assert best.kept == max(one.kept for one in within)
    assert not any(one.kept == best.kept and one.rate > best.rate for one in within)


def test_of_equal_candidates_the_one_with_the_fewest_changes_is_proposed() -> None:
    changed = Combination(0.8, 0.2, 0.8, REGION)
    candidates = [Candidate(one, 1.0, 2, (1, 1), 0) for one in (changed, NOW)]
    assert proposed(candidates, NOW, 2.0).combination == NOW


def test_a_call_near_the_time_of_a_named_thing_keeps_it() -> None:
    answers = [
        (10.0, read_typed("tap drum -1, go")),
        (30.0, read_typed("go")),
        (50.0, read_typed("gravel: 1")),
    ]
    named = named_times(answers)
    assert named == [10.0, 50.0]
    calls = [MadeCall(0, 12.9, ()), MadeCall(1, 30.0, ()), MadeCall(2, 46.9, ())]
    one = weighed(TrialOutcome(NOW, calls), named, 60.0)
    assert (one.rate, one.kept, one.halves) == (3.0, 1, (2, 1))


def test_the_grid_has_what_is_in_force_and_a_threshold_beyond_all_frames() -> None:
    settings = Settings(region=REGION, thresholds=Thresholds(roi=0.3, scene=0.9, tile=0.8))
    grid = grid_of([0.85, 0.95, 0.99], [0.1, 0.2, 0.4], [0.3, 0.5, 0.7], settings)
    assert 0.9 in grid.scene
    assert min(grid.scene) == pytest.approx(0.83)
    assert max(grid.roi) == pytest.approx(0.42)
    assert {0.8, 0.72} <= set(grid.tile)
    assert REGION in grid.regions
    none = Settings(region=REGION, thresholds=Thresholds(tile=None))
    assert grid_of([], [0.1], [0.2], none).tile == (None,)


def test_no_region_that_the_vehicle_does_not_fit_in_is_proposed() -> None:
    as_shipped = Settings(region=Box(0.333, 0.6, 0.667, 0.95))
    grid = grid_of([], [0.1], [0.2], as_shipped)
    assert Box(0.366, 0.6, 0.634, 0.95) in variants(as_shipped.region.bounds)
    assert len(grid.regions) == 4
    assert all(one.applied(as_shipped).misfit == "" for one in grid.combinations(as_shipped))


@given(st.tuples(st.floats(0, 0.9), st.floats(0, 0.9)), st.tuples(st.floats(0.05, 0.5), st.floats(0.05, 0.5)))
def test_other_regions_lie_in_the_picture(place: tuple[float, float], size: tuple[float, float]) -> None:
    box = Box(place[0], place[1], min(1.0, place[0] + size[0]), min(1.0, place[1] + size[1]))
    assert variants(box)[0] == box


@pytest.mark.slow
@pytest.mark.parametrize("tile", [None, 0.61])
def test_the_fragment_puts_the_proposal_into_force(drive: Path, tmp_path: Path, tile: float | None) -> None:
    text = (drive.parent / "companion.toml").read_text()
    config = load_config(drive.parent / "companion.toml")
    engine, _ = load_engine(config, None)
    chosen = Combination(0.87, 0.21, tile, Box(0.31, 0.5, 0.7, 0.9))
    part = fragment(chosen, Combination.of(engine.settings), ["a remark"])
    file = tmp_path / "companion.toml"
    file.write_text(text.replace("[roi]\nleft = 0.35\ntop = 0.46\nright = 0.65\nbottom = 0.95\n", "") + part)
    assert Combination.of(judging_settings(load_config(file), engine.perceiver)) == chosen


def test_a_fragment_of_what_is_in_force_changes_nothing() -> None:
    assert fragment(NOW, NOW, ["a remark"]) == "# a remark\n"


def kept_of(one: Combination, rate: float, kept: int, holds: int) -> Candidate:
    return Candidate(one, rate, kept, (0, 0), holds)


def test_what_a_proposal_loses_is_told() -> None:
    before = kept_of(NOW, 3.0, 2, 4)
    assert warnings(before, before, 2) == []
    assert warnings(before, kept_of(replace(NOW, region=Box(0.2, 0.4, 0.8, 0.9)), 9.0, 2, 5), 2) == []
    narrow = replace(NOW, region=Box(0.34, 0.5, 0.66, 0.9))
    never, silent, looser, smaller = warnings(before, kept_of(narrow, 0.0, 1, 1), 2)
    assert "never calls" in never
    assert silent.startswith("WARNING: 1 of 2 things")
    assert "1 instead of 4" in looser
    assert "region is smaller" in smaller
    (nothing,) = warnings(kept_of(NOW, 1.0, 0, 0), kept_of(NOW, 1.0, 0, 0), 2)
    assert "nothing that somebody named calls" in nothing


def test_a_drive_in_which_one_call_is_too_many_is_refused() -> None:
    refuse_short(60.0, 1.0)
    with pytest.raises(DriveError, match=r"drive of 120 s or more, or --calls-per-minute 1\.34"):
        refuse_short(45.0, 0.5)
    for seconds in (0.0, 0.1):
        with pytest.raises(DriveError, match=r"s or more$"):
            refuse_short(seconds, 60.0)


def test_what_is_seen_too_late_to_stop_is_not_proposed() -> None:
    base = Settings(region=Box(0.3, 0.5, 0.7, 0.95), thresholds=Thresholds(tile=0.4))
    now = Combination.of(base)
    near = replace(now, region=Box(0.3, 0.8, 0.7, 0.95))
    candidates = [kept_of(one, 1.0, 0, 0) for one in (now, near, replace(now, roi=0.6))]
    mounted = Config(mount=MountSection(height=0.6, tilt=15.0), stopping=StoppingSection(speed=1.0))
    assert in_time(candidates, now, base, mounted) == [candidates[0], candidates[2]]
    assert in_time(candidates, now, base, Config()) == candidates
    fast = replace(mounted, stopping=StoppingSection(speed=8.0))
    assert in_time(candidates, now, base, fast) == [candidates[0], candidates[2]]
    far = Combination(now.scene, now.roi, now.tile, Box(0.3, 0.4, 0.7, 0.95))
    assert len(in_time([*candidates, kept_of(far, 1.0, 0, 0)], now, base, fast)) == 3
