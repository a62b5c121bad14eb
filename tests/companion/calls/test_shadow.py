"""Shadow policy: what would have been held, for how long, and over which time that was counted."""

from __future__ import annotations

import pytest

from anytraverse.assessment import Reason
from companion.calls.decisions import SetMode, WouldHold, WouldResume
from companion.wire.ids import Policy
from tests.companion.calls.scenes import AUTO, CLEAR, DRUM, HOLD, LOG, MANUAL, Scene

DRUM_AHEAD = frozenset({Reason.UNKNOWN_OBJECT})


@pytest.fixture
def shadow() -> Scene:
    """Driving in AUTO over a clear trail, in shadow policy."""
    scene = Scene(Policy.SHADOW)
    scene.run(1.0)
    return scene


def test_a_would_be_hold_lasts_until_as_many_frames_are_ok_as_a_resume_needs(shadow: Scene) -> None:
    shadow.run(2.0, DRUM)
    shadow.run(2.0, CLEAR)
    (began,) = shadow.all(WouldHold)
    (over,) = shadow.all(WouldResume)
    assert (began.number, began.reasons) == (over.number, over.reasons) == (1, DRUM_AHEAD)
    assert not over.by_hand
    assert over.lasted == pytest.approx(2.0 - 0.2 + 0.5, abs=0.15)


def test_would_be_holds_are_numbered_on(shadow: Scene) -> None:
    for _ in range(3):
        shadow.run(1.0, LOG)
        shadow.run(1.0, CLEAR)
    assert [one.number for one in shadow.all(WouldHold)] == [1, 2, 3]
    assert [one.number for one in shadow.all(WouldResume)] == [1, 2, 3]


def test_what_is_held_in_the_shadow_is_what_the_hold_policy_holds() -> None:
    scenes = [Scene(Policy.SHADOW), Scene(Policy.HOLD)]
    for scene in scenes:
        scene.run(1.0)
        scene.run(1.0, DRUM)
    would, held = scenes[0].log, scenes[1].log
    began = next(at for at, one in would if isinstance(one, WouldHold))
    assert began == next(at for at, one in held if isinstance(one, SetMode))
    assert [one.reasons for one in scenes[0].all(WouldHold)] == scenes[1].held()


@pytest.mark.parametrize("mode", [MANUAL, HOLD])
def test_a_human_who_takes_over_ends_it(shadow: Scene, mode: int) -> None:
    shadow.run(1.0, DRUM)
    shadow.human(mode)
    assert [over.by_hand for over in shadow.all(WouldResume)] == [True]
    shadow.run(3.0)
    assert len(shadow.all(WouldHold)) == 1


def test_an_autopilot_that_falls_silent_ends_nothing(shadow: Scene) -> None:
    shadow.run(1.0, DRUM)
    shadow.autopilot.silent = True
    shadow.run(8.0)
    assert shadow.all(WouldResume) == []
    assert len(shadow.all(WouldHold)) == 1


@pytest.mark.parametrize("policy", [Policy.REPORT, Policy.HOLD, Policy.OFF])
def test_another_policy_ends_it(shadow: Scene, policy: Policy) -> None:
    shadow.run(1.0, DRUM)
    shadow.policy(policy)
    assert [over.by_hand for over in shadow.all(WouldResume)] == [True]
    assert not shadow.calls.shadow.open


def test_only_time_in_which_a_hold_could_begin_is_watched(shadow: Scene) -> None:
    watched = shadow.calls.shadow.watched
    assert watched == pytest.approx(1.0, abs=0.1)
    shadow.human(MANUAL)
    shadow.run(10.0)
    shadow.human(AUTO, armed=False)
    shadow.run(10.0)
    assert shadow.calls.shadow.watched == pytest.approx(watched, abs=0.15)
    shadow.human(AUTO)
    shadow.run(5.0, CLEAR)
    assert shadow.calls.shadow.watched == pytest.approx(watched + 5.0, abs=0.2)


def test_a_would_be_hold_is_watched_time_too(shadow: Scene) -> None:
    watched = shadow.calls.shadow.watched
    shadow.run(10.0, DRUM)
    assert shadow.calls.shadow.watched == pytest.approx(watched + 10.0, abs=0.1)


def test_a_daemon_that_was_stopped_has_watched_nothing_meanwhile() -> None:
    shadow = Scene(Policy.SHADOW)
    shadow.autopilot.silent = True
    shadow.run(1.0)
    watched = shadow.calls.shadow.watched
    assert watched == pytest.approx(1.0, abs=0.1), "without any autopilot all time counts"
    shadow.now += 600.0
    shadow.calls.tick(shadow.now)
    assert shadow.calls.shadow.watched == watched


@pytest.mark.parametrize("policy", [Policy.REPORT, Policy.HOLD, Policy.OFF])
def test_no_other_policy_watches_or_counts(policy: Policy) -> None:
    scene = Scene(policy)
    scene.run(1.0)
    scene.run(5.0, DRUM)
    assert scene.calls.shadow.watched == 0
    assert scene.all(WouldHold) == []
    assert scene.calls.shadow.count == 0
