"""Who counts as overridden while the companion guides, and when modes and targets come."""

from __future__ import annotations

import json
from random import Random

import pytest

from bench.modes.guided import (
    AROUND,
    BY_MODE,
    CLICKS,
    COMMANDED,
    MAY_MOVE,
    GuidedOutcome,
    GuidedTrial,
    draw,
    figures,
    play,
)
from bench.stopping.faults import GUIDING
from bench.stopping.jobs import Run, verdict
from bench.stopping.limits import Limit
from bench.stopping.stops import Stop
from bench.stopping.wire import TARGET, Wire

STEPS = {
    "ready": 6.0,
    "GUIDED asked for": 6.4,
    "GUIDED": 6.5,
    "guides": 8.0,
    "AUTO asked for": 9.5,
    "AUTO": 9.6,
}


def outcome(
    does: str, inside: str = "GUIDED by script", changes: tuple[str, ...] = (), moved: float = 0.0
) -> GuidedOutcome:
    return GuidedOutcome(0.0, GuidedTrial("guides", does, 0.0, 8.0, first=True), inside, changes, "", moved)


def test_a_mode_of_ours_after_the_human_s_overrides_and_so_do_targets_that_go_on() -> None:
    assert not outcome("MANUAL").overridden
    assert outcome("MANUAL", changes=("AUTO by companion",)).overridden
    assert outcome("go to a place", changes=("HOLD by script",)).overridden
    assert not outcome(COMMANDED, moved=MAY_MOVE).overridden
    anew = ("HOLD by script", "GUIDED by script")
    assert not outcome("target", changes=anew).overridden, "it stops by no target, and GUIDED is the human's"
    assert outcome("target", changes=(*anew, "HOLD by script")).overridden
    assert outcome("MANUAL", changes=anew).overridden
    assert outcome(COMMANDED, moved=MAY_MOVE + 0.01).overridden


def test_a_target_in_auto_sets_no_mode_so_that_only_guided_would_be_taken_from_a_human() -> None:
    held = outcome("target", "AUTO by hand", ("HOLD by companion",))
    assert not held.overridden
    assert outcome("target", "AUTO by hand", ("GUIDED by companion", "HOLD by companion")).overridden
    assert outcome("HOLD", "AUTO by hand", ("HOLD by companion",)).overridden
    found = figures([held, outcome("MANUAL", changes=("AUTO by script",))], without=1)
    assert (found["trials"], found["overridden"], found["not_guided"]) == (2, 1, 1)
    assert found["does"]["MANUAL"] == {"trials": 1, "overridden": 1}
    json.dumps(found)


def test_a_human_acts_about_each_step_and_sets_auto_only_where_it_does_not_stand() -> None:
    drawn = [draw(Random(number), STEPS) for number in range(600)]
    assert {one.step for one in drawn} == set(STEPS)
    assert {one.does for one in drawn} == {*BY_MODE, COMMANDED, *CLICKS}
    assert all(abs(one.at - STEPS[one.step]) <= AROUND for one in drawn)
    assert all(STEPS["GUIDED"] < one.at < STEPS["AUTO"] for one in drawn if one.does == "AUTO")


def test_a_daemon_and_the_script_hand_the_vehicle_over_and_leave_it_to_a_human() -> None:
    pytest.importorskip("lupa.lua53", reason="the script on the autopilot runs in Lua 5.3")
    found = list(play(0.02, 1, "a test"))
    assert len(found) == 1
    assert not any(one.overridden for one in found), found


def test_a_guided_rover_may_go_three_metres_however_fast_it_is() -> None:
    slow, fast = Limit(1.0, 1.5, 0.2, most=3.0), Limit(1.0, 1.5, 1.5, most=3.0)
    assert slow.metres == Limit(1.0, 1.5, 0.2).metres < 3.0
    assert fast.metres == 3.0 < Limit(1.0, 1.5, 1.5).metres
    far = Stop(stands=True, seconds=4.0, metres=3.1, limit=fast, speed=1.5, zone="meadow", by="script")
    assert Run("sigstop", 1, verdict(far), far).wrong
    assert len(GUIDING) == 7


def test_a_target_by_which_it_is_guided_is_no_order_to_hold() -> None:
    wire = Wire(9)
    try:
        wire.commands, wire.commanded_at = [TARGET, TARGET, "COMMAND_LONG 176 1 4"], [1.0, 2.0, 3.0]
        assert wire.ordered(1.5) == 3.0
        assert wire.ordered(3.5) is None
    finally:
        wire.close()
