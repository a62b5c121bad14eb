"""Who counts as overridden, the moments at which a mode is set by hand, and the delay of the wire."""

from __future__ import annotations

import socket
import threading
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from bench.modes.judging import ModeOutcome, ModeSetting, ModeTrial, drove, figures, since_human
from bench.modes.trials import EARLY, HUMANS, IN_BRAKE, LATE, draw, play_all
from bench.stopping.wire import Wire

ROOT = Path(__file__).parents[2]
SCRIPT, NONE = (ModeSetting(script=script, delay=0.1, busy=False) for script in (True, False))
TRIAL = ModeTrial("resume", "MANUAL", "leaves", 0.02)


def log(*changes: str) -> list[dict[str, Any]]:
    """Entries of a mode log, one a second from 1.0: "MODE who"."""
    return [
        {"t": 1.0 + number, "mode": change.split()[0], "by": change.split()[1]}
        for number, change in enumerate(changes)
    ]


def outcome(setting: ModeSetting, after: list[dict[str, Any]], until: float) -> ModeOutcome:
    longest, ended = drove(after, until)
    return ModeOutcome(setting, TRIAL, 0.02, tuple(row["mode"] for row in after), longest, ended)


def test_what_the_companion_sets_after_the_human_counts_and_what_it_set_before_does_not() -> None:
    rows = log("AUTO hand", "HOLD companion", "AUTO companion", "MANUAL hand")
    assert since_human(rows, "MANUAL", 0.0) == []
    rows += log("AUTO hand", "HOLD companion", "AUTO companion", "MANUAL hand", "AUTO companion")[4:]
    assert since_human(rows, "MANUAL", 0.0) == rows[4:]
    assert since_human(rows, "MANUAL", 4.5) is None
    assert since_human(rows, "LOITER", 0.0) is None


def test_hold_pressed_inside_our_hold_has_no_entry_and_one_pressed_after_our_resume_has() -> None:
    overridden = log("AUTO hand", "HOLD script", "AUTO script")
    assert since_human(overridden, "HOLD", 1.5) == overridden[2:]
    in_time = log("AUTO hand", "HOLD script", "AUTO script", "HOLD gcs")
    assert since_human(in_time, "HOLD", 1.5) == []


def test_an_override_by_a_driving_mode_lasts_until_the_next_mode() -> None:
    rows = log("AUTO companion", "HOLD companion")
    assert drove(rows, 9.0) == (1.0, True)
    assert drove(rows[:1], 9.0) == (8.0, False)
    assert drove(rows[1:], 9.0) == (None, True)
    assert drove([], 9.0) == (None, True)


def test_with_the_script_nobody_may_be_overridden_and_without_it_nobody_for_long() -> None:
    auto, hold = log("AUTO companion", "HOLD companion"), log("HOLD companion")
    assert outcome(SCRIPT, [], 3.0).good
    assert not outcome(SCRIPT, hold, 3.0).good
    assert outcome(NONE, hold, 3.0).good
    assert not outcome(NONE, auto, 3.0).good, "1 s is longer than 0.2 s and half a second"
    assert not outcome(NONE, auto[:1], 1.3).good, "it has not ended"
    quick = [auto[0], {**auto[1], "t": 1.6}]
    assert outcome(NONE, quick, 3.0).good
    found = figures([outcome(SCRIPT, [], 3.0), outcome(NONE, quick, 3.0), outcome(NONE, hold, 3.0)])
    assert (found["trials"], found["overridden_with_script"], found["overridden_without"]) == (3, 0, 2)
    assert (found["longest_override_s"], found["worst_over_round_trip_s"]) == (0.6, 0.4)
    assert found["driven_over_without"] == 1
    assert [one["overridden"] for one in found["settings"]] == [0, 2]


def test_trials_lie_round_both_moments_of_a_command() -> None:
    for setting in (SCRIPT, NONE):
        drawn = [draw(Random(number), setting) for number in range(300)]
        assert {one.mode for one in drawn} == {*HUMANS, *(["HOLD"] if setting.script else [])}
        assert {(one.command, one.moment) for one in drawn} == {
            (command, moment) for command in ("hold", "resume") for moment in ("leaves", "arrives")
        }
        assert all(EARLY <= one.offset <= LATE for one in drawn)
        late = [one for one in drawn if one.kept]
        assert late
        assert all(one.offset + setting.delay + one.kept == pytest.approx(0.0, abs=0.002) for one in late)


def test_the_wire_takes_its_time_each_way_and_keeps_a_command_with_what_comes_after_it() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
        autopilot.bind(("127.0.0.1", 0))
        autopilot.settimeout(2.0)
        with (
            closing(Wire(autopilot.getsockname()[1], delay=0.1)) as wire,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as companion,
        ):
            companion.settimeout(2.0)
            companion.connect(("127.0.0.1", int(wire.url.rpartition(":")[2])))
            orders = []
            wire.ordered_now = lambda order, _: orders.append(order) or 0.2  # type: ignore[func-returns-value]
            mav = mavlink.MAVLink(None, 1, 191)
            begun = time.monotonic()
            hold = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 4, 0, 0, 0, 0, 0).pack(mav)
            beat = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3).pack(mav)
            companion.send(hold)
            companion.send(beat)
            assert autopilot.recv(1000) == hold
            assert time.monotonic() - begun >= 0.3
            datagram, sender = autopilot.recvfrom(1000)
            assert datagram == beat
            begun = time.monotonic()
            autopilot.sendto(b"answer", sender)
            assert companion.recv(1000) == b"answer"
            assert time.monotonic() - begun >= 0.1
            assert orders == ["COMMAND_LONG 176 1 4"]


def test_a_human_is_not_overridden_where_the_script_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("lupa.lua53", reason="the script on the autopilot runs in Lua 5.3")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    setting = ModeSetting(script=True, delay=0.02, busy=False)
    found = list(play_all(setting, 2, 5, tmp_path, threading.Event()))
    outcomes = [one for one in found if isinstance(one, ModeOutcome)]
    assert len(outcomes) == 2, found
    assert not any(one.overridden for one in outcomes), outcomes


def test_where_the_script_brakes_modes_come_before_in_and_after_the_brake() -> None:
    setting = ModeSetting(script=True, delay=0.1, busy=False, brakes=True)
    drawn = [draw(Random(number), setting) for number in range(300)]
    assert {one.mode for one in drawn} == {*HUMANS, "GUIDED"}
    assert {(one.command, one.moment) for one in drawn} == {("hold", "arrives")}
    assert min(one.offset for one in drawn) < 0.0
    assert max(one.offset for one in drawn) > IN_BRAKE[1]


def test_guided_pressed_in_the_brake_has_no_entry_and_a_hold_that_begins_anew_overrides_nobody() -> None:
    rows = log("AUTO hand", "GUIDED script", "HOLD companion")
    after = since_human(rows, "GUIDED", 0.0)
    assert after == rows[2:]
    setting = ModeSetting(script=True, delay=0.1, busy=False, brakes=True)
    trial = ModeTrial("hold", "GUIDED", "arrives", 0.5)
    held = ModeOutcome(setting, trial, 0.5, ("HOLD by companion",), None, ended=True, inside="GUIDED")
    assert not held.good
    assert replace(held, again=True).good
    assert figures([held, replace(held, again=True)])["held_again"] == 1
