"""Asking an autopilot in virtual time: the simulated field's, deaf ones, and PX4's way with whole numbers."""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config import Config
from companion.config.schema import CallSection
from companion.desk.check import interview
from companion.desk.check.autopilot import judged
from companion.desk.check.interview import COMPONENT_ID, Interview, value_of
from companion.desk.check.rules import CheckFinding, Verdict
from companion.link.connection import Connection
from companion.sim.field.autopilot import SimulatedAutopilot
from companion.sim.field.router import DatagramParser, Port
from companion.sim.field.rover import Rover
from companion.sim.field.trail import Trail
from companion.sim.loopback_link import pair

ROVER, ARDUPILOT, PX4 = 10, 3, 12
TRAIL = Trail(1)
HOLDS = replace(Config(), call=CallSection(policy="hold"))
Answer = Callable[[Any], list[Any]]


class Talk:
    """An interview and whoever is at the other end; `sent` is what was asked, and when."""

    def __init__(self, answer: Answer, system: int = 1, component: int = 1) -> None:
        near, self.far = pair()
        self.now = 100.0
        self.interview = Interview(Connection(lambda: near, self.now), interview.names, 1, self.now)
        self.sent: list[tuple[float, Any]] = []
        self._answer = answer
        self._mav = mavlink.MAVLink(None, system, component)
        self._parser = DatagramParser()

    def say(self, message: Any) -> None:
        """Something of the other end's own."""
        self.far.write(message.pack(self._mav))

    def run(self, seconds: float = 60.0) -> float:
        """Until it is over; how long that took."""
        began = self.now
        while not self.interview.turn(self.now) and self.now - began < seconds:
            self.now += 0.02
            while frame := self.far.read():
                for message in self._parser.frames(frame):
                    self.sent.append((self.now, message))
                    for reply in self._answer(message):
                        self.say(reply)
        return self.now - began


def heartbeat(kind: int = ARDUPILOT, vehicle: int = ROVER) -> Any:
    """An autopilot's."""
    return mavlink.MAVLink_heartbeat_message(vehicle, kind, 1, 4, 3, 3)


def answering(values: dict[str, float], kind: int = ARDUPILOT) -> Answer:
    """An autopilot that knows these, as floats, and says nothing to other names."""

    def answer(message: Any) -> list[Any]:
        if message.get_type() == "HEARTBEAT":
            return [heartbeat(kind)]
        if message.get_type() != "PARAM_REQUEST_READ" or message.param_id not in values:
            return []
        name = message.param_id
        return [mavlink.MAVLink_param_value_message(name.encode(), values[name], 9, 1, 0)]

    return answer


def found(talk: Talk, config: Config = HOLDS) -> list[CheckFinding]:
    """What is told of it."""
    return judged(config, "serial:/dev/ttyS0:57600", talk.interview).findings


class Field:
    """The simulated field's autopilot."""

    def __init__(self) -> None:
        self.autopilot = SimulatedAutopilot(Rover(TRAIL), self._send)
        self._replies: list[Any] = []

    def _send(self, port: Port, frame: bytes) -> bool:
        self._replies += DatagramParser().frames(frame) if port is Port.COMPANION else []
        return True

    def answer(self, message: Any) -> list[Any]:
        self._replies.clear()
        self.autopilot.receive(Port.COMPANION, message)
        if message.get_type() == "HEARTBEAT":
            return [heartbeat()]
        return list(self._replies)


def test_the_field_s_autopilot_is_asked_and_its_bad_parameters_are_told() -> None:
    field = Field()
    field.autopilot.set_parameter("MIS_RESTART", 1)
    talk = Talk(field.answer)
    assert talk.run() < 14.0
    told = {finding.check for finding in found(talk)}
    assert "MIS_RESTART 1" in told
    assert "MIS_RESTART 0" not in told
    field.autopilot.set_parameter("MIS_RESTART", 0)
    talk = Talk(field.answer)
    talk.run()
    assert not any(finding.check.startswith("MIS_RESTART") for finding in found(talk))
    assert judged(HOLDS, "", talk.interview).speed == ("CRUISE_SPEED", 2.5)


def test_the_autopilot_has_a_row_of_its_own_whatever_else_is_found() -> None:
    bad = Talk(answering({"MIS_RESTART": 1.0, "FS_ACTION": 2.0}))
    bad.run()
    row, *others = found(bad)
    assert (row.check, row.verdict) == ("autopilot", Verdict.FAIL)
    assert f"ArduPilot, system 1: 2 parameters told, {len(others)} findings, below" in row.text
    assert "MIS_RESTART 1" in {one.check for one in others}


def test_it_asks_one_by_one_with_pauses_by_name_and_from_a_component_of_its_own() -> None:
    talk = Talk(answering({"MIS_RESTART": 0.0}))
    talk.run()
    asked = [(at, message) for at, message in talk.sent if message.get_type() == "PARAM_REQUEST_READ"]
    pauses = [later - sooner for (sooner, _), (later, _) in pairwise(asked)]
    assert min(pauses) >= 0.05
    assert {message.param_index for _, message in asked} == {-1}
    assert {(message.target_system, message.target_component) for _, message in asked} == {(1, 1)}
    assert {message.get_srcComponent() for _, message in talk.sent} == {COMPONENT_ID}
    kinds = {message.get_type() for _, message in talk.sent}
    assert kinds == {"HEARTBEAT", "PARAM_REQUEST_READ"}, "nothing is changed, nothing streamed"
    tries = [message.param_id for _, message in asked]
    assert tries.count("MIS_RESTART") == 1
    assert tries.count("SCR_ENABLE") == 3, "lost or not there: it is asked again"


def test_a_name_that_the_autopilot_says_it_does_not_know_is_not_asked_again() -> None:
    def answer(message: Any) -> list[Any]:
        if message.get_type() != "PARAM_REQUEST_READ":
            return [heartbeat()]
        error = mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
        return [mavlink.MAVLink_param_error_message(1, COMPONENT_ID, message.param_id.encode(), -1, error)]

    talk = Talk(answer)
    assert talk.run() < 5.0


def test_an_autopilot_that_answers_nothing_is_told_and_waited_for_no_longer_than_it_may() -> None:
    talk = Talk(answering({}))
    assert talk.run() < 16.0
    (finding,) = found(talk)
    assert finding.verdict is Verdict.FAIL
    assert "answers none of our questions" in finding.text


def test_an_autopilot_that_answers_late_has_answered() -> None:
    counted: Counter[str] = Counter()
    prompt = answering({"MIS_RESTART": 1.0, "FS_ACTION": 2.0})

    def answer(message: Any) -> list[Any]:
        name = getattr(message, "param_id", "")
        counted[name] += 1
        return [] if name and counted[name] < 3 else prompt(message)

    talk = Talk(answer)
    talk.run()
    assert talk.interview.values == {"MIS_RESTART": 1.0, "FS_ACTION": 2.0}


@pytest.mark.parametrize("rubbish", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_no_answer(rubbish: float) -> None:
    talk = Talk(answering({"ATS_MODES": rubbish, "MIS_RESTART": rubbish, "FS_ACTION": 2.0}))
    talk.run()
    assert talk.interview.values == {"FS_ACTION": 2.0}
    assert "MIS_RESTART untold" in {finding.check for finding in found(talk)}


@pytest.mark.parametrize(
    ("prepare", "told"),
    [
        (lambda _: None, "nothing heard in 10 s: check wiring"),
        (lambda talk: talk.far.write(b"\x55" * 40), "40 bytes heard that are no MAVLink: check baud rate"),
    ],
)
def test_silence_and_noise_are_told_with_what_to_look_at(prepare: Callable[[Talk], Any], told: str) -> None:
    talk = Talk(lambda _: [])
    prepare(talk)
    assert 10.0 <= talk.run() < 10.1
    (finding,) = found(talk)
    assert finding.verdict is Verdict.FAIL
    assert told in finding.text


@pytest.mark.parametrize(
    ("sender", "told"), [((255, 190), "255/190 heard, and no autopilot"), ((1, 191), "a companion is heard")]
)
def test_others_on_the_link_are_no_autopilot(sender: tuple[int, int], told: str) -> None:
    talk = Talk(lambda _: [], *sender)
    talk.say(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    talk.run()
    assert told in found(talk)[0].text
    assert talk.interview.grounds == {sender}, "its heartbeat is a ground station's"


def test_a_port_that_is_in_use_says_that_the_companion_may_be_running() -> None:
    talk = Talk(lambda _: [])
    talk.interview.connection.trouble = "Address already in use"
    talk.run()
    talk.interview.connection.trouble = "Address already in use"
    assert "is the companion running?" in found(talk)[0].text


def test_a_copter_is_no_rover() -> None:
    talk = Talk(lambda message: [heartbeat(vehicle=2)] if message.get_type() == "HEARTBEAT" else [])
    talk.run()
    assert "no ArduPilot or PX4 rover" in found(talk)[0].text


@pytest.mark.parametrize(
    ("kind", "px4_hold", "overrun"),
    [(PX4, "loiter", 2.5), (PX4, "offboard", 0.0), (ARDUPILOT, "loiter", 0.0)],
)
def test_what_it_drives_on_in_the_mode_that_holds_it_is_known_with_the_autopilot(
    kind: int, px4_hold: str, overrun: float
) -> None:
    talk = Talk(answering({"RO_SPEED_LIM": 2.0}, kind))
    talk.say(heartbeat(kind))
    talk.run()
    config = replace(HOLDS, call=replace(HOLDS.call, px4_hold=px4_hold))
    asked = judged(config, "", talk.interview)
    assert asked.overrun == overrun
    assert any("drives on" in finding.text for finding in asked.findings) is (kind == PX4)


@pytest.mark.parametrize(
    ("kind", "deadman", "told"),
    [
        (PX4, "off", 'or set [call] px4_deadman = "manual_control"'),
        (PX4, "manual_control", "PX4 ignores the transmitter and its mode switch"),
        (ARDUPILOT, "manual_control", "px4_deadman is ignored here"),
        (ARDUPILOT, "off", ""),
    ],
)
def test_what_stops_it_when_the_companion_dies_is_told(kind: int, deadman: str, told: str) -> None:
    talk = Talk(answering({"RO_SPEED_LIM": 2.0, "MIS_RESTART": 0.0}, kind))
    talk.say(heartbeat(kind))
    talk.run()
    config = replace(HOLDS, call=replace(HOLDS.call, px4_deadman=deadman))
    told_of = [one.text for one in judged(config, "", talk.interview).findings if "px4_deadman" in one.text]
    last = told_of[-1] if told_of else ""
    assert told in last if told else not last


def test_px4_s_whole_numbers_are_read_bytewise_and_ardupilot_s_as_floats() -> None:
    def message(value: float, kind: int) -> Any:
        sent = mavlink.MAVLink_param_value_message(b"MAV_1_FORWARD", value, kind, 1, 0)
        mav = mavlink.MAVLink(None, 1, 1)
        (read,) = DatagramParser().frames(sent.pack(mav))
        return read

    for number in (0, 1, 5, -1, 2**31 - 1):
        as_float = struct.unpack("<f", struct.pack("<i", number))[0]
        assert value_of(message(as_float, mavlink.MAV_PARAM_TYPE_INT32), PX4) == number
    assert value_of(message(1.5, mavlink.MAV_PARAM_TYPE_REAL32), PX4) == 1.5
    assert value_of(message(5.0, mavlink.MAV_PARAM_TYPE_INT32), ARDUPILOT) == 5.0
    assert value_of(message(2.0, mavlink.MAV_PARAM_TYPE_INT8), ARDUPILOT) == 2.0


def test_of_two_autopilots_the_one_is_read_that_the_companion_would_command() -> None:
    talk, other = Talk(answering({"MIS_RESTART": 0.0})), mavlink.MAVLink(None, 7, 1)
    talk.far.write(heartbeat().pack(other))
    talk.run()
    assert talk.interview.autopilot is not None
    assert talk.interview.autopilot.system_id == 1


def test_an_autopilot_with_another_id_is_read_once_it_was_heard_alone() -> None:
    talk = Talk(answering({"MIS_RESTART": 0.0}), system=7)
    talk.run()
    assert talk.interview.autopilot is not None
    assert talk.interview.autopilot.system_id == 7
