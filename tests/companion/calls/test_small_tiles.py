"""Tiles far smaller than the things: what is accepted, followed, blocked and told stays the whole thing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from anytraverse.assessment import Reason
from anytraverse.history import Place
from anytraverse.judged_picture import draw_state, figures
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from anytraverse.roi import Tile
from companion.calls.summary import current_data, recorded
from companion.vision.pictures import thumbnail
from companion.wire import texts
from companion.wire.call_report import FIGURES_MEMBERS
from companion.wire.ids import Policy
from tests.companion.calls.scenes import AHEAD, AUTO, BESIDE, DRUM, GNOME, HOLD, Scene, Thing, View

QUICK = tuple(View((Thing(Box(0.40, 0.62 + 0.1 * step, 0.52, 0.74 + 0.1 * step)),)) for step in range(3))
"""A drum that comes nearer by a third of its ROI's width in a frame."""


@pytest.fixture
def small() -> Scene:
    """Driving in AUTO over a clear trail, allowed to hold, with tiles of 2 x 2 cells."""
    scene = Scene(Policy.HOLD, tile=0.9)
    scene.numbers.judging = replace(scene.numbers.judging, tile_share=0.08)
    scene.run(1.0)
    return scene


def test_one_go_passes_a_thing_of_many_tiles(small: Scene) -> None:
    small.run(1.0, DRUM)
    assert small.held() == [{Reason.UNKNOWN_OBJECT}]
    small.go()
    small.run(4.0)
    assert (small.autopilot.mode, small.opened()) == (AUTO, [1])


def test_an_accepted_thing_is_followed_though_it_comes_nearer_by_more_than_a_tile_a_frame(
    small: Scene,
) -> None:
    small.run(1.0, QUICK[0])
    small.go()
    small.run(2.0)
    small.show(*QUICK)
    small.run(1.0)
    assert (small.autopilot.mode, small.opened()) == (AUTO, [1])


RIGHT_BEFORE_IT = tuple(
    View((Thing(box),))
    for box in (Box(0.44, 0.48, 0.52, 0.55), Box(0.43, 0.49, 0.53, 0.73), Box(0.42, 0.50, 0.54, 0.95))
)
"""A drum right before the rover, whose foot comes down by half of the ROI's width in a frame."""
FOOT = Box(26 / 60, 33 / 40, 28 / 60, 34 / 40)
"""Two cells below the drum of `DRUM`, one cell away from it."""


def test_an_accepted_thing_right_before_the_rover_is_followed_to_its_foot(small: Scene) -> None:
    small.numbers.judging = replace(small.numbers.judging, region=Box(0.35, 0.46, 0.65, 0.95))
    small.run(1.0, RIGHT_BEFORE_IT[0])
    small.go()
    small.run(2.0)
    small.show(*RIGHT_BEFORE_IT)
    small.run(1.0)
    assert (small.autopilot.mode, small.opened()) == (AUTO, [1])


@pytest.mark.parametrize("human", [False, True], ids=["after a go", "taken over"])
def test_a_spot_at_the_foot_of_the_accepted_thing_belongs_to_it(small: Scene, human: bool) -> None:
    small.run(1.0, DRUM)
    if human:
        small.human(AUTO)
    else:
        small.go()
    small.run(2.0)
    small.run(1.0, View((Thing(AHEAD), Thing(FOOT))))
    assert (small.autopilot.mode, small.opened()) == (AUTO, [1])


def test_a_go_to_one_thing_accepts_no_second_one_beside_it(small: Scene) -> None:
    small.run(1.0, DRUM)
    small.go()
    small.run(2.0)
    small.run(1.0, View((Thing(AHEAD), Thing(BESIDE))))
    assert (small.autopilot.mode, small.opened()) == (HOLD, [1, 2])


def test_a_tapped_thing_beside_the_accepted_one_blocks(small: Scene) -> None:
    small.words[GNOME] = -1.0
    both = View((Thing(AHEAD), Thing(BESIDE, mistaken=1.0)))
    small.run(1.0, both)
    small.go()
    small.run(5.0, both)
    assert (small.autopilot.mode, small.opened()) == (HOLD, [1])
    assert small.calls.reason_filter.reasons(small.now) == {Reason.BLOCKED}


def test_a_named_thing_that_fills_a_small_tile_blocks_though_the_way_beside_it_is_open(small: Scene) -> None:
    two_cells = View((Thing(Box(20 / 60, 34 / 40, 22 / 60, 37 / 40), "log"),))
    small.run(1.0, two_cells)
    assert small.held() == [{Reason.BLOCKED}]
    roi = small.judged(small.frame).roi
    assert roi is not None
    assert roi.corridor.open


def test_the_box_that_is_told_and_tapped_holds_the_thing_and_not_one_tile_of_it(small: Scene) -> None:
    small.run(1.0, DRUM)
    seen = small.call.seen
    assert seen is not None
    assert seen.tile is not None
    told = current_data(small.calls, Preferences.of(small.words), Place(), "7.jpg", small.now)
    assert told is not None
    shown = seen.tile.shown
    assert told.worst_tile_box == (shown.left, shown.top, shown.right, shown.bottom)
    assert shown.right - shown.left == pytest.approx(0.25 / 3)
    assert seen.tile.box.right - seen.tile.box.left == pytest.approx(2 / 60)
    assert seen.tile.uncertainty == pytest.approx(0.95)


def test_journal_and_pictures_show_the_box_that_is_told(small: Scene) -> None:
    small.run(1.0, DRUM)
    seen = small.call.seen
    assert seen is not None
    assert seen.roi is not None
    tile, region = seen.roi.worst_tile, small.numbers.judging.region
    box = tile.shown
    sides = [round(side, 4) for side in (box.left, box.top, box.right, box.bottom)]
    assert recorded(small.call).document(FIGURES_MEMBERS)["worst_tile_box"] == sides
    large, alone = (
        replace(seen, roi=replace(seen.roi, worst_tile=Tile(one, tile.uncertainty)))
        for one in (box, tile.box)
    )
    assert thumbnail(seen, region) == thumbnail(large, region) != thumbnail(alone, region)
    panels = [draw_state(one.frame.image, one, "", (0, 0, 0), region=region) for one in (seen, large, alone)]
    assert np.array_equal(panels[0], panels[1])
    assert not np.array_equal(panels[0], panels[2])


def test_the_picture_has_the_figures_that_are_told(small: Scene) -> None:
    small.run(1.0, DRUM)
    seen = small.call.seen
    assert seen is not None
    told = current_data(small.calls, Preferences.of(small.words), Place(), "7.jpg", small.now)
    assert told is not None
    written = figures(seen)
    assert f"{texts.percent(told.roi_uncertainty)} unexplained" in written
    assert f"worst place {texts.percent(told.worst_tile)}" in written
    assert f"{texts.percent(told.drivable_share)} of the known drivable" in written
