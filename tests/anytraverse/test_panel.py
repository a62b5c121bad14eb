"""Pictures of a judged frame."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from anytraverse.assessment import CORRIDOR, WORST_TILE, Assessment, Finding, Reason
from anytraverse.drawing import (
    ATTENTION_STOPS,
    GREEN,
    PAPER,
    SIGNED_STOPS,
    UNCERTAINTY_STOPS,
    VERMILION,
    YELLOW,
    coloured,
    ramp,
    shortened,
    text_width,
    write,
    write_png,
)
from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame, Image
from anytraverse.judged_picture import draw_state, marked_box
from anytraverse.judging import Settings
from anytraverse.memory import first_memory
from anytraverse.panel import contact_sheet, draw_panel
from anytraverse.perception.builtin.lexicon import Lexicon
from anytraverse.preferences import Preferences

WORDS = "grass: 1; dirt: 1; sky: -0.5; bush: -1; tree: -1"


def picture(height: int = 120, width: int = 160) -> Image:
    """Sky, grass and something violet in the middle."""
    image = np.empty((height, width, 3), dtype=np.uint8)
    image[: height // 3] = (150, 185, 235)
    mottle = 1 + 0.13 * np.random.default_rng(0).standard_normal((height - height // 3, width, 1))
    image[height // 3 :] = (np.asarray((84, 116, 48)) * mottle).clip(0, 255).astype(np.uint8)
    image[int(height * 0.65) : int(height * 0.9), int(width * 0.4) : int(width * 0.6)] = (150, 20, 190)
    return image


def assess(image: Image, words: str = WORDS, *, late: bool = False) -> tuple[Assessment, Settings]:
    """The judged picture and its settings; `late` makes it a fault."""
    perceiver, settings = Lexicon(), Settings()
    engine = AnyTraverse(perceiver, settings, first_memory(perceiver.model_id, Preferences.parse(words)))
    return engine.step(Frame(1, 0.0, image), 99.0 if late else 0.0), settings


@pytest.mark.parametrize("size", [(120, 160), (340, 640), (300, 200), (1, 1), (2, 600)])
def test_a_panel_shows_image_and_every_map_and_changes_nothing(size: tuple[int, int]) -> None:
    image = picture(*size)
    before = image.copy()
    assessment, settings = assess(image)
    panel = draw_panel(image, assessment, settings.region, "one picture")
    assert panel.dtype == np.uint8
    assert panel.shape[1] == 1392
    assert panel.shape[2] == 3
    np.testing.assert_array_equal(image, before)


def test_up_to_five_words_share_a_row_of_the_panel() -> None:
    image = picture()
    heights = []
    for words in (WORDS, WORDS + "; mud: 0.2"):
        assessment, settings = assess(image, words)
        heights.append(draw_panel(image, assessment, settings.region).shape[0])
    assert heights[0] < 800 < heights[1]


def test_a_panel_without_words_or_with_a_fault_is_drawn_all_the_same() -> None:
    image = picture()
    for assessment, settings in (assess(image, ""), assess(image, late=True)):
        assert draw_panel(image, assessment, settings.region).ndim == 3


def test_a_frame_that_could_not_be_judged_gets_its_tile_with_the_fault_named() -> None:
    settings = Settings()
    engine = AnyTraverse(Lexicon(), settings, first_memory("builtin-lexicon-1", Preferences.parse(WORDS)))
    fault = engine.step(Frame(1, 0.0, np.zeros((4, 4), np.uint8)), 0.0)
    assert fault.maps is None
    tile = draw_state(picture(), fault, "fault", VERMILION, region=settings.region)
    assert tile.shape == (34 + 360 + 30, 480, 3)


def test_a_state_tile_tints_drivable_ground_green_and_hatches_the_unknown() -> None:
    image = picture()
    assessment, settings = assess(image)
    tile = draw_state(image, assessment, "OK", GREEN, region=settings.region, width=160)
    shown = tile[34:-30].astype(int)
    ground, thing = np.s_[55:70, 5:40], np.s_[85:100, 70:90]
    assert shown[ground][..., 1].mean() > image[ground][..., 1].mean() + 5
    assert shown[thing][..., 1].mean() > image[thing][..., 1].mean()
    assert shown[thing].std() > 10
    assert tuple(tile[2, 2]) == GREEN


def test_the_thing_that_is_asked_about_is_shown_as_it_was_seen_with_a_line_around_it() -> None:
    image = picture(360, 480)
    assessment, settings = assess(image, "grass: 1; dirt: 1; sky: -0.5")
    marked = marked_box(assessment)
    assert marked is not None
    assert assessment.tile is not None
    assert marked == assessment.tile.shown
    shown = draw_state(image, assessment, "C1 unknown thing", region=settings.region)[34:-30]
    rows, columns = marked.slices(360, 480)
    inside = np.s_[rows.start + 4 : rows.stop - 4, columns.start + 4 : columns.stop - 4]
    np.testing.assert_array_equal(shown[inside], image[inside])
    beyond = (np.abs(shown.astype(int) - YELLOW).max(axis=2) < 80).copy()
    beyond[rows.start - 4 : rows.stop + 4, columns.start - 4 : columns.stop + 4] = False
    for side in (192, 288):  # of the thing, whose lower end is at 324
        assert beyond[250:310, side - 12 : side + 12].any(axis=1).mean() > 0.5


def test_a_corridor_closed_over_known_ground_has_no_thing_to_be_marked() -> None:
    assessment, _ = assess(picture())
    roi = assessment.roi
    assert roi is not None
    gap = replace(roi.worst_tile, uncertainty=0.9)
    closed = replace(
        assessment,
        roi=replace(roi, corridor=replace(roi.corridor, gap=gap)),
        findings=(Finding(Reason.BLOCKED, CORRIDOR, bad=True, clear=False),),
    )
    assert closed.tile is gap
    assert marked_box(closed) is None


def test_in_a_new_place_nothing_is_marked_as_long_as_no_tile_is_bad() -> None:
    assessment, _ = assess(picture())
    roi = assessment.roi
    assert roi is not None
    nearly = replace(assessment, roi=replace(roi, worst_tile=replace(roi.worst_tile, uncertainty=0.4)))
    new_place = Finding(Reason.UNKNOWN_SCENE, "scene_similarity", bad=True, clear=False)
    bad_tile = Finding(Reason.BLOCKED, WORST_TILE, bad=True, clear=False)
    assert marked_box(replace(nearly, findings=())) == roi.worst_tile.shown
    assert marked_box(replace(nearly, findings=(new_place,))) is None
    assert marked_box(replace(nearly, findings=(new_place, bad_tile))) == roi.worst_tile.shown


def test_tiles_stand_in_a_grid_on_paper() -> None:
    tile = np.full((50, 80, 3), 7, dtype=np.uint8)
    sheet = contact_sheet([tile] * 5, 3, "Five")
    assert sheet.shape == (56 + 2 * 66, 16 + 3 * 96, 3)
    assert (sheet == 7).all(axis=2).sum() >= 5 * 50 * 80
    assert (sheet[-40:, -60:] == PAPER).all()
    assert contact_sheet([tile], 4).shape[1] == 16 + 96


def test_a_sheet_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one tile"):
        contact_sheet([], 3)


def test_colour_maps_run_from_end_to_end_and_grey_out_what_is_not_finite() -> None:
    values = np.array([[-1.0, 0.0, 1.0, np.nan]], dtype=np.float32)
    colours = coloured(values, SIGNED_STOPS, -1.0, 1.0)[0]
    assert tuple(colours[0]) == SIGNED_STOPS[0]
    assert tuple(colours[2]) == SIGNED_STOPS[-1]
    assert np.ptp(colours[3].astype(int)) < 20


def test_sequential_colour_maps_change_steadily_in_lightness() -> None:
    for stops, sign in ((ATTENTION_STOPS, 1), (UNCERTAINTY_STOPS, -1)):
        lightness = ramp(stops) @ np.array([0.299, 0.587, 0.114])
        assert (np.diff(lightness) * sign > -0.6).all()
        assert abs(lightness[-1] - lightness[0]) > 150


def test_long_texts_are_cut_to_their_room() -> None:
    text = "a text much longer than the room that it has"
    assert shortened("short", 500) == "short"
    cut = shortened(text, 120)
    assert cut.endswith("...")
    assert text_width(cut) <= 120


def test_a_png_holds_the_same_colours(tmp_path: Path) -> None:
    image = picture()
    write_png(str(tmp_path / "x.png"), image)
    loaded = cv2.imread(str(tmp_path / "x.png"))
    assert loaded is not None
    np.testing.assert_array_equal(loaded[..., ::-1], image)


def test_an_opencv_without_fonts_writes_in_strokes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(cv2, "FontFace", raising=False)
    canvas = np.full((40, 300, 3), 255, dtype=np.uint8)
    write(canvas, "uncertainty 0.38 → é", (10, 25), 14)
    assert (canvas < 128).any()
    assert 20 < text_width("uncertainty") < 150
    image = picture()
    assessment, settings = assess(image)
    assert draw_panel(image, assessment, settings.region).shape[1] == 1392
