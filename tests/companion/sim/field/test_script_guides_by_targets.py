"""A rover that the script guides and whose targets stop coming is braked and held, and nobody else is."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import development as mavlink

from tests.companion.sim.field.guiding import (
    ACCEPTED,
    CHANGED,
    FAILED,
    GUIDE,
    LONGEST,
    LOST,
    STATION,
    STOPPED,
    Guiding,
    own_target,
)
from tests.companion.sim.field.stubs import AUTO, BY_GCS, CYCLE, GUIDED, HOLD, SCRIPTING

pytest.importorskip("lupa.lua53", reason="the script runs in Lua 5.3")


@pytest.mark.parametrize("seconds", [0.0, 1.0, LONGEST])
def test_without_one_for_0_7_s_it_brakes_and_holds_though_heartbeats_come(seconds: float) -> None:
    asked = Guiding(seconds).guided()
    taken = asked.serial
    asked.streams = False
    told = asked.answers(seconds=LOST - CYCLE)
    assert (asked.board.mode_now, told) == (GUIDED, [])
    assert asked.answers(seconds=3 * CYCLE) == [(taken, ACCEPTED)]
    assert asked.set_modes == ([HOLD, GUIDED] if seconds else [HOLD])
    assert asked.until_held() <= seconds + CYCLE
    asked.live(CYCLE)
    assert STOPPED in asked.board.texts(2)
    assert ("Braking: guiding stopped" in asked.board.texts(2)) is (seconds > 0)
    asked.live(30.0)
    assert asked.shows == (HOLD, SCRIPTING)


def test_that_hold_is_said_every_10_s_until_somebody_sets_a_mode() -> None:
    asked = Guiding().guided()
    asked.streams = False
    asked.live(40.0)
    assert 3 <= asked.board.texts(2).count(STOPPED) <= 4
    asked.board.human_sets(AUTO)
    asked.live(1.0)
    before = len(asked.board.said)
    asked.live(20.0)
    assert asked.board.said[before:] == []
    assert asked.shows == (AUTO, BY_GCS)


def test_the_companion_resumes_auto_out_of_it() -> None:
    asked = Guiding().guided()
    asked.streams = False
    asked.live(LOST + LONGEST + 1)
    assert asked.ask(AUTO, HOLD, hold=9) == [ACCEPTED]
    assert asked.shows == (AUTO, SCRIPTING)


def test_or_takes_it_for_its_own_hold() -> None:
    asked = Guiding().guided()
    asked.streams = False
    asked.live(LOST + LONGEST + 1)
    assert asked.ask(HOLD, GUIDED, hold=9) == [ACCEPTED]
    assert asked.ask(AUTO, HOLD, hold=8) == [FAILED]
    assert asked.ask(AUTO, HOLD, hold=9) == [ACCEPTED]


def test_a_companion_that_dies_is_held_for_its_targets_first_and_then_for_its_silence() -> None:
    asked = Guiding(1.0).guided()
    asked.streams = asked.beats = False
    assert asked.until_held() <= LOST + 1.0 + 3 * CYCLE
    asked.live(2.0)
    assert "Braking: guiding stopped" in asked.board.texts(2)
    assert asked.board.texts(2)[-1] == "HOLD: companion silent. AUTO again = go blind"


def test_one_that_says_no_more_that_it_guides_is_held_too() -> None:
    asked = Guiding().guided()
    asked.guides = asked.streams = False
    assert asked.until_held() <= LOST + LONGEST + 3 * CYCLE


@pytest.mark.parametrize("parameters", [{"ATS_ENABLE": 0.0}, {"ATS_MODES": 1024.0}])
def test_what_the_owner_switched_off_does_not_keep_it_driving(parameters: dict[str, float]) -> None:
    asked = Guiding(**parameters).guided()
    asked.streams = asked.beats = False
    assert asked.until_held() <= LOST + LONGEST + 3 * CYCLE
    asked.live(CYCLE)
    assert asked.board.texts(2)[-1].startswith("HOLD: ")


def test_those_of_another_component_or_vehicle_and_damaged_ones_do_not_count() -> None:
    damaged = bytearray(own_target().pack(mavlink.MAVLink(None, 1, 191)))
    damaged[-1] ^= 1
    for frame in (
        damaged,
        own_target(system=2).pack(mavlink.MAVLink(None, 1, 191)),
        own_target(system=2).pack(STATION),
        own_target(system=2).pack(mavlink.MAVLink(None, 2, 191)),
    ):
        asked = Guiding(0.0).guided()
        asked.streams = False
        for _ in range(10):
            asked.board.hear(frame)
            asked.live(CYCLE)
        assert asked.board.mode_now == HOLD


def test_at_5_hz_they_keep_it_guiding_and_so_do_three_lost_ones() -> None:
    for every in (2, 6):
        asked = Guiding().guided()
        asked.streams = False
        for step in range(100):
            if step % every == 0:
                asked.hears(own_target())
            asked.live(CYCLE)
        assert asked.set_modes == []


def test_none_counts_for_a_rover_that_is_disarmed() -> None:
    asked = Guiding().guided()
    asked.board.armed = False
    asked.live(CYCLE)
    assert asked.board.mode_now == HOLD


def test_a_hold_that_is_refused_is_tried_again() -> None:
    asked = Guiding(0.0).guided()
    asked.streams, asked.board.obeys = False, False
    asked.live(3.0)
    assert asked.board.mode_now == GUIDED
    asked.board.obeys = True
    asked.live(CYCLE)
    assert asked.board.mode_now == HOLD


def test_after_a_restart_of_scripting_nothing_is_claimed() -> None:
    asked = Guiding().guided()
    asked.board.scripting.restart()
    asked.live(CYCLE)
    assert asked.ask(AUTO, GUIDED, hold=GUIDE) == [CHANGED]
    asked.streams = False
    asked.live(3.0)
    assert asked.board.mode_now == GUIDED, "the autopilot itself stops for want of a target"
    assert asked.ask(HOLD, GUIDED) == [ACCEPTED]


def test_a_flood_of_them_costs_no_heartbeat_and_stays_within_the_instructions() -> None:
    asked = Guiding().guided()
    for step in range(60):
        if step % 10 == 0:
            asked.beat()
        for _ in range(19):
            asked.hears(own_target())
        asked.beats = asked.streams = False
        asked.live(CYCLE)
    assert asked.board.scripting.ended == ""
    assert asked.set_modes == []
