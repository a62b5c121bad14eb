"""Each figure against its threshold, and the margin by which it must turn good again."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from anytraverse.assessment import CORRIDOR, Assessment, Finding, Maps, Reason
from anytraverse.errors import SettingsError
from anytraverse.findings import find, make_maps, roi_figures
from anytraverse.judging import Settings, Thresholds
from anytraverse.perception import DefaultThresholds
from anytraverse.regions import Box
from anytraverse.roi import Corridor

if TYPE_CHECKING:
    from tests.anytraverse.conftest import Rover

WHOLE = Settings(region=Box(0, 0, 1, 1), corridor=Corridor(0.5, 0.5))


def painted(rows: list[str], **words: float) -> Maps:
    """Maps of a 1-letter-a-pixel painting: capital letters are sure, small ones half as sure."""
    attention = np.array(
        [
            [[{word: 1.0, word.lower(): 0.49}.get(pixel, 0.0) for pixel in row] for row in rows]
            for word in words
        ],
        dtype=np.float32,
    )
    maps = make_maps(attention, list(words.values()), WHOLE)
    assert isinstance(maps, Maps)
    return maps


def findings(maps: Maps, settings: Settings, similarity: float | None = None) -> dict[str, Finding]:
    """Findings by their figure; the corridor's for want of evidence is "evidence"."""
    roi = roi_figures(maps, 1.0, settings)
    assert not isinstance(roi, Finding)
    found = find(roi, len(maps.attention), similarity, settings)
    for one in found:
        if (one.figure, one.reason) == (CORRIDOR, Reason.UNKNOWN_OBJECT):
            found[found.index(one)] = replace(one, figure="evidence")
    return {finding.figure: finding for finding in found}


@pytest.mark.parametrize(
    ("thing", "blocked", "unknown"),
    [
        (["DD", "dd"], True, False),
        (["DG", "dG"], False, False),
        (["dd", "dd"], False, True),
        (["GG", "GG"], False, False),
        (["?D", "?G"], True, False),
        (["?D", "??"], False, True),
    ],
)
def test_what_was_unknown_until_it_was_named_holds_as_before_though_the_corridor_is_open(
    thing: list[str], blocked: bool, unknown: bool
) -> None:
    found = findings_of_a_thing(thing)
    assert not found["corridor"].bad
    assert (found["named_tile"].bad, found["worst_tile"].bad) == (blocked, unknown)


@pytest.mark.parametrize(("beside", "blocked"), [("D", True), ("G", False), ("?", False)])
def test_a_named_thing_blocks_also_beside_one_that_has_no_name(beside: str, blocked: bool) -> None:
    found = findings_of_a_thing([f"??{beside * 2}"] * 2)
    assert found["worst_tile"].bad
    named = found["named_tile"]
    assert (named.bad, named.reason is Reason.BLOCKED) == (blocked, blocked)
    assert named.clear is not blocked, "what is said already is not in the way of a reason's end"


@pytest.mark.parametrize(
    ("soft", "reason"),
    [
        (0.0, Reason.UNKNOWN_OBJECT),
        (0.1, Reason.UNKNOWN_OBJECT),
        (0.3, Reason.BLOCKED),
        (1.0, Reason.BLOCKED),
    ],
)
def test_a_name_that_explains_hardly_anything_of_a_strange_tile_names_nothing(
    soft: float, reason: Reason
) -> None:
    found = findings_of_a_thing(["??", "??"], tile=0.95, drum=soft)
    assert found["named_tile"].reason is reason
    assert found["named_tile"].bad is not found["worst_tile"].bad


def findings_of_a_thing(thing: list[str], tile: float = 0.5, drum: float = 0.0) -> dict[str, Finding]:
    """Findings where a strange thing of one tile stands on the ground G; drum: how far "?" looks like D."""
    settings = replace(WHOLE, thresholds=Thresholds(roi=1.0, tile=tile, trav=0.0))
    rows = [("GG" + row).ljust(8, "G") for row in ["GG", "GG", *thing, "GG", "GG", "GG", "GG"]]
    attention = painted(rows, G=1.0, D=-1.0).attention.copy()
    attention[1][[[pixel == "?" for pixel in row] for row in rows]] = drum
    assert "named_tile" not in findings(_maps(attention, settings, 1.0), settings), "all is drivable"
    return findings(_maps(attention, settings, -1.0), settings)


def _maps(attention: Any, settings: Settings, weight: float) -> Maps:
    maps = make_maps(attention, [1.0, weight], settings)
    assert isinstance(maps, Maps)
    return maps


@pytest.mark.parametrize(
    ("value", "bad", "clear"),
    [
        (0.31, True, False),
        (0.3, False, False),
        (0.28, False, False),
        (0.27, False, True),
        (math.nan, True, False),
    ],
)
def test_above_its_threshold_a_figure_is_bad_and_below_the_margin_clear(
    value: float, bad: bool, clear: bool
) -> None:
    finding = Finding.above(Reason.UNKNOWN_OBJECT, "roi_uncertainty", value, 0.3, 0.03)
    assert (finding.bad, finding.clear) == (bad, clear)


@pytest.mark.parametrize(
    ("value", "bad", "clear"),
    [(0.84, True, False), (0.85, False, False), (0.86, False, True), (math.nan, True, False)],
)
def test_below_its_threshold_a_figure_is_bad_and_above_the_margin_clear(
    value: float, bad: bool, clear: bool
) -> None:
    finding = Finding.below(Reason.UNKNOWN_SCENE, "scene_similarity", value, 0.85, 0.01)
    assert (finding.bad, finding.clear) == (bad, clear)


def test_the_worst_tile_has_a_threshold_of_its_own() -> None:
    maps = painted(["GGGGGGGG"] * 7 + ["GGGGGGG?"], G=1)
    mean_alone = replace(WHOLE, tile_share=1 / 8)
    found = findings(maps, mean_alone)
    assert not found["roi_uncertainty"].bad
    assert "worst_tile" not in found
    with_tile = replace(mean_alone, thresholds=Thresholds(tile=0.6))
    assert findings(maps, with_tile)["worst_tile"].bad
    assert findings(maps, with_tile)["worst_tile"].reason is Reason.UNKNOWN_OBJECT


def test_blocked_is_judged_only_over_pixels_that_a_word_explains() -> None:
    maps = painted(["GGRR", "rrrr", "????"], G=1, R=-1)
    found = findings(maps, WHOLE)
    assert found["drivable_share"].value == 0.5
    assert not found["drivable_share"].bad
    assert findings(painted(["GRRR", "????"], G=1, R=-1), WHOLE)["drivable_share"].bad


def test_where_nothing_is_known_nothing_is_blocked_but_unknown() -> None:
    found = findings(painted(["gg", "??"], G=1), WHOLE)
    assert "drivable_share" not in found
    assert (found["corridor"].bad, found["evidence"].bad) == (False, True)
    assert found["roi_uncertainty"].bad


def test_a_wall_is_blocked_though_most_ground_is_drivable() -> None:
    maps = painted(["GGGG"] * 5 + ["RRRR"] + ["GGGG"] * 5, G=1, R=-1)
    found = findings(maps, WHOLE)
    assert found["corridor"].bad
    assert found["corridor"].reason is Reason.BLOCKED
    assert not found["drivable_share"].bad


def test_a_corridor_is_clear_only_with_room_to_spare() -> None:
    settings = replace(WHOLE, thresholds=Thresholds(roi=0.9))
    just = findings(painted(["GGGGGGGGGGRRRRRRRRRR"] * 3, G=1, R=-1), settings)["corridor"]
    roomy = findings(painted(["GGGGGGGGGGGGRRRRRRRR"] * 3, G=1, R=-1), settings)["corridor"]
    assert (just.bad, roomy.bad) == (False, False)
    assert roomy.clear
    narrow = findings(painted(["GGGGGGGRRRRRRRRRRRRR"] * 3, G=1, R=-1), settings)["corridor"]
    assert (narrow.bad, narrow.clear) == (True, False)


def test_half_sure_explains() -> None:
    attention = np.array([[[0.5, 0.499]]], dtype=np.float32)
    maps = make_maps(attention, [1.0], WHOLE)
    assert isinstance(maps, Maps)
    assert maps.known.tolist() == [[True, False]]


def test_a_word_of_no_weight_explains_but_is_not_drivable() -> None:
    maps = painted(["MM"], M=0)
    assert maps.known.all()
    assert maps.not_drivable.all()
    assert not maps.drivable.any()


def test_the_figures_of_the_roi() -> None:
    maps = painted(["GGR?", "ggRR"], G=0.5, R=-1)
    roi = roi_figures(maps, 1.0, WHOLE)
    assert not isinstance(roi, Finding)
    assert roi.uncertainty == pytest.approx((1 + 0.51 * 2) / 8)
    assert roi.traversability == pytest.approx((0.5 * 2 + 0.245 * 2) / 8)
    assert roi.known_share == 5 / 8
    assert roi.drivable_share == 2 / 5
    assert not roi.corridor.open
    assert roi.strangeness == pytest.approx((1 + 0.51 * 2 + 3) / 8)


def test_without_a_reference_the_scene_is_not_judged() -> None:
    assert "scene_similarity" not in findings(painted(["G"], G=1), WHOLE, None)
    assert findings(painted(["G"], G=1), WHOLE, 0.5)["scene_similarity"].bad


def test_all_reasons_of_a_frame_are_told(rover: Rover) -> None:
    seen: Assessment = rover.see(90, "rock", "drum", captured_at=0.0)
    assert seen.reasons == set(Reason)
    for reason in Reason:
        finding = seen.finding(reason)
        assert finding is not None
        assert finding.reason is reason


def test_a_perceivers_own_thresholds() -> None:
    assert Thresholds.of(DefaultThresholds(0.2, 0.9, 0.5)) == Thresholds(roi=0.2, scene=0.9, tile=0.5)


@pytest.mark.parametrize(
    "wrong",
    [
        {"roi": 0.0},
        {"roi": math.nan},
        {"scene": 1.1},
        {"tile": -0.1},
        {"trav": math.nan},
        {"trav": 1.01},
        {"roi": 1.01},
        {"tile": 0.0},
        {"tile": 1.01},
        {"margin": -0.01},
        {"margin": 1.01},
        {"similarity_margin": math.inf},
    ],
)
def test_a_threshold_out_of_range_is_refused_by_name(wrong: dict[str, float]) -> None:
    [name] = wrong
    with pytest.raises(SettingsError, match=f"^{name} is "):
        Thresholds(**wrong)  # type: ignore[arg-type]


def test_the_starting_numbers() -> None:
    start = Settings()
    assert start.thresholds == Thresholds(0.3, 0.85, None, 0.4, margin=0.03, similarity_margin=0.01)
    assert (start.votes, start.window, start.tile_share, start.freshness) == (2, 3, 0.25, 1.0)
    assert start.region == Box(1 / 3, 0.6, 2 / 3, 0.95)
    assert start.misfit == ""


def test_the_ends_of_each_range_can_be_used() -> None:
    Thresholds(roi=1, scene=1, tile=1, trav=1, margin=1, similarity_margin=1)
    lowest = Thresholds(scene=-1, trav=0, margin=0, similarity_margin=0)
    Settings(thresholds=lowest, tile_share=1, tile_width=1, votes=3, window=3)


@pytest.mark.parametrize(
    "wrong",
    [
        {"tile_share": 0.0},
        {"tile_width": 0.0},
        {"tile_width": 1.1},
        {"tile_width": math.nan},
        {"freshness": 0.0},
        {"freshness": math.inf},
        {"votes": 0},
        {"votes": 4},
        {"pooling": "mean"},
        {"uncertainty": "mean"},
    ],
)
def test_a_setting_out_of_range_is_refused_by_name(wrong: dict[str, Any]) -> None:
    [name] = wrong
    with pytest.raises(SettingsError, match=f"^{name} is "):
        Settings(**wrong)


def test_the_tiles_of_a_perceiver_go_with_its_threshold() -> None:
    own = DefaultThresholds(0.2, 0.7, 0.9, tile_share=0.08)
    assert Settings.of(own) == Settings(thresholds=Thresholds.of(own), tile_share=0.08)
    assert Settings.of(own).tile_side == 0.08


@pytest.mark.parametrize(
    ("width", "own", "side"), [(0.05, 0.08, 0.1), (0.01, 0.08, 0.08), (0.4, 0.08, 0.25), (0.05, 0.5, 0.5)]
)
def test_a_tile_whose_width_is_known_has_it_between_the_perceivers_own_and_a_quarter(
    width: float, own: float, side: float
) -> None:
    half = Settings(region=Box(0.25, 0, 0.75, 1), tile_share=own, tile_width=width)
    assert half.tile_side == pytest.approx(side)


@pytest.mark.parametrize("share", [0.25, 0.12, 0.08])
def test_a_hole_smaller_than_a_gap_leaves_the_corridor_open_however_small_tiles_are(share: float) -> None:
    attention = np.ones((1, 40, 64), dtype=np.float32)
    attention[0, 28:30, 31:33] = 0.0
    settings = replace(Settings(), tile_share=share, corridor=Corridor(0.3, 0.2))
    maps = make_maps(attention, [1.0], settings)
    assert isinstance(maps, Maps)
    roi = roi_figures(maps, 1.6, settings)
    assert not isinstance(roi, Finding)
    assert roi.corridor.open
    assert roi.worst_tile.uncertainty == pytest.approx({0.25: 4 / 25, 0.12: 4 / 9, 0.08: 1.0}[share])
    closing = replace(settings, corridor=replace(settings.corridor, gap=0.08))
    closed = roi_figures(maps, 1.6, closing)
    assert not isinstance(closed, Finding)
    assert not closed.corridor.open


@pytest.mark.parametrize("share", [0.05, 0.08, 0.2, 0.25, 0.5])
@pytest.mark.parametrize("at", [(24, 22), (24, 40), (36, 22), (36, 40), (30, 31)])
def test_around_a_small_tile_a_square_of_a_quarter_of_the_roi_is_shown(
    share: float, at: tuple[int, int]
) -> None:
    attention = np.ones((1, 40, 64), dtype=np.float32)
    attention[0, at[0] : at[0] + 2, at[1] : at[1] + 2] = 0.0
    settings = Settings(tile_share=share)
    maps = make_maps(attention, [1.0], settings)
    assert isinstance(maps, Maps)
    roi = roi_figures(maps, 1.6, settings)
    assert not isinstance(roi, Finding)
    tile, shown = roi.worst_tile.box, roi.worst_tile.shown
    assert (roi.worst_tile.around is None) == (share >= 0.25)
    assert shown.left <= tile.left < tile.right <= shown.right
    assert shown.top <= tile.top < tile.bottom <= shown.bottom
    if share < 0.25:
        assert shown.right - shown.left >= 0.25 / 3 - 1e-9
        assert shown.bottom - shown.top >= 0.25 / 3 * 1.6 - 1e-9
        bounds, cell = settings.region.bounds, 1 / 40
        assert bounds.left - cell <= shown.left < shown.right <= bounds.right + cell
        assert bounds.top - cell <= shown.top < shown.bottom <= bounds.bottom + cell


@pytest.mark.parametrize(
    ("region", "top_row", "why"),
    [
        (Box(0.46, 0.6, 0.54, 0.95), 0.6, "ROI 0.08 wide, vehicle 0.30: widen it"),
        (Box(0.35, 0.6, 0.65, 1.0), 0.6, "ROI 0.30 wide, vehicle 0.32: widen it"),
        (Box(0.2, 0.05, 0.8, 0.95), 2 / 3, "ROI reaches the horizon 0.10: shorten it"),
    ],
)
def test_a_region_that_the_vehicle_does_not_fit_in_is_refused_and_closed_where_it_is_asked_for(
    region: Box, top_row: float, why: str
) -> None:
    corridor = Corridor(0.3, 0.2, top_row=top_row)
    with pytest.raises(SettingsError, match=re.escape(why)):
        Settings(region=region, corridor=corridor)
    asked = Settings(region=region, corridor=corridor, misfit_allowed=True)
    roi = roi_figures(painted(["G" * 40] * 40, G=1), 1.0, asked)
    assert not isinstance(roi, Finding)
    assert not roi.corridor.passable
    assert findings(painted(["G" * 40] * 40, G=1), asked)["corridor"].bad
