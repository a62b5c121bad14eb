"""The whole daemon on rovers whose mission ends, in virtual time: only camera and radio are played."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from bench.virtual_time import Clock
from companion.sim.field.autopilot import SimulatedAutopilot
from companion.sim.field.modes import Mode
from companion.sim.field.px4 import Px4
from companion.wire.ids import Motion, Policy
from tests.companion.daemon.rig import MakeRig, Rig
from tests.companion.daemon.test_a_px4_rover import Px4Rig

MISSION = 12.0
"""m, driven in some 6 s."""
DONE = [("AUTO", "hand")]
REFUSED = "C1 mission over, no resume: AUTO by hand"
MakeDriven = Callable[[type[SimulatedAutopilot]], Px4Rig]


@pytest.fixture
def make(tmp_path: Path, clock: Clock) -> Iterator[MakeDriven]:
    """Rigs that begin to drive a mission of 12 m over grass."""
    made: list[Px4Rig] = []

    def build(kind: type[SimulatedAutopilot]) -> Px4Rig:
        made.append(Px4Rig(tmp_path, clock, "loiter", Rig.config, kind, MISSION))
        return made[-1]

    yield build
    for rig in made:
        rig.kill()


@pytest.fixture
def over(make: MakeDriven) -> Px4Rig:
    """An ArduPilot rover that stands in AUTO after its mission."""
    rig = make(SimulatedAutopilot)
    rig.see(25.0)
    assert rig.px4.tour.complete
    assert rig.px4.mode is Mode.AUTO
    assert rig.rover.speed == 0.0
    return rig


@pytest.fixture
def rolling(make: MakeDriven) -> Px4Rig:
    """Held before a drum while it still rolled, its mission just complete."""
    rig = make(SimulatedAutopilot)
    while not rig.px4.tour.complete:
        rig.see(0.1)
    assert rig.rover.speed > 1.0
    rig.see(15.0, "drum")
    assert rig.modes == [*DONE, ("HOLD", "companion")]
    return rig


def test_a_thing_before_a_rover_that_stands_after_its_mission_holds_nothing(over: Px4Rig) -> None:
    over.see(3.0, "drum")
    assert over.state == ("CALLING", 1)
    assert "C1 mission complete: rover stands, not held" in over.texts
    assert over.modes == DONE
    told = over.daemon.status.state_file()
    assert told["mission"] == {"state": "complete", "item": 2, "total": 2, "over": True}
    assert told["held_by"] is None


def test_a_go_does_not_make_it_drive_off(over: Px4Rig) -> None:
    over.see(3.0, "drum")
    at = over.rover.distance
    over.word(1, "drum", 1.0, Motion.GO)
    over.see(10.0)
    assert over.modes == DONE
    assert over.rover.distance == at
    assert over.state == ("OK", 0)


def test_it_is_held_again_in_the_mission_that_a_human_begins_anew(over: Px4Rig) -> None:
    over.px4.set_mode(Mode.HOLD, "hand")
    over.see(1.0)
    over.px4.set_mode(Mode.AUTO, "hand")
    over.see(3.0)
    assert over.rover.speed > 1.5
    over.see(3.0, "drum")
    assert over.modes[-1] == ("HOLD", "companion")
    over.word(1, "drum", 1.0, Motion.GO)
    over.see(4.0, "drum")
    assert over.modes[-1] == ("AUTO", "companion")


def test_a_resume_that_would_begin_it_anew_is_refused_and_the_hold_stands(rolling: Px4Rig) -> None:
    rolling.word(1, "drum", 1.0, Motion.GO)
    rolling.see(10.0, "drum")
    assert REFUSED in rolling.texts
    assert rolling.modes == [*DONE, ("HOLD", "companion")]
    assert rolling.rover.speed == 0.0
    assert rolling.daemon.status.figures()["held_by"] == "companion"
    rolling.px4.set_mode(Mode.AUTO, "hand")
    rolling.see(3.0)
    assert rolling.rover.speed > 1.0
    assert rolling.state == ("OK", 0)


def test_that_is_known_after_a_restart_too(rolling: Px4Rig) -> None:
    rolling.restart()
    rolling.see(4.0, "drum")
    rolling.word(1, "drum", 1.0, Motion.GO)
    rolling.see(6.0, "drum")
    assert REFUSED in rolling.texts
    assert rolling.px4.mode is Mode.HOLD


def test_px4_stands_in_loiter_after_its_mission_and_is_left_there(make: MakeDriven) -> None:
    rig = make(Px4)
    rig.see(25.0)
    ended = [("MISSION", "hand"), ("LOITER", "autopilot")]
    assert rig.modes == ended
    rig.see(3.0, "drum")
    rig.word(1, "drum", 1.0, Motion.GO)
    rig.see(10.0)
    assert rig.modes == ended


class Told:
    """A rig whose autopilot reports what it is told to report of its mission, once a second."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig

    def see(self, seconds: int, thing: str, *message: Any) -> None:
        for _ in range(seconds):
            for one in message:
                self.rig.stage.send(one, (1, 1))
            self.rig.see(1.0, thing)

    @property
    def modes(self) -> list[int]:
        sent = self.rig.stage.sent("COMMAND_LONG")
        return [int(one.param2) for one in sent if one.command == 176]


def current(seq: int, total: int = 0, state: int = 0) -> mavlink.MAVLink_mission_current_message:
    return mavlink.MAVLink_mission_current_message(seq, total, state, 0)


def standing() -> mavlink.MAVLink_global_position_int_message:
    return mavlink.MAVLink_global_position_int_message(0, 470000000, 80000000, 0, 0, 0, 0, 0, 0)


def test_where_no_state_is_reported_it_is_held_after_its_last_item_and_not_resumed(make_rig: MakeRig) -> None:
    told = Told(make_rig(Policy.HOLD))
    told.see(2, "", current(5), standing())
    told.rig.stage.send(mavlink.MAVLink_mission_item_reached_message(5), (1, 1))
    told.see(2, "", current(5), standing())
    told.see(3, "drum", current(5), standing())
    assert told.modes == [4]
    told.rig.word(1, "drum", 1.0, Motion.GO)
    told.see(4, "drum", current(5), standing())
    assert told.modes == [4]
    assert REFUSED in told.rig.texts


@pytest.mark.parametrize(
    ("later", "text"),
    [
        (current(5, 8, 2), "C1 goes on with item 5, set in the hold"),
        (current(1, 9, 2), "C1 goes on with a new mission, item 1"),
    ],
)
def test_a_mission_that_was_changed_in_the_hold_goes_on_as_it_is_and_the_text_says_so(
    rig: Rig, later: mavlink.MAVLink_mission_current_message, text: str
) -> None:
    told = Told(rig)
    told.see(2, "", current(3, 8, 3))
    told.see(3, "drum", current(3, 8, 2))
    told.see(2, "drum", later)
    rig.word(1, "drum", 1.0, Motion.GO)
    told.see(3, "drum", later)
    assert told.modes == [4, 10]
    assert text in rig.texts
    assert "C1 resumed AUTO" in rig.texts


def test_a_mission_that_nobody_changed_goes_on_without_a_word_of_it(rig: Rig) -> None:
    told = Told(rig)
    told.see(2, "", current(3, 8, 3))
    told.see(3, "drum", current(3, 8, 2))
    rig.word(1, "drum", 1.0, Motion.GO)
    told.see(3, "drum", current(3, 8, 3))
    assert told.modes == [4, 10]
    assert not any("goes on" in text for text in rig.texts)
