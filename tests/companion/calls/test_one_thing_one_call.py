"""Rule 6: what was answered about a thing holds for all of it, until it is gone; another thing must call."""

from __future__ import annotations

import pytest

from anytraverse.answers import AnswerOutcome
from anytraverse.assessment import Reason
from anytraverse.operations import Tap
from anytraverse.regions import Box
from companion.calls.answered_things import MOST
from companion.calls.summary import fractions
from companion.wire.ids import Motion, Outcome, Policy, Result
from tests.companion.calls.scenes import (
    AHEAD,
    AUTO,
    BESIDE,
    CLEAR,
    DRUM,
    HOLD,
    Scene,
    Thing,
    View,
)

LARGE = Thing(Box(0.28, 0.66, 0.72, 0.95))
"""It fills more than a tenth of the picture."""
FAR = Thing(Box(0.34, 0.60, 0.42, 0.67))
TENT = Thing(BESIDE, "tent")
TOUCHING = (Box(0.52, 0.72, 0.64, 0.84), Box(0.51, 0.70, 0.61, 0.80))
"""Ground beside the drum, tapped so that the boxes reach its outline."""
BLOCKED = {Reason.BLOCKED}


def tapped(scene: Scene, weight: float, box: Box = AHEAD, motion: Motion = Motion.NONE) -> Result:
    """Tap with a word that the perceiver then does not find anywhere."""
    changes = (Tap(scene.frame, fractions(box), "gnome", weight),)
    scene.words["gnome"] = weight
    call = scene.calls.call
    again = scene.judged(call.frame_id) if call is not None else None
    outcome = AnswerOutcome(again, scene.judged(scene.frame))
    result, decisions = scene.calls.apply_answer(scene.calls.current_id, motion, changes, outcome, scene.now)
    scene.keep(decisions)
    return result


def nearer(scene: Scene, *beside: Thing) -> None:
    """Come nearer to the drum, at some 2 m/s."""
    for step in range(20):
        box = Box(0.40 - 0.004 * step, 0.68 + 0.006 * step, 0.52 + 0.004 * step, 0.80 + 0.010 * step)
        scene.run(0.2, View((Thing(box), *beside)))


@pytest.fixture
def named(held: Scene) -> Scene:
    """Standing before a drum that was tapped as a gnome: -1, and is not found by that."""
    assert tapped(held, -1.0) is Result.APPLIED
    held.run(1.0)
    return held


def test_what_was_tapped_as_not_drivable_blocks_and_does_not_call_though_it_is_not_found(
    named: Scene,
) -> None:
    named.run(30.0)
    assert named.opened() == [1]
    assert named.calls.reason_filter.reasons(named.now) == BLOCKED
    assert named.autopilot.mode == HOLD


def test_neither_time_nor_distance_ends_what_blocks(named: Scene) -> None:
    named.autopilot.travelled = 0.0
    named.run(25.0)
    named.autopilot.travelled = 50.0
    named.run(2.0)
    assert named.calls.reason_filter.reasons(named.now) == BLOCKED
    assert named.opened() == [1]


def test_it_blocks_until_five_frames_show_drivable_ground_there(named: Scene) -> None:
    named.show(CLEAR, CLEAR, CLEAR, CLEAR, DRUM, CLEAR, CLEAR, CLEAR, CLEAR)
    assert named.calls.reason_filter.things
    named.show(CLEAR)
    assert not named.calls.reason_filter.things


def test_a_go_waits_until_it_is_gone(named: Scene) -> None:
    named.go()
    named.run(5.0)
    assert named.autopilot.mode == HOLD
    named.run(2.0, CLEAR)
    assert named.autopilot.mode == AUTO


def test_it_is_followed_as_it_comes_nearer(report: Scene) -> None:
    report.run(1.0, DRUM)
    tapped(report, -1.0)
    nearer(report)
    assert report.opened() == [1]
    assert report.calls.reason_filter.reasons(report.now) == BLOCKED


def test_another_thing_beside_what_blocks_calls(named: Scene) -> None:
    named.run(1.0, View((Thing(AHEAD), TENT)))
    assert named.opened() == [1, 2]


@pytest.mark.parametrize(("beside", "follows"), [((), True), ((TENT,), False)])
def test_it_is_not_followed_in_a_frame_in_which_another_thing_calls(
    named: Scene, beside: tuple[Thing, ...], follows: bool
) -> None:
    """What calls there may be a part of what is seen in its place."""
    (thing,) = named.calls.reason_filter.things.things
    before = thing.mask
    named.show(View((Thing(Box(0.41, 0.69, 0.53, 0.81)), *beside)))
    assert before is not None
    assert thing.mask is not None
    assert bool((thing.mask != before).any()) is follows


@pytest.mark.parametrize("weight", [1.0, None])
def test_it_does_not_block_once_its_word_has_another_sign_or_is_not_in_use(
    named: Scene, weight: float | None
) -> None:
    named.words.pop("gnome")
    if weight is not None:
        named.words["gnome"] = weight
    named.run(1.0)
    assert named.calls.reason_filter.reasons(named.now) == {Reason.UNKNOWN_OBJECT}


def test_look_again_ends_what_blocks(named: Scene) -> None:
    named.run(1.0)
    named.answer(Motion.LOOK_AGAIN)
    assert not named.calls.reason_filter.things


@pytest.mark.parametrize("unsure", [0.3, 0.4, 0.6])
def test_it_does_not_call_though_it_is_hardly_more_uncertain_than_drivable_ground(
    hold: Scene, unsure: float
) -> None:
    hold.run(1.0, View((Thing(Box(0.38, 0.66, 0.56, 0.90), unsure=unsure),)))
    assert tapped(hold, -1.0) is Result.APPLIED
    hold.run(5.0)
    assert hold.opened() == [1]
    assert hold.calls.reason_filter.reasons(hold.now) == BLOCKED


@pytest.mark.parametrize("tap", [True, False])
def test_a_tap_above_zero_on_it_or_its_word_above_zero_with_a_go_accepts_it(named: Scene, tap: bool) -> None:
    if tap:
        tapped(named, 1.0, motion=Motion.GO)
    else:
        named.go({"gnome": 1.0})
    named.run(5.0)
    assert (named.autopilot.mode, named.opened()) == (AUTO, [1])


@pytest.mark.parametrize(
    ("box", "blocks"), [(AHEAD, False), (BESIDE, True), *((box, True) for box in TOUCHING)]
)
def test_a_tap_above_zero_on_it_ends_it(named: Scene, box: Box, blocks: bool) -> None:
    named.words["moss"] = 1.0
    changes = (Tap(named.frame, fractions(box), "moss", 1.0),)
    named.calls.apply_answer(named.calls.current_id, Motion.NONE, changes, None, named.now)
    assert bool(named.calls.reason_filter.things) is blocks


def test_a_word_that_finds_a_part_of_the_thing_blocks_all_of_it(hold: Scene) -> None:

    thing = Thing(Box(0.36, 0.66, 0.56, 0.90), mistaken=0.4)
    hold.run(1.0, View((thing,)))
    assert hold.answer(words={"gnome": -1.0}) is Result.APPLIED
    hold.run(2.0)
    assert hold.opened() == [1]
    assert hold.calls.reason_filter.reasons(hold.now) == BLOCKED


@pytest.mark.parametrize("tap", [True, False])
def test_a_word_above_zero_with_a_go_accepts_the_thing_though_it_is_not_found(held: Scene, tap: bool) -> None:
    if tap:
        assert tapped(held, 1.0, motion=Motion.GO) is Result.APPLIED
    else:
        assert held.go({"puddle": 1.0}) is Result.APPLIED
    held.run(3.0, DRUM)
    assert held.autopilot.mode == AUTO
    assert held.opened() == [1]
    assert held.closed() == [(1, Outcome.ACCEPTED)]


def test_words_for_a_new_place_do_not_accept_the_thing_in_it(hold: Scene) -> None:
    there = View((Thing(AHEAD),), turned=60.0)
    hold.run(1.0, there)
    assert hold.call.reasons == {Reason.UNKNOWN_OBJECT, Reason.UNKNOWN_SCENE}
    assert hold.go({"gravel": 1.0}) is Result.NOT_COVERED
    hold.run(5.0, there)
    assert hold.autopilot.mode == HOLD
    assert not hold.calls.reason_filter.things


def test_a_tap_in_the_calls_picture_means_the_thing_though_it_has_come_nearer_since(report: Scene) -> None:
    for step in range(20):
        box = Box(0.40 - 0.004 * step, 0.68 + 0.006 * step, 0.52 + 0.004 * step, 0.80 + 0.010 * step)
        report.run(0.2, View((Thing(box),), turned=60.0))
    assert tapped(report, 1.0, AHEAD, Motion.GO) is Result.APPLIED
    report.run(2.0)
    assert report.opened() == [1]


@pytest.mark.parametrize("box", TOUCHING)
def test_nor_does_a_tap_on_the_ground_beside_it(hold: Scene, box: Box) -> None:
    hold.run(1.0, View((Thing(AHEAD),), turned=60.0))
    tapped(hold, 1.0, box, Motion.GO)
    hold.run(5.0)
    assert hold.autopilot.mode == HOLD
    assert not hold.calls.reason_filter.things


def test_a_word_above_zero_without_a_go_accepts_nothing(held: Scene) -> None:
    assert held.answer(words={"puddle": 1.0}) is Result.NOT_COVERED
    assert not held.calls.reason_filter.things


def test_several_goes_count_together(report: Scene) -> None:
    report.run(1.0, DRUM)
    report.go()
    both = View((Thing(AHEAD), TENT))
    report.run(1.0, both)
    assert report.opened() == [1, 2]
    assert report.call.seen is not None
    assert report.call.seen.tile is not None
    assert BESIDE.contains(*report.call.seen.tile.box.centre), "it asks about the other one"
    report.go()
    report.run(5.0, both)
    assert report.opened() == [1, 2]
    report.run(1.0, View((*both.things, FAR)))
    assert report.opened() == [1, 2, 3]


def test_a_thing_that_is_gone_is_asked_about_when_it_is_back_though_another_one_is_still_there(
    report: Scene,
) -> None:
    both = View((Thing(AHEAD), TENT))
    report.run(1.0, DRUM)
    report.go()
    report.run(1.0, both)
    report.go()
    report.run(2.0, View((TENT,)))
    assert report.opened() == [1, 2]
    report.run(1.0, both)
    assert report.opened() == [1, 2, 3]


def test_a_large_thing_does_not_cover_a_faint_one_that_closes_the_way_once_it_is_passed() -> None:
    scene = Scene(Policy.HOLD, tile=0.65)
    scene.run(1.0)
    scene.run(1.0, View((Thing(Box(0.30, 0.65, 0.70, 1.0)),)))
    scene.go()
    scene.run(1.0)
    rest, faint = Thing(Box(0.30, 0.95, 0.70, 1.0)), Thing(Box(0.30, 0.62, 0.70, 0.67), unsure=0.6)
    scene.run(0.3, View((Thing(Box(0.30, 0.90, 0.70, 1.0)),)))
    assert scene.autopilot.mode == AUTO
    scene.run(1.0, View((rest, faint)))
    assert scene.autopilot.mode == HOLD


def test_of_many_things_the_newest_count(report: Scene) -> None:
    for _ in range(MOST + 3):
        report.run(0.5, DRUM)
        seen = report.judged(report.frame)
        things = report.calls.reason_filter.things
        things.accept(things.asked(seen, seen.reasons)[0], seen.reasons, report.now, None)
    assert len(things.things) == MOST


def log_from_afar(step: int) -> Box:
    """A log that looks like a ball at first: with each step it is wider, and hardly higher."""
    return Box(0.44 - 0.004 * step, 0.66, 0.52 + 0.004 * step, 0.74 + 0.001 * step)


def test_an_accepted_thing_that_turns_out_wider_bit_by_bit_is_one_thing(report: Scene) -> None:
    report.run(1.0, View((Thing(log_from_afar(0)),)))
    report.go()
    for step in range(14):
        report.run(0.5, View((Thing(log_from_afar(step)),)))
    assert report.opened() == [1]
    for step in range(14, 40):
        report.run(0.5, View((Thing(log_from_afar(step)),)))
    assert report.opened() == [1, 2], "somebody has stepped out from behind it"


def test_one_that_is_as_wide_at_once_is_not(report: Scene) -> None:
    report.run(1.0, View((Thing(log_from_afar(0)),)))
    report.go()
    report.run(6.0, View((Thing(log_from_afar(0)),)))
    report.run(1.0, View((Thing(log_from_afar(13)),)))
    assert report.opened() == [1, 2]


def test_a_thing_that_is_seen_less_high_and_no_wider_is_one_thing(report: Scene) -> None:
    report.run(1.0, View((Thing(Box(0.42, 0.60, 0.54, 0.82)),)))
    report.go()
    report.run(1.0, View((Thing(Box(0.42, 0.60, 0.54, 0.82)),)))
    low = Box(0.42, 0.76, 0.54, 0.82)
    report.run(1.0, View((Thing(low),)))
    things = report.calls.reason_filter.things.things
    mask = things[0].mask
    assert mask is not None
    assert mask[: round(0.66 * len(mask))].sum() == 0, "the mask has followed it"
    assert report.opened() == [1]


@pytest.mark.parametrize("tile", [0.25, 0.65, 0.85])
def test_an_accepted_thing_that_fills_more_of_the_region_is_not_asked_about_again(tile: float) -> None:
    scene = Scene(Policy.HOLD, tile=tile)
    scene.run(1.0)
    scene.run(1.0, DRUM)
    scene.go()
    nearer(scene)
    assert scene.autopilot.mode == AUTO
    assert scene.opened() == [1]


def test_an_accepted_thing_that_fills_the_picture_is_no_new_place_and_a_place_behind_it_is(
    report: Scene,
) -> None:
    report.run(1.0, View((LARGE,)))
    report.go()
    report.run(3.0, View((LARGE,), turned=60.0))
    assert report.opened() == [1]
    report.run(1.0, View(turned=60.0))
    assert report.opened() == [1, 2]


def test_a_thing_that_blocks_and_fills_the_picture_is_no_new_place(report: Scene) -> None:
    report.run(1.0, View((LARGE,)))
    assert tapped(report, -1.0, LARGE.box) is Result.APPLIED
    report.run(3.0, View((LARGE,), turned=60.0))
    assert report.opened() == [1]
    assert report.calls.reason_filter.reasons(report.now) == BLOCKED
    report.run(1.0, View(turned=60.0))
    assert report.opened() == [1, 2]


def test_it_hides_a_new_place_no_longer_than_an_accepted_one(report: Scene) -> None:
    report.run(1.0, View((LARGE,)))
    assert tapped(report, -1.0, LARGE.box) is Result.APPLIED
    report.run(39.0, View((LARGE,), turned=60.0))
    assert report.opened() == [1]
    report.run(3.0, View((LARGE,), turned=60.0))
    assert report.opened() == [1, 2]
    assert report.call.reasons == {Reason.UNKNOWN_SCENE}


def test_nor_does_a_large_one_that_is_gone_though_another_one_is_still_there(report: Scene) -> None:
    large, small = Thing(Box(0.28, 0.79, 0.72, 1.0)), Thing(Box(0.40, 0.60, 0.52, 0.72))
    report.run(1.0, View((large,)))
    report.go()
    report.run(1.0, View((large, small)))
    report.go()
    report.run(2.0, View((small,)))
    assert report.opened() == [1, 2]
    report.run(1.0, View((small,), turned=60.0))
    assert report.opened() == [1, 2, 3]


def test_a_go_to_a_place_does_not_accept_a_thing_that_its_picture_shows(report: Scene) -> None:
    report.run(1.0, DRUM)
    report.go()
    both = View((Thing(AHEAD), TENT), turned=60.0)
    report.show(View((Thing(AHEAD),), turned=60.0), both)
    assert report.call.reasons == {Reason.UNKNOWN_SCENE}
    report.go()
    report.show(both, both)
    assert report.opened() == [1, 2, 3]


def test_a_small_accepted_thing_does_not_hide_a_new_place(report: Scene) -> None:
    report.run(1.0, DRUM)
    report.go()
    report.run(1.0, View((Thing(AHEAD),), turned=60.0))
    assert report.opened() == [1, 2]
    assert report.call.reasons == {Reason.UNKNOWN_SCENE}


@pytest.mark.parametrize("tile", [0.25, 0.65, 0.85])
def test_a_second_thing_beside_it_still_holds(tile: float) -> None:
    scene = Scene(Policy.HOLD, tile=tile)
    scene.run(1.0)
    scene.run(1.0, DRUM)
    scene.go()
    nearer(scene)
    nearer(scene, Thing(Box(0.33, 0.62, 0.41, 0.74), "tent"))
    assert scene.autopilot.mode == HOLD
    assert scene.opened() == [1, 2]


def test_whoever_takes_over_has_accepted_all_that_stood_and_nothing_else(held: Scene) -> None:
    all_of_it = View((Thing(AHEAD), TENT, Thing(Box(0.34, 0.84, 0.40, 0.94), "box")))
    held.run(1.0, all_of_it)
    held.human(AUTO)
    held.run(5.0)
    assert held.autopilot.mode == AUTO
    held.run(1.0, View((*all_of_it.things, FAR)))
    assert held.autopilot.mode == HOLD


def test_whoever_takes_over_before_what_blocks_is_not_held_for_it(named: Scene) -> None:
    named.human(AUTO)
    named.run(5.0)
    assert named.autopilot.mode == AUTO
    assert named.opened() == [1]
