"""A thing that no word explains, and one that was tapped: where the first is taken for the second."""

from __future__ import annotations

import pytest

from anytraverse.assessment import Reason
from anytraverse.regions import Box
from companion.wire.ids import Outcome
from tests.companion.calls.scenes import ASIDE, AUTO, GNOME, HOLD, MANUAL, SLIVER, Scene, Thing, View

CORNER = Box(0.34, 0.61, 0.44, 0.72)
"""Wider than a tile, and so far aside that it leaves a way beside it."""


def ended(scene: Scene) -> bool:
    """Whether nothing is accepted any more."""
    return not scene.calls.reason_filter.things


@pytest.fixture
def tapped(hold: Scene) -> Scene:
    """Standing before a tuft that no word explains, with another thing tapped long ago: call 1."""
    hold.words[GNOME] = -1.0
    hold.run(1.0, View((Thing(SLIVER),)))
    assert hold.call.reasons == {Reason.UNKNOWN_OBJECT}
    return hold


MISTAKEN = View((Thing(SLIVER, mistaken=0.5),))
"""The tuft, taken for the gnome in part: that explains enough for no call, and leaves a way beside it."""


@pytest.mark.parametrize("flicker", [(MISTAKEN,), (MISTAKEN, View((Thing(SLIVER),)))])
def test_an_accepted_thing_that_is_taken_for_a_tapped_one_is_passed(
    tapped: Scene, flicker: tuple[View, ...]
) -> None:
    tapped.go()
    tapped.run(4.0, *flicker)
    assert tapped.autopilot.mode == AUTO
    assert tapped.opened() == [1]
    assert not ended(tapped), "it is not gone because it has a name"


def test_a_call_for_what_is_hardly_named_points_at_it_and_a_go_passes_it(hold: Scene) -> None:
    hold.words[GNOME] = -1.0
    dim = Thing(SLIVER, unsure=0.7, blur=0.4)
    worse_without_a_name = Thing(ASIDE, unsure=0.61)
    view = View((dim, worse_without_a_name))
    hold.run(1.0, view)
    seen = hold.call.seen
    assert seen is not None
    assert seen.roi is not None
    assert seen.tile is not None
    assert seen.reasons == {Reason.UNKNOWN_OBJECT}
    assert seen.tile.box.left < 0.5 < seen.roi.worst_tile.box.right, "not the worst one, which is allowed"
    hold.go()
    hold.run(3.0, view)
    assert hold.autopilot.mode == AUTO


def test_what_was_accepted_does_not_cover_a_tapped_thing_beside_it(tapped: Scene) -> None:
    tapped.go()
    tapped.run(2.0)
    tapped.run(1.0, View((Thing(SLIVER), Thing(ASIDE, mistaken=0.5))))
    assert tapped.autopilot.mode == HOLD


def test_a_tapped_thing_beside_the_one_that_is_asked_about_blocks_after_the_go_and_calls_no_more(
    hold: Scene,
) -> None:
    hold.words[GNOME] = -1.0
    both = View((Thing(SLIVER), Thing(ASIDE, mistaken=0.5)))
    hold.run(1.0, both)
    assert hold.opened() == [1]
    hold.go()
    hold.run(5.0, both)
    assert (hold.autopilot.mode, hold.opened()) == (HOLD, [1])
    assert hold.calls.reason_filter.reasons(hold.now) == {Reason.BLOCKED}
    hold.run(1.0, View((Thing(SLIVER),)))
    assert (hold.autopilot.mode, hold.opened()) == (AUTO, [1])


@pytest.mark.parametrize("apart", [1, 2, 5])
def test_so_does_one_beside_a_stranger_thing_that_is_larger_than_a_tile(hold: Scene, apart: int) -> None:
    hold.words[GNOME] = -1.0
    right = ASIDE.left - apart / 60
    tuft = Thing(Box(right - 3 / 60, ASIDE.top, right, ASIDE.bottom), "tuft")
    hold.run(1.0, View((tuft, Thing(ASIDE, mistaken=1.0))))
    assert hold.opened() == [1]
    hold.go()
    hold.run(5.0)
    assert (hold.autopilot.mode, hold.opened()) == (HOLD, [1])
    assert hold.calls.reason_filter.reasons(hold.now) == {Reason.BLOCKED}
    hold.run(1.0, View((tuft,)))
    assert (hold.autopilot.mode, hold.opened()) == (AUTO, [1])


def test_a_tapped_thing_that_was_not_asked_about_is_not_accepted_by_a_go(hold: Scene) -> None:
    hold.words[GNOME] = -1.0
    hold.run(1.0, MISTAKEN)
    hold.go()
    hold.run(3.0, MISTAKEN)
    assert hold.autopilot.mode == HOLD


@pytest.fixture
def knowing(hold: Scene) -> Scene:
    """Driving over a clear trail, with a thing tapped long ago."""
    hold.words[GNOME] = -1.0
    return hold


@pytest.mark.parametrize("mistaken", [0.0, 0.3, 0.5, 0.7, 1.0])
def test_a_go_passes_a_thing_however_much_of_it_is_taken_for_a_tapped_one(
    knowing: Scene, mistaken: float
) -> None:
    knowing.run(1.0, View((Thing(CORNER),)))
    knowing.go()
    knowing.run(4.0, View((Thing(CORNER, mistaken=mistaken),)))
    assert knowing.autopilot.mode == AUTO
    assert knowing.opened() == [1]


def test_a_call_for_what_is_taken_for_a_tapped_one_in_part_needs_one_go(knowing: Scene) -> None:
    view = View((Thing(CORNER, mistaken=0.3),))
    knowing.run(1.0, view)
    knowing.go()
    knowing.run(4.0, view)
    assert knowing.autopilot.mode == AUTO
    assert knowing.opened() == [1]


def moved(top: float, mistaken: float, *behind: Thing) -> View:
    """The accepted tuft on its way down the image."""
    return View((Thing(Box(0.40, top, 0.40 + 2 / 60, top + 0.12), mistaken=mistaken), *behind))


def test_an_accepted_thing_is_followed_down_the_image_by_whatever_name(knowing: Scene) -> None:
    knowing.run(1.0, moved(0.62, 0.0))
    knowing.go()
    knowing.run(1.0, moved(0.62, 0.0))
    for step in range(12):
        knowing.run(0.3, moved(0.62 + 0.02 * step, 0.5))
    assert knowing.autopilot.mode == AUTO
    assert knowing.opened() == [1]


@pytest.mark.parametrize("mistaken", [0.0, 0.5])
def test_a_tapped_thing_that_comes_behind_the_accepted_one_holds(knowing: Scene, mistaken: float) -> None:
    knowing.run(1.0, moved(0.62, 0.0))
    knowing.go()
    knowing.run(1.0, moved(0.62, 0.0))
    assert knowing.autopilot.mode == AUTO
    for step in range(12):
        top = 0.62 + 0.02 * step
        gnome = Thing(Box(0.40, top - 0.27, 0.40 + 2 / 60, top - 0.05), mistaken=0.5)
        knowing.run(0.2, moved(top, mistaken, gnome))
    assert knowing.autopilot.mode == HOLD


def test_a_go_to_the_call_that_a_blocked_hold_became_is_not_kept_back_by_it(knowing: Scene) -> None:
    knowing.run(1.0, MISTAKEN)
    wider = View((Thing(Box(SLIVER.left, SLIVER.top, SLIVER.left + 3 / 60, SLIVER.bottom), mistaken=1 / 3),))
    knowing.run(1.0, wider)
    assert knowing.held() == [{Reason.BLOCKED}]
    assert knowing.call.reasons == {Reason.UNKNOWN_OBJECT}
    knowing.go()
    knowing.run(3.0, wider)
    assert knowing.autopilot.mode == AUTO
    assert knowing.closed() == [(2, Outcome.ACCEPTED)]


@pytest.mark.parametrize("later", [View((Thing(SLIVER),)), View((Thing(SLIVER, unsure=0.7, blur=0.4),))])
def test_whoever_took_over_from_a_tapped_thing_is_not_called_for_it_without_a_name(
    knowing: Scene, later: View
) -> None:
    knowing.run(1.0, MISTAKEN)
    assert knowing.held() == [{Reason.BLOCKED}]
    knowing.human(MANUAL)
    knowing.human(AUTO)
    knowing.run(4.0, later)
    assert knowing.autopilot.mode == AUTO
    assert knowing.opened() == []
    knowing.run(1.0, View((Thing(SLIVER), Thing(ASIDE))))
    assert knowing.autopilot.mode == HOLD
