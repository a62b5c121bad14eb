"""Reads from an autopilot the parameters that can make a hold unsafe or useless. It sets nothing."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.desk.check import ardupilot, px4
from companion.desk.check.rules import FAIL, WARN, CheckFinding, Facts, Table, Verdict
from companion.link.connection import Connection
from companion.link.parser import Parser
from companion.link.signing import Signing
from companion.link.vehicle import VehicleTracker
from companion.wire.ids import AUTOPILOT_COMPONENT_ID

__all__ = ["ARDUPILOT", "NAMES", "PX4", "Facts", "judge", "names", "speed"]

ARDUPILOT, PX4 = 3, 12
"""Values of HEARTBEAT.autopilot (MAV_AUTOPILOT)."""
NAMES = {0: "", ARDUPILOT: "ArduPilot", PX4: "PX4"}
_TABLES: Mapping[int, Table] = {ARDUPILOT: ardupilot.TABLE, PX4: px4.TABLE}
_EMPTY = Table((), (), (), (), ())


def table_of(autopilot: int) -> Table:
    """Return the rules for an autopilot of a kind, none for one that is not known."""
    return _TABLES.get(autopilot, _EMPTY)


def names(autopilot: int) -> tuple[str, ...]:
    """Return the names of the parameters to read."""
    return table_of(autopilot).names


def judge(autopilot: int, facts: Facts, *, holds: bool) -> list[CheckFinding]:
    """Return what is wrong. holds: whether the policy is hold; otherwise every failure is only a warning."""
    worst = FAIL if holds else WARN
    table = table_of(autopilot)
    wrong = [
        CheckFinding(f"{rule.name} {facts.values[rule.name]:g}", min(rule.verdict, worst), rule.text)
        for rule in table.rules
        if rule.name in facts.values and rule.bad(facts.values[rule.name], facts)
    ]
    absent = [
        CheckFinding(f"{needed.name} absent", worst, needed.text)
        for needed in table.needed
        if needed.name not in facts.values and (not needed.other or facts.values.get(needed.other, 0.0))
    ]
    return wrong + absent + _missing(table, facts, worst)


def _missing(table: Table, facts: Facts, worst: Verdict) -> list[CheckFinding]:
    """Report the parameters that every autopilot of this kind has and this one did not send."""
    return [
        CheckFinding(
            f"{choice[0]} untold",
            min(max(rule.verdict for rule in table.rules if rule.name in choice), worst),
            "no good answer in three tries: check the link, then check again, or read it at the ground",
        )
        for choice in (*table.always, *(table.for_deadman if facts.deadman else ()))
        if not any(name in facts.values for name in choice)
    ]


def speed(autopilot: int, values: Mapping[str, float]) -> tuple[str, float] | None:
    """Return name and m/s of the parameter that sets the speed of autonomous driving; None without one."""
    found = ((name, values.get(name, 0.0)) for name in table_of(autopilot).speeds)
    return next(((name, value) for name, value in found if value > 0), None)


COMPONENT_ID = 194
"""MAV_COMP_ID_ONBOARD_COMPUTER4. Not 191: autopilot and ground would take the check for the companion."""
HEARD_WITHIN = 10.0
"""Seconds to wait for the autopilot's first heartbeat."""
PACE = 0.06
"""Seconds between two requests."""
PATIENCE = 1.0
"""Seconds to wait for an answer before a request is sent again."""
TRIES = 3
_READS = 32
_INTEGERS = {
    int(mavlink.MAV_PARAM_TYPE_UINT8): "<B",
    int(mavlink.MAV_PARAM_TYPE_INT8): "<b",
    int(mavlink.MAV_PARAM_TYPE_UINT16): "<H",
    int(mavlink.MAV_PARAM_TYPE_INT16): "<h",
    int(mavlink.MAV_PARAM_TYPE_UINT32): "<I",
    int(mavlink.MAV_PARAM_TYPE_INT32): "<i",
}


@dataclass(frozen=True)
class Heartbeat:
    """Identifies the autopilot. kind: HEARTBEAT.autopilot. vehicle: HEARTBEAT.type."""

    system_id: int
    kind: int
    vehicle: int


@dataclass
class _Request:
    tries: int = 0
    asked_at: float = -math.inf


@dataclass
class Interview:
    """Finds an autopilot on a connection and reads its parameters. Call `turn` often until it returns True.

    names: gives the parameters to read from an autopilot of a kind. system_id: as configured, and ours until
    the autopilot's is known. began: monotonic seconds of the start.
    signing: None without a key. refuse_unsigned: with a key, ignore messages that are not signed with it.
    listen: called with each message of the autopilot and the time. values: the parameters that came, types:
    their MAV_PARAM_TYPE.
    others: (system, component) of other senders; grounds: of those among them that are ground stations.
    bytes: number received.
    """

    connection: Connection
    names: Callable[[int], Sequence[str]]
    system_id: int
    began: float
    signing: Signing | None = None
    refuse_unsigned: bool = True
    listen: Callable[[Any, float], None] = lambda _message, _now: None
    autopilot: Heartbeat | None = None
    values: dict[str, float] = field(default_factory=dict)
    types: dict[str, int] = field(default_factory=dict)
    others: set[tuple[int, int]] = field(default_factory=set)
    grounds: set[tuple[int, int]] = field(default_factory=set)
    bytes: int = 0

    def __post_init__(self) -> None:
        self._mav = mavlink.MAVLink(None, self.system_id, COMPONENT_ID)
        self._parser = Parser()
        self._tracker = VehicleTracker(self.system_id)  # of several autopilots it takes the companion's
        self._heartbeat_at = self._sent_at = -math.inf
        self._requests: dict[str, _Request] = {}

    def turn(self, now: float) -> bool:
        """Receive what has come, and send what is due. True when the interview is over."""
        for _ in range(_READS):
            data = self.connection.read(now)
            if not data:
                break
            self.bytes += len(data)
            for message in self._parser.feed(data, now, whole=self.connection.datagrams):
                if not self._is_refused(message, now):
                    self.connection.note_accepted(now, autopilot=False)
                    self._handle(message, now)
        if now - self._heartbeat_at >= 1.0:
            self._heartbeat_at = now
            self._send(
                mavlink.MAVLink_heartbeat_message(
                    mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
                    mavlink.MAV_AUTOPILOT_INVALID,
                    0,
                    0,
                    mavlink.MAV_STATE_ACTIVE,
                    3,
                ),
                now,
            )
        if self.autopilot is None:
            return now - self.began >= HEARD_WITHIN
        self._ask(self.autopilot, now)
        return all(
            asked.tries >= TRIES and now - asked.asked_at >= PATIENCE for asked in self._requests.values()
        )

    def request(self, messages: Sequence[int], now: float) -> None:
        """Ask the autopilot to send each of these messages once, for `listen`."""
        if self.autopilot is None:
            return
        for number in messages:
            self._send(
                mavlink.MAVLink_command_long_message(
                    self.autopilot.system_id,
                    AUTOPILOT_COMPONENT_ID,
                    mavlink.MAV_CMD_REQUEST_MESSAGE,
                    0,
                    *(float(number), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
                ),
                now,
            )

    def set(self, name: str, value: float, now: float) -> None:
        """Ask the autopilot to set a parameter that it has told, and to tell it again, in `values`.

        A caller does this for a person alone: see `companion.desk.setup.parameters`.
        """
        if self.autopilot is None or name not in self.types:
            return
        self.expect(name, now)
        written = mavlink.MAVLink_param_set_message(
            self.autopilot.system_id,
            AUTOPILOT_COMPONENT_ID,
            name.encode(),
            wire_value(value, self.types[name], self.autopilot.kind),
            self.types[name],
        )
        self._send(written, now)

    def expect(self, name: str, now: float) -> None:
        """Take the next value of a parameter, and ask for it while none comes."""
        self._requests[name] = _Request(asked_at=now)

    def _is_refused(self, message: Any, now: float) -> bool:
        return self.signing is not None and self.refuse_unsigned and self.signing.refusal(message, now) != ""

    def _ask(self, autopilot: Heartbeat, now: float) -> None:
        if now - self._sent_at < PACE:
            return
        for name, asked in self._requests.items():
            if asked.tries < TRIES and now - asked.asked_at >= PATIENCE:
                asked.tries, asked.asked_at, self._sent_at = asked.tries + 1, now, now
                self._send(
                    mavlink.MAVLink_param_request_read_message(
                        autopilot.system_id, AUTOPILOT_COMPONENT_ID, name.encode(), -1
                    ),
                    now,
                )
                return

    def _handle(self, message: Any, now: float) -> None:
        sender = message.get_srcSystem(), message.get_srcComponent()
        kind = message.get_type()
        if sender[1] != AUTOPILOT_COMPONENT_ID or (self.autopilot and sender[0] != self.autopilot.system_id):
            self.others.add(sender)
            if kind == "HEARTBEAT" and message.type == mavlink.MAV_TYPE_GCS:
                self.grounds.add(sender)
            return
        if kind == "HEARTBEAT" and self.autopilot is None:
            if self._tracker.claims(sender[0], message, now):
                self._take_autopilot(sender[0], message)
        elif self.autopilot is not None and kind == "PARAM_VALUE":
            name, value = str(message.param_id), value_of(message, self.autopilot.kind)
            if math.isfinite(value) and self._requests.pop(name, None) is not None:
                self.values[name] = value
                self.types[name] = int(message.param_type)
        elif kind == "PARAM_ERROR" and message.error == mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST:
            self._requests.pop(str(message.param_id), None)
        if self.autopilot is not None:
            self.listen(message, now)

    def _take_autopilot(self, system_id: int, message: Any) -> None:
        self.autopilot = Heartbeat(system_id, int(message.autopilot), int(message.type))
        self._mav.srcSystem = system_id  # an onboard computer has the vehicle's system id
        self._requests = {name: _Request() for name in self.names(self.autopilot.kind)}

    def _send(self, message: Any, now: float) -> None:
        frame = bytes(message.pack(self._mav))
        if self.signing is not None:
            frame = self.signing.sign(frame, message, now)
        if self.connection.write(frame, now):
            self._mav.seq = (self._mav.seq + 1) % 256


def wire_value(value: float, form: int, autopilot: int) -> float:
    """Encode a parameter's value as `value_of` decodes it. form: MAV_PARAM_TYPE. Raises struct.error."""
    integer = _INTEGERS.get(form)
    if autopilot != PX4 or integer is None:
        return value
    coded = struct.pack(integer, round(value)).ljust(4, b"\0")
    return float(struct.unpack("<f", coded)[0])


def value_of(message: Any, autopilot: int) -> float:
    """Decode a PARAM_VALUE. In the float field PX4 sends an integer's bytes, ArduPilot its value as float."""
    form = _INTEGERS.get(int(message.param_type))
    if autopilot != PX4 or form is None:
        return float(message.param_value)
    frame = bytes(message.get_msgbuf())
    payload = frame[10:] if frame[0] == mavlink.PROTOCOL_MARKER_V2 else frame[6:]
    return float(struct.unpack_from(form, payload)[0])
