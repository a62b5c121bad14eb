"""What was accepted is a thing in its own shape: what lies beside it, in a bend of it or behind it holds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from anytraverse.assessment import Reason
from anytraverse.findings import is_open
from anytraverse.regions import Box
from companion.calls.answered_things import AnsweredThings
from companion.wire.ids import Policy
from tests.companion.calls.scenes import AUTO, HEIGHT, HOLD, WIDTH, Scene, Thing, View

SIDE = (Box(0.33, 0.60, 0.40, 0.95), Box(0.40, 0.75, 0.55, 0.80))
"""A strip along the ROI's left side, and a log across that touches it."""
IN_ITS_BEND = Box(0.44, 0.60, 0.60, 0.66)
"""Beside the strip and behind the log."""
FAR = (Box(0.33, 0.60, 0.67, 0.66), Box(0.40, 0.66, 0.44, 0.80))
"""A strip along the ROI's far edge, and a post that touches it."""
BESIDE_THE_POST = Box(0.48, 0.72, 0.67, 0.77)
VERGES = (Box(0.0, 0.60, 0.37, 1.0), Box(0.63, 0.60, 1.0, 1.0))
"""The ground on both sides of the way."""
ON_IT = (*VERGES, Box(0.37, 0.80, 0.63, 0.86))
"""With a log across that touches both."""


def mirrored(box: Box) -> Box:
    """The same on the other side of the image."""
    return Box(1.0 - box.right, box.top, 1.0 - box.left, box.bottom)


def view(name: str, *boxes: Box) -> View:
    """Things of one name."""
    return View(tuple(Thing(box, name) for box in boxes))


SCENES = {
    "left": (SIDE, IN_ITS_BEND),
    "right": (tuple(map(mirrored, SIDE)), mirrored(IN_ITS_BEND)),
    "far": (FAR, BESIDE_THE_POST),
    "far mirrored": (tuple(map(mirrored, FAR)), mirrored(BESIDE_THE_POST)),
}


def driving_on(name: str, *boxes: Box, tile: float | None) -> Scene:
    """Driving over what was held for: by hand where it has a name, with a go where it has none."""
    scene = Scene(Policy.HOLD, tile=tile)
    scene.run(1.0)
    scene.run(1.0, view(name, *boxes))
    reason = Reason.BLOCKED if name in scene.words else Reason.UNKNOWN_OBJECT
    assert scene.held() == [{reason}]
    if name in scene.words:
        scene.human(AUTO)
    else:
        scene.go()
    scene.run(2.0)
    assert (scene.autopilot.mode, len(scene.held())) == (AUTO, 1)
    return scene


@pytest.mark.slow
@pytest.mark.parametrize("where", SCENES)
@pytest.mark.parametrize("name", ["log", "drum"], ids=["taken over", "with a go"])
@pytest.mark.parametrize("tile", [None, 0.25, 0.65])
def test_what_comes_into_a_bend_of_the_accepted_thing_holds(
    where: str, name: str, tile: float | None
) -> None:
    accepted, later = SCENES[where]
    scene = driving_on(name, *accepted, tile=tile)
    scene.run(0.5, view(name, *accepted, later))
    assert scene.autopilot.mode == HOLD


@pytest.mark.parametrize("name", ["log", "drum"], ids=["taken over", "with a go"])
@pytest.mark.parametrize("tile", [None, 0.25, 0.65])
def test_the_next_thing_across_holds_also_where_it_touches_the_sides_as_the_accepted_one_did(
    name: str, tile: float | None
) -> None:
    scene = driving_on(name, *ON_IT, tile=tile)
    scene.run(0.3, view(name, *VERGES))
    scene.run(0.5, view(name, *VERGES, Box(0.37, 0.62, 0.63, 0.70)))
    assert scene.autopilot.mode == HOLD


@pytest.mark.parametrize("name", ["log", "drum"], ids=["taken over", "with a go"])
@pytest.mark.parametrize("tile", [None, 0.25, 0.65])
def test_it_holds_where_it_comes_into_sight_bit_by_bit(name: str, tile: float | None) -> None:
    scene = driving_on(name, *ON_IT, tile=tile)
    scene.run(0.3, view(name, *VERGES))
    for step in range(1, 5):
        scene.run(0.4, view(name, *VERGES, Box(0.37, 0.60, 0.63, 0.60 + 0.025 * step)))
    assert scene.autopilot.mode == HOLD


@pytest.mark.parametrize("name", ["log", "drum"], ids=["taken over", "with a go"])
@pytest.mark.parametrize("tile", [None, 0.25, 0.65])
def test_an_accepted_log_across_the_whole_way_is_passed_as_it_comes_nearer(
    name: str, tile: float | None
) -> None:
    scene = driving_on(name, Box(0.25, 0.66, 0.75, 0.72), tile=tile)
    for down in (0.02, 0.05, 0.09, 0.13, 0.17, 0.22, 0.28):
        wider = 0.25 - down / 2
        scene.run(0.3, view(name, Box(wider, 0.66 + down, 1.0 - wider, min(1.0, 0.72 + 1.1 * down))))
    assert (scene.autopilot.mode, len(scene.held())) == (AUTO, 1)


@pytest.mark.parametrize("name", ["log", "drum"], ids=["taken over", "with a go"])
@pytest.mark.parametrize("tile", [None, 0.25, 0.65])
def test_so_is_one_that_touches_the_sides(name: str, tile: float | None) -> None:
    scene = driving_on(name, *VERGES, Box(0.37, 0.66, 0.63, 0.72), tile=tile)
    for down in (0.02, 0.05, 0.09, 0.13, 0.17, 0.22, 0.28):
        scene.run(0.3, view(name, *VERGES, Box(0.37, 0.66 + down, 0.63, min(1.0, 0.72 + 1.1 * down))))
    assert (scene.autopilot.mode, len(scene.held())) == (AUTO, 1)


@pytest.mark.parametrize("name", ["log", "drum"], ids=["taken over", "with a go"])
@pytest.mark.parametrize("tile", [None, 0.25, 0.65])
def test_so_is_one_that_shifts_as_the_rover_turns(name: str, tile: float | None) -> None:
    scene = driving_on(name, Box(0.34, 0.70, 0.62, 0.80), tile=tile)
    for aside in (0.03, 0.06, 0.09, 0.06, 0.02, -0.02, -0.05, -0.08):
        scene.run(0.2, view(name, Box(0.34 + aside, 0.70, 0.62 + aside, 0.80)))
    assert (scene.autopilot.mode, len(scene.held())) == (AUTO, 1)


@pytest.mark.parametrize("tile", [None, 0.65])
def test_an_accepted_log_that_closes_the_way_does_not_cover_a_faint_thing_that_closes_it_behind(
    tile: float | None,
) -> None:
    log, faint = Box(0.33, 0.90, 0.67, 0.95), Thing(Box(0.33, 0.62, 0.67, 0.67), unsure=0.6)
    scene = driving_on("log", log, tile=tile)
    scene.run(0.5, View((Thing(log, "log"), faint)))
    assert scene.autopilot.mode == HOLD


@pytest.mark.parametrize("tile", [None, 0.65])
def test_both_are_passed_where_a_human_drives_on_before_both(tile: float | None) -> None:
    both = View((Thing(Box(0.33, 0.90, 0.67, 0.95), "log"), Thing(Box(0.33, 0.62, 0.67, 0.67), unsure=0.6)))
    scene = Scene(Policy.HOLD, tile=tile)
    scene.run(1.0)
    scene.run(1.0, both)
    assert scene.autopilot.mode == HOLD
    scene.human(AUTO)
    scene.run(2.0)
    assert scene.autopilot.mode == AUTO


def test_a_thing_that_rises_above_the_horizon_does_not_cover_what_comes_from_there() -> None:
    unknown, tall = Thing(Box(0.0, 0.0, 1.0, 0.55), "sky"), Thing(Box(0.40, 0.5, 0.50, 0.80))
    scene = Scene()
    scene.run(1.0)
    scene.run(1.0, View((unknown, tall)))
    scene.go()
    scene.run(1.0)
    assert scene.opened() == [1]
    for step in range(1, 12):
        later = Thing(Box(0.57, 0.5, 0.66, 0.58 + 0.025 * step), "tent")
        scene.run(0.3, View((unknown, tall, later)))
    assert scene.opened() == [1, 2]


TILE = 5
"""A tile's side in pixels of these maps: a quarter of the ROI's width."""
THINGS = frozenset({Reason.BLOCKED, Reason.UNKNOWN_OBJECT})
NAMES = st.sampled_from(["log", "drum"])


def near(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """What lies no further than a tile from the mask."""
    around = np.pad(mask, TILE)
    shifts = [(y, x) for y in range(2 * TILE + 1) for x in range(2 * TILE + 1)]
    found: NDArray[np.bool_] = np.any([around[y : y + HEIGHT, x : x + WIDTH] for y, x in shifts], axis=0)
    return found


def pixels(left: int, top: int, right: int, bottom: int) -> Box:
    """The box of these columns and rows."""
    return Box(left / WIDTH, top / HEIGHT, right / WIDTH, bottom / HEIGHT)


@st.composite
def apart(draw: st.DrawFn) -> tuple[list[list[Box]], Box]:
    """What is on the way in a few frames, and a new thing in the ROI at least a tile away from all of it."""
    width, height = draw(st.integers(2 * TILE, 20)), draw(st.integers(TILE, TILE + 1))
    new, room = draw(
        st.sampled_from(
            [
                ((20, 24, 20 + width, 24 + height), (0, 24 + height + TILE, WIDTH, HEIGHT)),
                ((20, 38 - height, 20 + width, 38), (0, 20, WIDTH, 38 - height - TILE)),
                ((20, 28, 32, 28 + height), (32 + TILE, 20, WIDTH, HEIGHT)),
                ((28, 28, 40, 28 + height), (0, 20, 28 - TILE, HEIGHT)),
            ]
        )
    )
    left, top, right, bottom = room
    across, down = st.integers(left, right), st.integers(top, bottom)
    sides = st.tuples(
        st.lists(across, min_size=2, max_size=2, unique=True).map(sorted),
        st.lists(down, min_size=2, max_size=2, unique=True).map(sorted),
    )
    place = sides.map(lambda one: pixels(one[0][0], one[1][0], one[0][1], one[1][1]))
    frames = st.lists(st.lists(place, min_size=1, max_size=3), min_size=1, max_size=4)
    return draw(frames), pixels(*new)


@pytest.mark.slow
@given(apart(), NAMES, NAMES, st.sampled_from([None, 0.25, 0.65]))
@settings(max_examples=60, suppress_health_check=[HealthCheck.filter_too_much])
def test_nothing_new_that_closes_the_way_is_covered_further_than_a_tile_from_what_was_accepted(
    drawn: tuple[list[list[Box]], Box], name: str, new_name: str, tile: float | None
) -> None:
    frames, new = drawn
    scene = Scene(tile=tile)
    numbers, there = scene.numbers, new.mask(HEIGHT, WIDTH)
    assume(not is_open(~there, WIDTH / HEIGHT, numbers.judging))
    things, shown = AnsweredThings(numbers), View()
    for places in frames:
        shown = view(name, *places)
        scene.show(shown)
        seen = scene.judged(scene.frame)
        if not things:
            things.accept(things.asked(seen, THINGS)[0], THINGS, 0.0, None)
        else:
            things.follow(seen, things.cover(seen), 0.0, None)
    (accepted,) = things.things
    assert accepted.mask is not None
    assume(accepted.uncertainty + numbers.accepted_rise < 0.9 and not (near(accepted.mask) & there).any())
    scene.show(View((*shown.things, Thing(new, new_name))))
    seen = scene.judged(scene.frame)
    assert seen.reasons - things.cover(seen).covered
