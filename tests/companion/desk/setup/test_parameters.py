"""An autopilot's parameters: what is proposed, and that only what was seen and clicked is written."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import product
from typing import cast

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config import Config
from companion.desk.check.interview import (
    ARDUPILOT,
    PX4,
    Heartbeat,
    Interview,
    table_of,
    value_of,
    wire_value,
)
from companion.desk.check.rules import Facts, ParameterRule
from companion.desk.setup import parameters
from companion.desk.setup.parameters import AskedAutopilot, proposed, read, rows, set_one
from companion.pages.requests import RequestError
from companion.sim.field.router import DatagramParser

ROVER = 10
LOCAL = ("127.0.0.1", 0)


class Autopilot:
    """Answers on a port. written: what was set. deaf_to_sets: it keeps its own values.

    system, armed: as its heartbeat says. stale: answers that were on their way when a value was set.
    """

    def __init__(self, values: dict[str, float], *, deaf_to_sets: bool = False, stale: int = 0) -> None:
        self.values = values
        self.system, self.armed, self._stale = 1, False, stale
        self.written: list[tuple[str, float]] = []
        self._deaf = deaf_to_sets

    def answers(self, message: object) -> list[bytes]:
        kind = message.get_type()  # type: ignore[attr-defined]
        mav = mavlink.MAVLink(None, self.system, 1)
        if kind == "HEARTBEAT":
            beat = mavlink.MAVLink_heartbeat_message(ROVER, ARDUPILOT, 1 | self.armed << 7, 0, 4, 3)
            return [bytes(beat.pack(mav))]
        name = str(getattr(message, "param_id", ""))
        if kind == "PARAM_SET":
            self.written.append((name, message.param_value))  # type: ignore[attr-defined]
            if self._stale:
                self._stale -= 1
                told = mavlink.MAVLink_param_value_message(name.encode(), self.values[name], 9, 1, 0)
                self.values[name] = message.param_value  # type: ignore[attr-defined]
                return [bytes(told.pack(mav))]
            if not self._deaf:
                self.values[name] = message.param_value  # type: ignore[attr-defined]
        if kind in ("PARAM_REQUEST_READ", "PARAM_SET") and name in self.values:
            told = mavlink.MAVLink_param_value_message(name.encode(), self.values[name], 9, 1, 0)
            return [bytes(told.pack(mav))]
        return []


@contextmanager
def serving(autopilot: Autopilot) -> Iterator[Config]:
    """Yields a configuration whose link leads there."""
    over, parser = threading.Event(), DatagramParser()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.bind(LOCAL)
        port.settimeout(0.05)

        def serve() -> None:
            while not over.is_set():
                try:
                    data, sender = port.recvfrom(4096)
                except TimeoutError:
                    continue
                for message in parser.frames(data):
                    for answer in autopilot.answers(message):
                        port.sendto(answer, sender)

        thread = threading.Thread(target=serve)
        thread.start()
        url = f"udpout:127.0.0.1:{port.getsockname()[1]}"
        try:
            yield replace(Config(), link=replace(Config().link, url=url))
        finally:
            over.set()
            thread.join()


def seen(config: Config) -> AskedAutopilot:
    """What was read of system 1."""
    return AskedAutopilot(config.link.url, cast("Interview", None), Heartbeat(1, ARDUPILOT, ROVER), "")


RULES = [(kind, rule) for kind in (ARDUPILOT, PX4) for rule in table_of(kind).rules]
VALUES = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 128.0, 1 << 10, 1 << 17, 1e5, 255.0, 42.0)


def bad_facts(rule: ParameterRule) -> Facts | None:
    """Facts with a value that the rule calls bad."""
    context = {"AVOID_ENABLE": 2.0, "PRX1_TYPE": 1.0, "INITIAL_MODE": 10.0, "MAV_0_CONFIG": 1.0}
    for policy, needed, offboard, deadman, value in product(
        ("hold", "guide", "report"), (0.0, 1.0), (False, True), (False, True), VALUES
    ):
        values = {"ATS_NEED": needed, **context, rule.name: value}
        facts = Facts(values, 1, policy=policy, offboard=offboard, deadman=deadman)
        if rule.bad(value, facts):
            return facts
    return None


@pytest.mark.parametrize(("kind", "rule"), RULES, ids=lambda one: getattr(one, "name", str(one)))
def test_what_is_proposed_is_what_the_rule_itself_accepts(kind: int, rule: ParameterRule) -> None:
    facts = bad_facts(rule)
    assert facts is not None, f"no bad value of {rule.name} ({kind}) is tried"
    wanted = proposed(kind, rule.name, facts)
    if wanted is not None:
        after = replace(facts, values={**facts.values, rule.name: wanted})
        assert not any(one.bad(wanted, after) for one in table_of(kind).rules if one.name == rule.name)


def test_a_proposal_is_made_for_most_rules_and_for_none_that_a_person_must_weigh() -> None:
    made = {
        rule.name
        for kind, rule in RULES
        if (facts := bad_facts(rule)) and proposed(kind, rule.name, facts) is not None
    }
    assert {"MIS_RESTART", "FS_ACTION", "FLTMODE_GCSBLOCK", "SCR_HEAP_SIZE", "COM_OF_LOSS_T"} <= made
    assert proposed(ARDUPILOT, "MIS_RESTART", Facts({"MIS_RESTART": 1.0})) == 0.0
    assert proposed(ARDUPILOT, "FLTMODE_GCSBLOCK", Facts({"FLTMODE_GCSBLOCK": 129.0})) == 1.0
    assert proposed(ARDUPILOT, "FS_ACTION", Facts({"FS_ACTION": 2.0})) is None, "all is well"


def test_the_worst_parameter_stands_on_top_with_what_is_proposed() -> None:
    shown = rows(ARDUPILOT, Facts({"MIS_RESTART": 1.0, "FS_ACTION": 1.0, "FS_THR_ENABLE": 1.0}))
    assert [(row["name"], row["verdict"], row["proposed"]) for row in shown] == [
        ("MIS_RESTART", "fail", 0.0),
        ("FS_ACTION", "warn", 2.0),
        ("FS_THR_ENABLE", "pass", None),
    ]


@pytest.mark.slow
def test_reading_writes_nothing_and_tells_each_value(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.desk.check.interview.PATIENCE", 0.05)
    monkeypatch.setattr("companion.desk.check.interview.PACE", 0.0)
    monkeypatch.setattr("companion.desk.check.autopilot.COURSE_WITHIN", 0.1)
    there = Autopilot({"MIS_RESTART": 1.0, "FS_ACTION": 2.0})
    with serving(there) as config:
        found = read(config)
    told = parameters.document(config, found)
    assert told["autopilot"] == "ArduPilot"
    assert {row["name"]: row["value"] for row in told["rows"]} == {"MIS_RESTART": 1.0, "FS_ACTION": 2.0}
    assert any("untold" in row["check"] for row in told["others"])
    assert there.written == []


def test_a_value_is_set_and_read_back() -> None:
    there = Autopilot({"MIS_RESTART": 1.0})
    with serving(there) as config:
        assert set_one(config, seen(config), "MIS_RESTART", 1.0, 0.0) == 0.0
    assert there.written == [("MIS_RESTART", 0.0)]


def test_a_value_that_was_changed_meanwhile_is_not_written_over() -> None:
    there = Autopilot({"MIS_RESTART": 2.0})
    with serving(there) as config, pytest.raises(RequestError, match="nothing was written"):
        set_one(config, seen(config), "MIS_RESTART", 1.0, 0.0)
    assert there.written == []


def test_an_autopilot_that_keeps_its_value_is_said_to_after_the_value_was_sent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(parameters, "SET_WITHIN", 0.5)
    there = Autopilot({"MIS_RESTART": 1.0}, deaf_to_sets=True)
    with serving(there) as config, pytest.raises(RequestError, match="was sent, and reads 1"):
        set_one(config, seen(config), "MIS_RESTART", 1.0, 0.0)


def test_an_answer_that_was_under_way_is_not_taken_for_the_one_to_the_set(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("companion.desk.check.interview.PATIENCE", 0.05)
    there = Autopilot({"FS_ACTION": 0.0}, stale=1)
    with serving(there) as config:
        assert set_one(config, seen(config), "FS_ACTION", 0.0, 2.0) == 2.0


@pytest.mark.parametrize(("system", "armed", "why"), [(2, False, "system 2 answers"), (1, True, "armed")])
def test_another_or_an_armed_vehicle_is_not_written_to(system: int, armed: bool, why: str) -> None:
    there = Autopilot({"MIS_RESTART": 1.0})
    there.system, there.armed = system, armed
    with serving(there) as config, pytest.raises(RequestError, match=f"nothing was written: .*{why}"):
        set_one(config, seen(config), "MIS_RESTART", 1.0, 0.0)
    assert there.written == []


def test_an_autopilot_that_does_not_know_the_name_is_not_written_to(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parameters, "SET_WITHIN", 0.5)
    there = Autopilot({})
    with serving(there) as config, pytest.raises(RequestError, match="nothing was written"):
        set_one(config, seen(config), "MIS_RESTART", 1.0, 0.0)
    assert there.written == []


@pytest.mark.parametrize("value", [0, 1, 5, -3])
def test_a_whole_number_reaches_px4_as_it_tells_one(value: int) -> None:
    form = int(mavlink.MAV_PARAM_TYPE_INT32)
    message = mavlink.MAVLink_param_value_message(b"NAV_RCL_ACT", wire_value(value, form, PX4), form, 1, 0)
    packed = bytes(message.pack(mavlink.MAVLink(None, 1, 1)))
    assert value_of(mavlink.MAVLink(None).decode(bytearray(packed)), PX4) == value
