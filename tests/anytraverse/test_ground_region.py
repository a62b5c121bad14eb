"""The region of interest in metres: where it lies in a frame, its tiles, and what is judged in it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.assessment import Finding, Maps, Reason
from anytraverse.engine import AnyTraverse
from anytraverse.errors import SettingsError
from anytraverse.findings import is_open, roi_figures
from anytraverse.frame import Frame
from anytraverse.ground import RELIABLE, STEEPEST, GroundCamera, GroundRegion
from anytraverse.judging import Settings
from anytraverse.memory import first_memory
from anytraverse.perception import make_perceiver
from anytraverse.preferences import Preferences
from anytraverse.regions import Box, Quad, TileScale
from anytraverse.roi import RoiFigures, worst_tile

CAMERA = GroundCamera.pinhole(1.0, 7.0, 75.0, 4 / 3, front=0.3)
GROUND = GroundRegion(CAMERA, near=1.5, far=4.5, width=1.4, vehicle=0.6)
ROWS, COLUMNS = 96, 128
LEANS = st.tuples(st.floats(-45, 45), st.floats(-45, 45))


def judging(ground: GroundRegion = GROUND) -> Settings:
    return Settings(ground=ground, region=ground.in_picture(None).region.bounds)


def points(lean: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """Where the pixels of a map meet the ground, (rows, columns, 2) in m."""
    x, y = np.meshgrid((np.arange(COLUMNS) + 0.5) / COLUMNS, (np.arange(ROWS) + 0.5) / ROWS)
    found = CAMERA.leaning(*lean).to_ground(np.column_stack([x.ravel(), y.ravel()]))
    return found.reshape(ROWS, COLUMNS, 2)


def maps(unknown: np.ndarray) -> Maps:
    """Drivable ground, but for what is unknown."""
    uncertainty = np.where(unknown, 0.9, 0.05).astype(np.float32)
    signed = (1.0 - uncertainty).astype(np.float32)
    return Maps(
        (1.0 - uncertainty)[np.newaxis],
        signed,
        uncertainty,
        uncertainty,
        ~unknown,
        np.zeros(1, bool),
        ~unknown,
    )


def standing(ahead: float, left: float, side: float, lean: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """The pixels of an upright square thing `side` m wide whose foot is there, (rows, columns)."""
    camera = CAMERA.leaning(*lean)
    feet = camera.to_picture(np.array([[ahead, left + side / 2], [ahead, left - side / 2]]))
    (x0, y0), (x1, y1) = feet
    foot, wide = (y0 + y1) / 2, x1 - x0
    shown = np.zeros((ROWS, COLUMNS), bool)
    rows, columns = Box(*np.clip([x0, foot - wide * 4 / 3, x1, foot], 0.0, 1.0)).slices(ROWS, COLUMNS)
    shown[rows, columns] = True
    return shown


@pytest.mark.parametrize("lean", [(0.0, 0.0), (3.0, 0.0), (-2.0, 4.0), (1.0, -6.0)])
def test_it_holds_the_pixels_whose_ground_is_in_it_however_the_vehicle_leans(
    lean: tuple[float, float],
) -> None:
    x, y = points(lean)[..., 0] - CAMERA.front, points(lean)[..., 1]
    inside = (x > GROUND.near) & (x < GROUND.far) & (np.abs(y) < GROUND.width / 2)
    assert inside.sum() > 300
    mask = judging().at(lean).region.mask(ROWS, COLUMNS)
    nearer = mask & ~(x >= GROUND.far)
    np.testing.assert_array_equal(nearer, inside)
    if lean[0] <= 0.0:
        np.testing.assert_array_equal(mask, inside)


def test_a_nose_that_goes_down_raises_all_of_it_and_one_that_goes_up_lowers_but_its_near_side() -> None:
    level, up, down = (judging().at((pitch, 0.0)).region.bounds for pitch in (0.0, 3.0, -3.0))
    assert down.top < level.top - 0.03
    assert down.bottom < level.bottom - 0.03
    assert up.bottom > level.bottom + 0.03
    assert up.top == pytest.approx(level.top), "the first metres of a climb look like a swing"


@pytest.mark.parametrize("shape", [(48, 64), (96, 128), (240, 320)])
def test_over_drivable_ground_the_way_is_open_however_the_vehicle_swings(shape: tuple[int, int]) -> None:
    camera = GroundCamera.pinhole(0.8, 10.0, 75.0, 4 / 3, front=0.3)
    ground = GroundRegion(camera, camera.nearest(1.2), 3.5, 1.2, 0.6)
    drivable = np.ones(shape, np.bool_)
    for lean in [(pitch, bank) for pitch in (-3.0, 0.0, 3.0) for bank in (-4.0, -1.0, 0.5, 2.0, 4.0)]:
        assert is_open(drivable, 4 / 3, judging(ground).at(lean)), lean


def test_a_wall_across_the_way_closes_it_however_the_vehicle_swings() -> None:
    for lean in [(pitch, bank) for pitch in (-3.0, 0.0, 3.0) for bank in (-4.0, -1.0, 0.5, 2.0, 4.0)]:
        x, y = points(lean)[..., 0] - CAMERA.front, points(lean)[..., 1]
        wall = (x > 2.6) & (x < 3.6) & (np.abs(y) < 0.8)
        assert not is_open(~wall, 4 / 3, judging().at(lean)), lean


def test_without_a_region_in_metres_a_frame_is_judged_by_the_settings_themselves() -> None:
    plain = Settings()
    assert plain.at((3.0, 1.0)) is plain
    assert judging().at(None) == judging().at((0.0, 0.0))


def test_the_corridor_is_as_wide_as_the_vehicle_on_the_ground() -> None:
    seen = judging().at((2.0, 0.0))
    camera = CAMERA.leaning(2.0, 0.0)
    for ahead in (GROUND.near, GROUND.far):
        (x0, y0), (x1, _) = camera.to_picture(np.array([[ahead + 0.3, 0.3], [ahead + 0.3, -0.3]]))
        corridor = seen.corridor
        slope = (corridor.bottom - corridor.top) / (corridor.bottom_row - corridor.top_row)
        assert corridor.bottom + slope * (y0 - corridor.bottom_row) == pytest.approx(x1 - x0)


@pytest.mark.parametrize("ahead", [2.3, 3.0, 4.0])
@pytest.mark.parametrize("lean", [(0.0, 0.0), (-3.0, 2.0)])
def test_a_thing_as_large_as_a_tile_fills_it_at_every_distance(
    ahead: float, lean: tuple[float, float]
) -> None:
    roi = roi_figures(maps(standing(ahead + 0.3, 0.1, 0.4, lean)), 4 / 3, judging().at(lean))
    assert isinstance(roi, RoiFigures)
    assert roi.worst_tile.uncertainty > 0.65
    x, foot = CAMERA.leaning(*lean).to_picture(np.array([[ahead + 0.3, 0.1]]))[0]
    assert roi.worst_tile.box.centre[0] == pytest.approx(x, abs=0.03)
    assert roi.worst_tile.box.bottom == pytest.approx(foot, abs=0.05)


def test_a_thing_beyond_the_region_or_beside_it_is_in_no_tile() -> None:
    for ahead, left in ((GROUND.far + 1.0, 0.0), (3.0, 1.2)):
        shown = standing(ahead + 0.3, left, 0.4)
        roi = roi_figures(maps(shown), 4 / 3, judging().at(None))
        assert isinstance(roi, RoiFigures)
        assert roi.worst_tile.uncertainty < 0.3


def test_a_thing_across_the_way_closes_the_corridor_and_one_beside_it_does_not() -> None:
    for left, free in ((0.0, False), (0.65, True)):
        roi = roi_figures(maps(standing(3.3, left, 0.5)), 4 / 3, judging().at(None))
        assert isinstance(roi, RoiFigures)
        assert roi.corridor.open is free


@given(LEANS)
@settings(max_examples=80, deadline=None)
def test_however_it_leans_there_are_figures_or_a_fault(lean: tuple[float, float]) -> None:
    seen = judging().at(lean)
    roi = roi_figures(maps(np.zeros((48, 64), bool)), 4 / 3, seen)
    visible = bool(seen.region.mask(48, 64).any())
    assert isinstance(roi, RoiFigures if visible else Finding)


def test_a_region_that_is_out_of_the_picture_is_a_fault() -> None:
    seen = judging().at((45.0, 0.0))
    roi = roi_figures(maps(np.zeros((48, 64), bool)), 4 / 3, seen)
    assert isinstance(roi, Finding)
    assert "holds no pixel" in roi.figure


@given(st.integers(0, 2**32 - 1), st.floats(-0.5, 0.6), st.floats(0.02, 0.9))
@settings(max_examples=60, deadline=None)
def test_the_worst_tile_is_the_worst_of_all_windows(seed: int, horizon: float, slope: float) -> None:
    rng = np.random.default_rng(seed)
    values = rng.random((12, 16)).astype(np.float32)
    region = Quad(((0.3, 0.3), (0.7, 0.3), (0.9, 0.95), (0.1, 0.95)))
    tiles, inside = TileScale(horizon, slope), region.mask(12, 16)
    found = worst_tile(values, region, 4 / 3, tiles)
    rows, columns = region.bounds.slices(12, 16)
    best = -1.0
    for foot in range(rows.start, rows.stop):
        side = tiles.side((foot + 1) / 12)
        wide = min(max(1, round(side * 16)), columns.stop - columns.start)
        top = max(rows.start, foot + 1 - max(1, round(side * 4 / 3 * 12)))
        for left in range(columns.start, columns.stop - wide + 1):
            window = np.s_[top : foot + 1, left : left + wide]
            if inside[window].mean() >= 0.5:
                best = max(best, float(values[window][inside[window]].mean()))
    assert found is not None
    assert found.uncertainty == pytest.approx(best, abs=1e-5)


def test_a_pixel_that_is_not_a_number_makes_the_worst_tile_none() -> None:
    values = np.zeros((48, 64), np.float32)
    region = judging().at(None).region
    row, column = (int(at[0]) for at in np.nonzero(region.mask(48, 64)))
    values[row, column] = math.nan
    found = worst_tile(values, region, 4 / 3, judging().at(None).tile)
    assert found is not None
    assert math.isnan(found.uncertainty)


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ({"near": 4.5}, "holds no ground"),
        ({"near": math.inf}, "holds no ground"),
        ({"far": math.nan}, "holds no ground"),
        ({"width": 0.5}, "widen it"),
        ({"vehicle": 0.0}, "widen it"),
        ({"far": RELIABLE}, "the ground is known to 5.7"),
        ({"tile": 0.0}, "holds nothing"),
    ],
)
def test_a_region_that_cannot_be_is_refused(wrong: dict[str, float], why: str) -> None:
    figures = {"near": 1.5, "far": 4.5, "width": 1.4, "vehicle": 0.6, **wrong}
    with pytest.raises(SettingsError, match=why):
        GroundRegion(CAMERA, **figures)


def test_the_nearest_ground_of_a_width_is_all_in_the_picture() -> None:
    near = CAMERA.nearest(1.4) + CAMERA.front
    for x, inside in ((near + 0.01, True), (near - 0.1, False)):
        seen = CAMERA.to_picture(np.array([[x, 0.7], [x, -0.7]]))
        assert bool(((seen >= 0.0) & (seen <= 1.0)).all()) is inside
    assert GroundCamera.pinhole(1.0, -60.0, 40.0, 4 / 3).nearest(1.0) == math.inf


def test_a_box_and_a_quad_of_its_corners_are_the_same_region() -> None:
    box = Box(0.21, 0.33, 0.77, 0.92)
    quad = Quad(box.corners)
    assert quad.bounds == box
    np.testing.assert_array_equal(quad.mask(48, 64), box.mask(48, 64))


def test_a_frame_of_a_vehicle_that_leans_too_far_is_a_fault_and_one_that_leans_a_little_is_not() -> None:
    perceiver = make_perceiver("builtin:lexicon")
    engine = AnyTraverse(
        perceiver, judging(), first_memory(perceiver.model_id, Preferences.parse("grass: 1; trail: 1"))
    )
    image = np.full((48, 64, 3), (90, 120, 60), np.uint8)
    for number, (lean, faulty) in enumerate([((STEEPEST - 1, 0.0), False), ((0.0, STEEPEST + 1), True)], 1):
        seen = engine.step(Frame(number, 0.0, image, lean=lean), 0.0)
        assert (Reason.FAULT in seen.reasons) is faulty
    assert "leans by 13 degrees" in next(one.figure for one in seen.bad if one.reason is Reason.FAULT)


@given(reach=st.floats(0.01, 20.0), lean=LEANS | st.none())
def test_a_reach_never_makes_the_region_shorter(reach: float, lean: tuple[float, float] | None) -> None:
    configured, reached = judging().at(lean), judging().at(lean, reach)
    if reach <= GROUND.far:
        assert reached == configured
    elif lean is None:
        assert reached.region.bounds.top < configured.region.bounds.top
    further = GroundRegion(CAMERA, 1.5, min(max(reach, 4.5), RELIABLE - 0.3), 1.4, 0.6)
    assert reached == judging(further).at(lean)


def test_a_region_in_fractions_has_no_reach() -> None:
    assert Settings().at(None, 5.0) == Settings()
