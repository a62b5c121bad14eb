"""The script changes AUTO to GUIDED and back for a companion that guides."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from tests.companion.sim.field.guiding import (
    ACCEPTED,
    CHANGED,
    FAILED,
    GUIDE,
    IN_PROGRESS,
    LONGEST,
    LOST,
    STATION,
    Guiding,
)
from tests.companion.sim.field.stubs import (
    AUTO,
    BY_GCS,
    BY_RC,
    CYCLE,
    GUIDED,
    HOLD,
    MANUAL,
    RTL,
    SCRIPTING,
)
from tests.companion.sim.field.test_script_brakes import TARGETS

pytest.importorskip("lupa.lua53", reason="the script runs in Lua 5.3")


class TestTakingOver:
    def test_auto_becomes_guided_and_guided_auto_and_the_last_answer_follows(self) -> None:
        asked = Guiding().guided()
        taken = asked.serial
        assert asked.answers(seconds=5.0) == []
        assert asked.answers(lambda: asked.send(AUTO, GUIDED, hold=GUIDE)) == [
            (taken, ACCEPTED),
            (asked.serial, ACCEPTED),
        ]
        assert asked.shows == (AUTO, SCRIPTING)
        assert asked.set_modes == [AUTO]
        asked.streams = False
        assert asked.answers(seconds=5.0) == []
        assert asked.board.mode_now == AUTO

    @pytest.mark.parametrize("expected", [GUIDED, AUTO])
    def test_guided_is_not_set_again_over_a_human_s_auto(self, expected: int) -> None:
        asked = Guiding().guided()
        assert asked.ask(GUIDED, GUIDED, hold=GUIDE) == [IN_PROGRESS]
        asked.board.human_sets(AUTO)
        told = asked.answers(lambda: asked.send(GUIDED, expected, hold=GUIDE))
        assert (asked.serial, CHANGED) in told
        assert asked.shows == (AUTO, BY_GCS)
        assert asked.set_modes == []

    def test_auto_that_is_asked_for_again_since_the_answer_was_lost_is_granted_again(self) -> None:
        asked = Guiding().guided()
        asked.ask(AUTO, GUIDED, hold=GUIDE)
        assert asked.ask(AUTO, GUIDED, hold=GUIDE) == [ACCEPTED]
        assert asked.set_modes == [AUTO]
        asked.board.human_sets(MANUAL)
        asked.board.human_sets(AUTO)
        assert asked.ask(AUTO, GUIDED, hold=GUIDE) == [CHANGED]

    def test_a_companion_that_says_that_it_guides_no_more_is_stopped_though_its_targets_come(self) -> None:
        asked = Guiding().guided()
        asked.guides = False
        asked.live(CYCLE)
        asked.streams = False
        asked.live(LONGEST + 1.0)
        assert asked.board.mode_now == HOLD

    def test_only_where_the_companion_s_heartbeat_says_that_it_guides(self) -> None:
        asked = Guiding()
        asked.guides = False
        asked.live(CYCLE)
        assert asked.ask(GUIDED, AUTO, hold=GUIDE) == [FAILED]
        asked.guides = True
        assert asked.ask(GUIDED, AUTO, hold=GUIDE) == [IN_PROGRESS]

    def test_nor_on_the_word_of_a_heartbeat_that_is_older_than_the_time_out(self) -> None:
        asked = Guiding(ATS_ENABLE=0.0)
        asked.beats = False
        asked.live(2.0)
        assert asked.ask(GUIDED, AUTO, hold=GUIDE) == [FAILED]

    @pytest.mark.parametrize("mode", [MANUAL, HOLD, RTL, GUIDED, 5])
    def test_only_out_of_auto(self, mode: int) -> None:
        asked = Guiding()
        asked.board.human_sets(mode)
        assert asked.ask(GUIDED, AUTO, hold=GUIDE) == [CHANGED]
        assert asked.ask(GUIDED, mode, hold=GUIDE) == [CHANGED if mode == GUIDED else FAILED]
        assert asked.shows == (mode, BY_GCS)

    def test_only_while_armed(self) -> None:
        asked = Guiding()
        asked.board.armed = False
        assert asked.ask(GUIDED, AUTO, hold=GUIDE) == [FAILED]

    @pytest.mark.parametrize("command", TARGETS)
    def test_not_where_a_target_of_another_was_seen_in_the_last_5_s(self, command: Callable[[], Any]) -> None:
        asked = Guiding()
        asked.hears(command(), STATION)
        asked.live(4.5)
        assert asked.ask(GUIDED, AUTO, hold=GUIDE) == [FAILED]
        asked.live(1.0)
        assert asked.ask(GUIDED, AUTO, hold=GUIDE) == [IN_PROGRESS]

    def test_nor_where_no_place_is_left_to_hear_targets(self) -> None:
        asked = Guiding()
        asked.board.scripting.open_queue(10, 5)
        asked.live(CYCLE)
        assert asked.ask(GUIDED, AUTO, hold=GUIDE) == [FAILED]

    def test_nor_where_the_autopilot_refuses_it(self) -> None:
        asked = Guiding()
        asked.board.obeys = False
        assert asked.ask(GUIDED, AUTO, hold=GUIDE) == [FAILED]

    @pytest.mark.parametrize("mode", [GUIDED, MANUAL, HOLD])
    def test_a_human_who_is_faster_keeps_the_mode(self, mode: int) -> None:
        asked = Guiding()
        asked.board.meet(lambda: asked.board.human_sets(mode, BY_RC), 0 if mode == GUIDED else 1)
        assert asked.ask(GUIDED, AUTO, hold=GUIDE) == [CHANGED]
        asked.live(LOST + LONGEST + 1)
        assert asked.shows == (mode, BY_RC)

    def test_the_id_for_guiding_sets_and_resumes_nothing_else(self) -> None:
        asked = Guiding()
        for mode, expected in ((HOLD, AUTO), (MANUAL, AUTO), (AUTO, AUTO), (RTL, GUIDED)):
            assert asked.ask(mode, expected, hold=GUIDE) == [FAILED]
        assert asked.ask(HOLD, AUTO, hold=7) == [IN_PROGRESS]
        asked.until_held()
        assert asked.ask(AUTO, HOLD, hold=GUIDE) == [FAILED]
        assert asked.ask(GUIDED, HOLD, hold=GUIDE) == [FAILED]
        assert asked.board.mode_now == HOLD

    def test_one_that_is_asked_for_again_is_answered_once_more_and_counts_once(self) -> None:
        asked = Guiding().guided()
        number = asked.serial
        assert asked.ask(GUIDED, AUTO, hold=GUIDE, serial=number) == [IN_PROGRESS]
        assert asked.ask(GUIDED, AUTO, hold=GUIDE, serial=500) == [IN_PROGRESS]
        assert asked.set_modes == []
        assert asked.answers(lambda: asked.board.human_sets(AUTO)) == [(500, CHANGED)]
        assert asked.ask(GUIDED, AUTO, hold=GUIDE, serial=500) == [CHANGED]
        assert asked.shows == (AUTO, BY_GCS), "it was set once"

    def test_a_lost_answer_to_the_way_back_is_given_again(self) -> None:
        asked = Guiding().guided()
        assert asked.ask(AUTO, GUIDED, hold=GUIDE, serial=600)[-1] == ACCEPTED
        assert asked.ask(AUTO, GUIDED, hold=GUIDE, serial=600) == [ACCEPTED]


class TestWayBack:
    @pytest.mark.parametrize("reason", [BY_GCS, BY_RC])
    @pytest.mark.parametrize("mode", [MANUAL, HOLD, RTL, GUIDED, 5])
    def test_over_a_human_s_mode_nothing_is_set(self, mode: int, reason: int) -> None:
        asked = Guiding().guided()
        asked.board.human_sets(MANUAL if mode == GUIDED else AUTO, reason)
        asked.board.human_sets(mode, reason)
        assert asked.ask(AUTO, GUIDED, hold=GUIDE)[-1] == CHANGED
        asked.live(LOST + LONGEST + 1)
        assert asked.shows == (mode, reason)
        assert asked.set_modes == []

    def test_a_human_s_guided_that_was_never_ours_is_left_alone(self) -> None:
        asked = Guiding()
        asked.board.human_sets(GUIDED)
        assert asked.ask(AUTO, GUIDED, hold=GUIDE) == [CHANGED]
        assert asked.shows == (GUIDED, BY_GCS)

    def test_nor_is_a_guided_that_was_resumed_out_of_a_hold(self) -> None:
        asked = Guiding(0.0)
        asked.board.human_sets(GUIDED)
        assert asked.ask(HOLD, GUIDED) == [ACCEPTED]
        assert asked.ask(GUIDED, HOLD) == [ACCEPTED]
        assert asked.shows == (GUIDED, SCRIPTING)
        assert asked.ask(AUTO, GUIDED, hold=GUIDE) == [CHANGED]
        asked.live(3.0)
        assert asked.board.mode_now == GUIDED

    def test_where_the_autopilot_refuses_auto_it_goes_on_guiding(self) -> None:
        asked = Guiding().guided()
        asked.board.obeys = False
        assert asked.ask(AUTO, GUIDED, hold=GUIDE) == [FAILED]
        asked.board.obeys = True
        assert asked.ask(AUTO, GUIDED, hold=GUIDE)[-1] == ACCEPTED

    @pytest.mark.parametrize("which", [0, 1])
    @pytest.mark.parametrize("mode", [MANUAL, HOLD, RTL])
    def test_a_human_who_is_faster_than_the_answer_keeps_the_mode(self, mode: int, which: int) -> None:
        asked = Guiding().guided()
        taken = asked.serial
        asked.board.meet(lambda: asked.board.human_sets(mode, BY_RC), which)
        results = asked.answers(lambda: asked.send(AUTO, GUIDED, hold=GUIDE))
        assert results[0] == (taken, results[1][1])
        # Before the mode is set there is nothing that could be compared: these calls stand side by side.
        assert asked.shows == ((AUTO, SCRIPTING) if which == 0 else (mode, BY_RC))
        assert results[1][1] == (ACCEPTED if which == 0 else CHANGED)
        asked.live(LOST + LONGEST + 1)
        assert asked.shows == ((AUTO, SCRIPTING) if which == 0 else (mode, BY_RC))
