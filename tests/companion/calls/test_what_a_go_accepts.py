"""Rule 6: a go without words accepts the thing, the place and the uncertainty seen, and ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from anytraverse.assessment import Assessment, Maps, Reason
from anytraverse.findings import find, make_maps, roi_figures
from anytraverse.judging import Settings
from anytraverse.regions import Box
from anytraverse.roi import Mask, RoiFigures
from companion.calls import tracking
from companion.calls.answered_things import AnsweredThings
from companion.calls.thing import Thing as AskedThing
from companion.wire.ids import Outcome, Policy, Stage
from tests.companion.calls.scenes import (
    ACROSS,
    AHEAD,
    AUTO,
    BESIDE,
    BROKEN,
    CLEAR,
    DRUM,
    ELSEWHERE,
    HOLD,
    LOG,
    SLIVER,
    Scene,
    Thing,
    View,
)

NEARER = (
    AHEAD,
    Box(0.39, 0.70, 0.53, 0.83),
    Box(0.38, 0.73, 0.54, 0.87),
    Box(0.38, 0.77, 0.54, 0.91),
    Box(0.37, 0.82, 0.55, 0.97),
    Box(0.36, 0.86, 0.56, 1.0),
)
"""The drum as the rover comes nearer."""


def ended(scene: Scene) -> bool:
    """Whether nothing is accepted any more."""
    return not scene.calls.reason_filter.things


def box_of(accepted: AskedThing) -> Box:
    """Around what is accepted."""
    assert accepted.mask is not None
    box = Box.around(accepted.mask)
    assert box is not None
    return box


@pytest.fixture
def accepted(report: Scene) -> Scene:
    """Driving on after a go to a drum ahead."""
    report.run(1.0, DRUM)
    report.go()
    assert report.closed() == [(1, Outcome.ACCEPTED)]
    return report


@pytest.mark.parametrize("word", ["drum", "puddle"], ids=["what it is", "beside the point"])
def test_words_with_a_go_at_clear_now_accept_nothing_that_is_back(hold: Scene, word: str) -> None:
    """Least of all what they name as a danger."""
    narrow = View((Thing(SLIVER),))
    hold.run(1.0, narrow)
    hold.run(2.0, CLEAR)
    assert hold.calls.stage() is Stage.CLEAR
    hold.go({word: -1.0})
    hold.run(3.0, narrow)
    assert hold.autopilot.mode == HOLD


def test_the_accepted_thing_does_not_call_again(accepted: Scene) -> None:
    accepted.run(15.0)
    assert accepted.opened() == [1]
    assert accepted.calls.reason_filter.ok_run > 100


def test_what_is_accepted_grows_and_moves_down_the_image_with_the_thing(accepted: Scene) -> None:
    for box in NEARER:
        accepted.run(0.2, View((Thing(box),)))
    assert accepted.opened() == [1]
    box = box_of(accepted.calls.reason_filter.things.things[0])
    assert box.top > AHEAD.top
    assert box.right - box.left > AHEAD.right - AHEAD.left


def test_the_accepted_box_covers_the_whole_thing_from_the_start(report: Scene) -> None:
    tall = View((Thing(Box(0.42, 0.58, 0.50, 0.97)),))
    report.run(1.0, tall)
    report.go()
    report.run(3.0, tall)
    assert report.opened() == [1]


def test_the_accepted_box_does_not_move_up(accepted: Scene) -> None:
    accepted.run(1.0, View((Thing(NEARER[2]),)))
    accepted.run(0.5, View((Thing(Box(0.38, 0.60, 0.54, 0.72)),)))
    assert accepted.opened() == [1, 2]


def test_what_rises_above_the_accepted_box_must_call(accepted: Scene) -> None:
    accepted.run(0.5, View((Thing(AHEAD), Thing(Box(0.41, 0.60, 0.51, 0.68)))))
    assert accepted.opened() == [1, 2]


def test_a_second_thing_outside_the_box_must_call(accepted: Scene) -> None:
    accepted.run(0.5, View((Thing(AHEAD), Thing(BESIDE))))
    assert accepted.opened() == [1, 2]


def test_a_second_thing_that_turned_up_after_the_calls_frame_is_not_accepted_with_it(held: Scene) -> None:
    both = View((Thing(AHEAD), Thing(BESIDE)))
    held.run(3.0, both)
    held.go()
    held.run(0.5, both)
    assert held.opened() == [1, 2]
    held.run(10.0, both)
    assert held.autopilot.mode == HOLD


def test_a_mean_above_the_accepted_one_and_delta_must_call() -> None:
    scene = Scene(tile=None)
    scene.run(0.5, View(haze=0.35))
    scene.go()
    scene.run(2.0, View(haze=0.44))
    assert scene.opened() == [1]
    scene.run(0.5, View(haze=0.46))
    assert scene.opened() == [1, 2]


def test_what_came_nearer_while_the_call_was_open_is_the_thing_asked_about(report: Scene) -> None:
    for box in NEARER:
        report.run(0.3, View((Thing(box),)))
    report.go()
    report.run(1.0)
    assert report.opened() == [1]


def test_what_grew_while_the_call_was_open_is_the_uncertainty_seen() -> None:
    scene = Scene(tile=None)
    scene.run(0.5, View(haze=0.35))
    scene.run(0.5, View(haze=0.44))
    scene.go()
    scene.run(1.0, View(haze=0.52))
    assert scene.opened() == [1]
    scene.run(0.5, View(haze=0.56))
    assert scene.opened() == [1, 2]


def test_without_a_tile_threshold_what_turned_up_beside_does_not_raise_what_was_seen() -> None:
    scene = Scene(tile=None)
    ahead = Thing(Box(0.36, 0.62, 0.50, 0.94))
    scene.run(0.5, View((ahead,)))
    scene.run(0.5, View((ahead, Thing(Box(0.56, 0.62, 0.67, 0.94)))))
    scene.go()
    scene.run(0.5)
    assert scene.opened() == [1, 2]


def test_nor_does_what_came_nearer_beside_bit_by_bit() -> None:
    scene = Scene(Policy.HOLD, tile=None)
    ahead = Thing(Box(0.36, 0.62, 0.50, 0.94))
    scene.run(1.0)
    scene.run(1.0, View((ahead,)))
    for step in range(1, 17):
        scene.run(0.3, View((ahead, Thing(Box(0.62, 0.62, 0.67, 0.62 + 0.02 * step)))))
    scene.go()
    scene.run(2.0)
    assert (scene.opened(), scene.autopilot.mode) == ([1, 2], HOLD)


def test_an_acceptance_ends_when_the_thing_is_gone_for_five_frames(accepted: Scene) -> None:
    accepted.show(CLEAR, CLEAR, CLEAR, CLEAR, DRUM, CLEAR, CLEAR, CLEAR, CLEAR)
    assert not ended(accepted)
    accepted.show(CLEAR)
    assert ended(accepted)
    accepted.run(0.5, DRUM)
    assert accepted.opened() == [1, 2]


def post(column: int, rows: int) -> View:
    """A thing of 2 cells' width: 4 rows of it are over the threshold of a tile, and 3 are below."""
    return View((Thing(Box(column / 60, 28 / 40, (column + 2) / 60, (28 + rows) / 40)),))


def test_a_thing_just_below_the_threshold_is_not_gone(report: Scene) -> None:
    report.run(0.5, post(24, 4))
    report.go()
    report.run(2.0, post(24, 3))
    assert not report.judged(report.frame).reasons, "no figure of it is bad"
    report.run(1.0, post(24, 4))
    assert report.opened() == [1]


def test_a_thing_just_below_the_threshold_is_tracked(report: Scene) -> None:
    report.run(0.5, post(24, 4))
    report.go()
    for column in range(24, 34):
        report.run(0.3, post(column, 3))
    report.run(1.0, post(34, 4))
    assert report.opened() == [1]


def test_broken_frames_do_not_show_that_the_thing_is_gone(accepted: Scene) -> None:
    accepted.show(*[BROKEN] * 8)
    assert not ended(accepted)


def test_an_acceptance_of_a_thing_in_view_ends_after_twice_its_seconds(accepted: Scene) -> None:
    accepted.run(39.5)
    assert accepted.opened() == [1]
    accepted.run(1.0)
    assert accepted.opened() == [1, 2]


def test_an_acceptance_of_a_thing_in_view_ends_after_twice_its_metres(report: Scene) -> None:
    report.autopilot.travelled = 100.0
    report.run(2.0, DRUM)
    report.go()
    report.autopilot.travelled = 119.5
    report.run(2.0)
    assert report.opened() == [1]
    report.autopilot.travelled = 120.0
    report.run(2.0)
    assert report.opened() == [1, 2]


def test_a_go_does_not_accept_what_is_known_and_not_drivable(hold: Scene) -> None:
    both = View((Thing(AHEAD), Thing(Box(0.3, 0.85, 0.7, 0.95), "log")))
    hold.run(1.0, both)
    hold.go()
    hold.run(10.0, both)
    assert hold.autopilot.mode == HOLD
    assert hold.opened() == [1]


def test_a_go_accepts_the_place_of_the_call_and_no_other(report: Scene) -> None:
    report.run(0.5, ELSEWHERE)
    reference = report.reference
    report.go()
    report.reference = reference  # as if the rover had been elsewhere when the answer came
    report.run(3.0)
    assert report.opened() == [1]
    report.run(0.5, View(turned=100.0))
    assert report.opened() == [1, 2]


def test_a_place_less_unlike_the_reference_than_the_accepted_one_is_still_another(report: Scene) -> None:
    report.run(0.5, ELSEWHERE)
    reference = report.reference
    report.go()
    report.reference = reference
    report.run(0.5, View(turned=-50.0))
    assert report.opened() == [1, 2]


def test_a_thing_in_the_accepted_place_calls(report: Scene) -> None:
    report.run(0.5, ELSEWHERE)
    report.go()
    report.run(0.5, View((Thing(AHEAD),), turned=60.0))
    assert report.opened() == [1, 2]
    assert report.call.reasons == {Reason.UNKNOWN_OBJECT}


def test_place_and_thing_of_one_frame_are_accepted_together_though_they_count_one_after_the_other(
    report: Scene,
) -> None:
    both = View((Thing(AHEAD),), turned=60.0)
    report.show(View(turned=60.0), both, both)
    assert report.call.reasons == {Reason.UNKNOWN_OBJECT, Reason.UNKNOWN_SCENE}
    report.go()
    report.run(3.0, both)
    assert report.opened() == [1]


def test_an_accepted_thing_and_a_blocked_way_hold_for_the_way(accepted: Scene) -> None:
    accepted.run(1.0, View((Thing(AHEAD), Thing(Box(0.3, 0.85, 0.7, 0.95), "log"))))
    assert accepted.calls.reason_filter.reasons(accepted.now) == {Reason.BLOCKED}


def test_after_a_restart_the_frame_of_the_call_says_what_a_go_accepts(held: Scene) -> None:
    held.restarted()
    held.run(0.5, DRUM)
    held.judge_again()
    other = View((Thing(BESIDE),))
    held.run(0.5, other)
    held.go()
    held.run(0.5, other)
    assert held.opened() == [1, 2]


def test_where_that_frame_is_lost_a_go_accepts_nothing(held: Scene) -> None:
    held.restarted()
    held.run(0.5, View((Thing(BESIDE),)))
    held.go()
    held.run(0.5)
    assert held.opened() == [1, 2]
    held.run(5.0)
    assert held.autopilot.mode == HOLD


def test_a_go_does_not_accept_what_came_after_the_thing_was_gone(held: Scene) -> None:
    held.run(3.0, CLEAR)
    held.run(1.0, View((Thing(AHEAD, "person"),)))
    held.go()
    held.run(5.0)
    assert (held.opened(), held.autopilot.mode) == ([1, 2], HOLD)


@pytest.mark.slow
def test_an_acceptance_that_runs_out_in_the_hold_is_a_new_call(held: Scene) -> None:
    fallen = View((Thing(AHEAD), Thing(Box(0.3, 0.85, 0.7, 0.95), "log")))
    held.run(1.0, fallen)
    held.go()
    held.run(45.0, fallen)
    assert held.opened() == [1, 2]
    assert held.closed() == [(1, Outcome.ACCEPTED)]
    held.run(10.0, CLEAR)
    assert held.autopilot.mode == HOLD


def test_with_a_go_the_rover_drives_over_the_accepted_thing_in_hold_policy(held: Scene) -> None:
    held.go()
    for box in NEARER:
        held.run(0.7, View((Thing(box),)))
    held.run(5.0, CLEAR)
    assert held.autopilot.mode == AUTO
    assert held.opened() == [1]
    held.run(1.0, LOG)
    assert held.autopilot.mode == HOLD


FAINT = View((Thing(ACROSS, unsure=0.6),))
"""A thing across the way that is too little known to drive over, and too little unknown for its tile."""


def test_a_go_passes_a_thing_that_is_called_for_only_since_no_known_way_leads_on() -> None:
    scene = Scene(Policy.HOLD, tile=0.65)
    scene.run(1.0, FAINT)
    assert (scene.held(), scene.autopilot.mode) == ([frozenset({Reason.UNKNOWN_OBJECT})], HOLD)
    assert scene.call.seen is not None
    assert scene.call.seen.tile is not None
    assert ACROSS.contains(*scene.call.seen.tile.box.centre)
    scene.go()
    for down in (0.0, 0.02, 0.04, 0.06):
        scene.run(0.5, View((Thing(Box(0.30, 0.70 + down, 0.70, 0.85 + down), unsure=0.6),)))
    assert scene.autopilot.mode == AUTO
    assert scene.opened() == [1]
    scene.run(1.0, View((Thing(Box(0.30, 0.62, 0.70, 0.68), unsure=0.6),)))
    assert scene.opened() == [1, 2], "the next one has not been accepted"


def test_a_go_passes_what_is_unsure_in_many_places() -> None:
    places = [(x, y) for x in range(20, 40, 2) for y in (26, 27, 30, 31, 34, 35)]
    specks = tuple(Thing(Box(x / 60, y / 40, (x + 1) / 60, (y + 1) / 40)) for x, y in places)
    scene = Scene(Policy.HOLD, tile=0.9)
    scene.run(1.0, View(specks))
    assert scene.autopilot.mode == HOLD
    scene.go()
    scene.run(3.0)
    assert (scene.autopilot.mode, scene.opened()) == (AUTO, [1])


def test_a_go_to_a_thing_does_not_open_a_way_that_known_things_close(hold: Scene) -> None:
    hold.run(1.0, FAINT)
    hold.go()
    hold.run(5.0, LOG)
    assert hold.autopilot.mode == HOLD
    assert hold.calls.reason_filter.reasons(hold.now) == {Reason.BLOCKED}


def test_without_tiles_a_go_to_a_thing_does_not_accept_the_known_ground_around_it() -> None:
    scene = Scene(Policy.HOLD, tile=None)
    view = View((Thing(Box(0.333, 0.60, 0.38, 0.95), "log"), Thing(Box(0.5, 0.7, 0.6, 0.8))), haze=0.25)
    scene.run(1.0, view)
    assert scene.calls.reason_filter.reasons(scene.now) == {Reason.BLOCKED, Reason.UNKNOWN_OBJECT}
    scene.go()
    scene.run(3.0)
    assert scene.autopilot.mode == HOLD
    assert scene.calls.reason_filter.reasons(scene.now) == {Reason.BLOCKED}


@pytest.mark.parametrize("scale", [1, 8, 30])
def test_the_search_for_the_accepted_thing_is_bounded_whatever_the_size_of_the_maps(
    report: Scene, monkeypatch: pytest.MonkeyPatch, scale: int
) -> None:
    report.run(0.5, DRUM)
    seen = enlarged(report.judged(report.frame), scale, report.numbers.judging)
    searched: list[tuple[tuple[int, ...], int]] = []
    plain = tracking.connected

    def recorded(seed: Mask, within: Mask, steps: int) -> Mask:
        searched.append((seed.shape, steps))
        return plain(seed, within, steps)

    monkeypatch.setattr("companion.calls.tracking.connected", recorded)
    things = AnsweredThings(report.numbers)
    things.accept(things.asked(seen, seen.reasons)[0], seen.reasons, 0.0, None)
    box = box_of(things.things[0])
    assert things.cover(seen).covered == {Reason.UNKNOWN_OBJECT}
    assert searched
    assert all(max(*shape, steps) <= 96 for shape, steps in searched)
    assert box.contains(AHEAD.left, AHEAD.top)
    assert box.contains(AHEAD.right, AHEAD.bottom)
    assert box.right - box.left < 0.2


def enlarged(seen: Assessment, scale: int, judging: Settings) -> Assessment:
    """The same frame, its maps so many times as large."""
    assert seen.maps is not None
    attention = np.kron(seen.maps.attention, np.ones((1, scale, scale), dtype=np.float32))
    maps = make_maps(attention, list(seen.words.values()), judging)
    assert isinstance(maps, Maps)
    roi = roi_figures(maps, 1.5, judging)
    assert isinstance(roi, RoiFigures)
    return replace(seen, maps=maps, roi=roi, findings=tuple(find(roi, len(maps.attention), 1.0, judging)))
