"""The companion downloads its autopilot's mission, over a bad wire and beside another ground station."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.sim.field.autopilot import SimulatedAutopilot
from companion.sim.field.px4 import Px4
from companion.sim.field.router import DatagramParser, Port
from companion.sim.field.rover import Rover
from companion.sim.field.telemetry import degrees_e7
from companion.sim.field.trail import Trail
from companion.sim.loopback_link import LoopbackLink

TRAIL = Trail(1)
STEP = 0.02
US, PILOT = (1, 191), (1, 1)
Spoils = Callable[[Any], bool]


class Wire:
    """The companion's link and a simulated autopilot. `drops`: which frames between them are lost."""

    def __init__(
        self, kind: type[SimulatedAutopilot] = SimulatedAutopilot, length: float | None = 62.0
    ) -> None:
        self.stage = LoopbackLink(vehicle=None)
        self.drops: Spoils = lambda _: False
        self.rover = Rover(TRAIL)
        self.autopilot = kind(self.rover, self._told)
        self.autopilot.tour.length = length
        self.mission = self.stage.link.mission
        self.mission.wanted = True
        self._obeyed = 0

    def _told(self, port: Port, frame: bytes) -> bool:
        if port is Port.COMPANION and not any(map(self.drops, DatagramParser().frames(frame))):
            self.stage.far.write(frame)
        return True

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        end = self.stage.now + seconds
        while self.stage.now < end and not until():
            self.rover.step(STEP)
            self.autopilot.poll(self.stage.now)
            self.stage.run(STEP, STEP)
            for frame in self.stage.frames[self._obeyed :]:
                if not self.drops(frame.message):
                    self.autopilot.receive(Port.COMPANION, frame.message)
            self._obeyed = len(self.stage.frames)

    @property
    def complete(self) -> bool:
        return self.mission.items is not None

    def sent(self, kind: str) -> int:
        return len(self.stage.sent(kind))

    def says(self, message: Any, sender: tuple[int, int] = PILOT) -> None:
        self.stage.send(message, sender)


class Scripted(LoopbackLink):
    """A link whose autopilot answers as the test says: `items` by number, `count` of them."""

    def __init__(self, count: int) -> None:
        super().__init__()
        self.count = count
        self.spoil: dict[int, Any] = {}
        self._seen = 0
        self.link.mission.wanted = True
        self.run(0.1)

    def report(self) -> None:
        self.send(mavlink.MAVLink_mission_current_message(1, self.count - 1, 3, 1), PILOT)

    def known(self) -> bool:
        return self.link.mission.items is not None

    def answer(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            self.run(STEP, STEP)
            for frame in self.frames[self._seen :]:
                kind = frame.message.get_type()
                if kind == "MISSION_REQUEST_LIST":
                    self.send(mavlink.MAVLink_mission_count_message(*US, self.count), PILOT)
                elif kind == "MISSION_REQUEST_INT":
                    seq = frame.message.seq
                    self.send(self.spoil.get(seq, item(seq)), PILOT)
            self._seen = len(self.frames)


def item(
    seq: int, *, x: int = 470_000_000, y: int = 80_000_000, delay: float = 0.0, command: int = 16
) -> mavlink.MAVLink_mission_item_int_message:
    return mavlink.MAVLink_mission_item_int_message(
        *US, seq, 3, command, 0, 1, delay, 0.0, 0.0, math.nan, x + 900 * seq, y, 0.0
    )


@pytest.mark.parametrize(("kind", "first"), [(SimulatedAutopilot, 1), (Px4, 0)])
def test_it_has_every_item_of_the_mission_where_the_rover_will_drive(
    kind: type[SimulatedAutopilot], first: int
) -> None:
    wire = Wire(kind)
    wire.run(5.0, lambda: wire.complete)
    items = wire.mission.items
    assert items is not None
    assert [one.seq for one in items] == list(range(7 + first))
    assert all(one.is_plain for one in items)
    ways = [10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 62.0]
    places = [degrees_e7(*wire.rover.place(way)) for way in ways]
    assert [(round(one.lat * 1e7), round(one.lon * 1e7)) for one in items[first:]] == places
    wire.run(0.5)
    assert wire.sent("MISSION_ACK") == 1
    assert wire.mission.why == ""


def test_a_mission_that_goes_round_ends_with_a_jump_to_its_first_item() -> None:
    wire = Wire(length=None)
    wire.run(5.0, lambda: wire.complete)
    items = wire.mission.items
    assert items is not None
    count = math.ceil(TRAIL.length / 10.0)
    assert len(items) == 1 + count + 1
    assert (items[-1].command, items[-1].param1, items[-1].is_place) == (177, 1.0, False)
    assert items[-2].is_place


def test_each_item_is_reached_where_it_lies_in_every_round() -> None:
    wire = Wire(length=None)
    wire.autopilot.arm(on=True)
    wire.autopilot.set_mode(wire.autopilot.mission, "hand")
    near = []
    while wire.rover.progress < 2.2 * TRAIL.length:
        wire.rover.step(STEP)
        for told in wire.autopilot.tour.advance():
            place = wire.autopilot.tour.item(told.seq)
            assert place is not None
            near.append(math.hypot(place.x - wire.rover.x, place.y - wire.rover.y))
    assert len(near) > 25
    assert max(near) < 1.0


def test_nothing_is_asked_for_that_nobody_wants() -> None:
    wire = Wire()
    wire.mission.wanted = False
    wire.run(5.0)
    assert wire.sent("MISSION_REQUEST_LIST") == 0
    assert (wire.mission.items, wire.mission.why) == (None, "not asked for")
    wire.mission.wanted = True
    wire.run(5.0, lambda: wire.complete)
    assert wire.complete
    wire.mission.wanted = False
    wire.run(0.1)
    assert not wire.complete


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_lost_frames_are_asked_for_again(share: float) -> None:
    wire, chance = Wire(), random.Random(7)
    wire.drops = lambda message: "MISSION" in message.get_type() and chance.random() < share
    wire.run(120.0, lambda: wire.complete)
    items = wire.mission.items
    assert items is not None
    assert [one.seq for one in items] == list(range(8))


def test_an_autopilot_that_does_not_answer_is_asked_five_times_and_again_after_ten_seconds() -> None:
    wire = Wire()
    wire.drops = lambda message: message.get_type() == "MISSION_REQUEST_LIST"
    wire.run(9.0)
    assert wire.sent("MISSION_REQUEST_LIST") == 5
    assert wire.mission.why == "the autopilot does not answer"
    wire.drops = lambda _: False
    wire.run(12.0, lambda: wire.complete)
    assert wire.complete


def test_another_stations_download_does_not_confuse_it() -> None:
    wire = Wire()
    station = mavlink.MAVLink_mission_count_message(255, 190, 3)
    unasked = mavlink.MAVLink_mission_count_message(*US, 3)
    fences = mavlink.MAVLink_mission_count_message(*US, 2, mavlink.MAV_MISSION_TYPE_FENCE)
    foreign = mavlink.MAVLink_mission_item_int_message(
        255, 190, 2, 3, 16, 0, 1, 5.0, 0, 0, 0, 10_000_000, 10_000_000, 0
    )

    def talk() -> bool:
        for message in (station, fences, foreign):
            wire.says(message)
        if wire.sent("MISSION_REQUEST_INT") > 2:
            wire.says(unasked)
        wire.says(mavlink.MAVLink_mission_count_message(*US, 1), (2, 1))  # another rover's
        return wire.complete

    wire.run(5.0, talk)
    items = wire.mission.items
    assert items is not None
    assert len(items) == 8
    assert all(one.param1 == 0.0 for one in items)


def test_another_mission_makes_the_items_unknown_at_once_and_is_downloaded() -> None:
    wire = Wire()
    wire.run(5.0, lambda: wire.complete)
    wire.autopilot.tour.length = 35.0
    wire.run(1.5, lambda: not wire.complete)
    assert (wire.mission.items, wire.mission.why) == (None, "it is being downloaded")
    wire.run(5.0, lambda: wire.complete)
    items = wire.mission.items
    assert items is not None
    assert len(items) == 5


def test_a_mission_that_changes_in_the_middle_of_the_download_is_begun_anew() -> None:
    wire = Wire(length=400.0)
    wire.run(5.0, lambda: wire.sent("MISSION_REQUEST_INT") > 10)
    assert not wire.complete
    wire.autopilot.tour.length = 75.0
    wire.run(20.0, lambda: wire.complete)
    items = wire.mission.items
    assert items is not None
    assert len(items) == 9


def test_a_mission_as_long_that_reports_no_id_is_noticed_as_its_items_ahead_are_read_again() -> None:
    wire = Wire(length=68.0)
    wire.run(5.0, lambda: wire.complete)
    before = wire.mission.items
    asked = wire.sent("MISSION_REQUEST_INT")
    wire.run(10.0)
    assert wire.mission.items is before
    assert 8 <= wire.sent("MISSION_REQUEST_INT") - asked <= 10  # one a second
    stage = Scripted(5)
    stage.report()
    stage.answer(2.0)
    assert stage.known()
    stage.spoil = {3: item(3, y=90_000_000)}
    for _ in range(6):
        stage.report()
        stage.answer(1.0)
        if not stage.known():
            break
    assert stage.link.mission.why in ("it has changed", "it is being downloaded")
    stage.answer(3.0)
    items = stage.link.mission.items
    assert items is not None
    assert items[3].lon == 9.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bad", "why"),
    [
        (item(2, x=900_000_001), "item 2 lies outside the earth"),
        (item(2, y=-1_800_000_001), "item 2 lies outside the earth"),
        (item(2, delay=math.nan), "item 2 has a parameter that is no number"),
        (item(2, delay=math.inf), "item 2 has a parameter that is no number"),
    ],
)
def test_a_mission_with_a_bad_value_is_refused_with_a_reason(bad: Any, why: str) -> None:
    stage = Scripted(5)
    stage.spoil = {2: bad}
    stage.report()
    stage.answer(20.0)
    assert (stage.link.mission.items, stage.link.mission.why) == (None, why)
    assert len(stage.sent("MISSION_REQUEST_LIST")) == 1
    stage.spoil = {}
    stage.answer(45.0)
    assert stage.link.mission.items is not None, "it is read again a minute later"


def test_an_item_of_another_number_than_asked_for_is_no_answer() -> None:
    stage = Scripted(5)
    stage.spoil = {2: item(3)}
    stage.report()
    stage.answer(7.0)
    assert (stage.link.mission.items, stage.link.mission.why) == (None, "the autopilot does not answer")


def test_700_items_are_downloaded_and_701_are_refused() -> None:
    stage = Scripted(700)
    stage.report()
    stage.answer(60.0)
    assert stage.link.mission.items is not None
    assert len(stage.link.mission.items) == 700
    longer = Scripted(701)
    longer.report()
    longer.answer(5.0)
    assert longer.link.mission.why == "it has 701 items, more than 700"
    assert longer.sent("MISSION_REQUEST_INT") == []


def test_where_the_total_is_not_reported_the_count_tells_how_many_items_there_are() -> None:
    stage = Scripted(5)
    stage.send(mavlink.MAVLink_mission_current_message(1, 65535, 0, 0), PILOT)
    stage.answer(2.0)
    assert stage.link.mission.items is not None
    assert len(stage.link.mission.items) == 5


def test_a_refusal_while_somebody_uploads_is_waited_out() -> None:
    stage = Scripted(5)
    stage.report()
    stage.run(0.3)
    assert len(stage.sent("MISSION_REQUEST_LIST")) == 1
    stage._seen = len(stage.frames)
    stage.send(mavlink.MAVLink_mission_ack_message(*US, mavlink.MAV_MISSION_DENIED), PILOT)
    stage.answer(9.0)
    assert len(stage.sent("MISSION_REQUEST_LIST")) == 1
    stage.answer(3.0)
    assert stage.link.mission.items is not None


def test_over_mavlink_1_it_goes_as_well() -> None:
    stage = Scripted(5)
    stage.mavlink1 = True
    stage.run(12.0)
    stage.report()
    stage.answer(5.0)
    assert stage.link.mission.items is not None
    lengths = {"MISSION_REQUEST_LIST": 2, "MISSION_REQUEST_INT": 4, "MISSION_ACK": 3}
    for kind, length in lengths.items():
        assert {one.get_header().mlen for one in stage.sent(kind)} == {length}, kind


def test_rubbish_from_the_autopilot_ends_nothing() -> None:
    wire, chance = Wire(), random.Random(3)
    for _ in range(300):
        kind = chance.choice(("count", "item", "ack"))
        seq = chance.randrange(65536)
        if kind == "count":
            wire.says(mavlink.MAVLink_mission_count_message(*US, seq, chance.randrange(3)))
        elif kind == "ack":
            wire.says(mavlink.MAVLink_mission_ack_message(*US, chance.randrange(256)))
        else:
            wire.says(item(chance.randrange(9), x=chance.randrange(-(1 << 31), 1 << 30)))
        wire.run(0.1)
    wire.run(130.0, lambda: wire.complete)
    assert wire.complete


def test_an_item_is_made_the_current_one() -> None:
    wire = Wire()
    wire.run(3.0)
    wire.stage.link.set_current_item(4, wire.stage.now)
    wire.run(1.0)
    vehicle = wire.stage.link.vehicle
    assert vehicle is not None
    assert vehicle.mission is not None
    assert vehicle.mission.item == 4
    sets = [one for one in wire.stage.sent("COMMAND_LONG") if one.command == 224]
    assert [(one.param1, one.param2) for one in sets] == [(4.0, 0.0)]


def test_without_an_autopilot_no_item_is_set() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.link.set_current_item(4, stage.now)
    stage.run(1.0)
    assert not [one for one in stage.sent("COMMAND_LONG") if one.command == 224]
