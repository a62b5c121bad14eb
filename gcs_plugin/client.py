"""The operator's end of the protocol: decoded messages in, messages to send and events out.

No I/O and no clock: it runs under a terminal, inside a ground station and in a test's virtual time alike.
Call `receive` with every message of the link, then send what `outgoing` returns, at least ten times a second.
"""

from __future__ import annotations

import secrets
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from companion.wire.answers import MAX_PAYLOAD, Acknowledgement, Operation
from companion.wire.ftp import FtpPayload
from companion.wire.ids import (
    ANSWER_COMMAND,
    AUTOPILOT_COMPONENT_ID,
    COMPONENT_ID,
    TUNNEL_ACKNOWLEDGEMENT,
    TUNNEL_ANSWER,
    TUNNEL_CALL,
    TUNNEL_SUMMARY,
    Motion,
    Policy,
    Result,
)
from companion.wire.packing import PayloadError
from companion.wire.payloads import CallData, Summary
from companion.wire.signing import is_signed
from gcs_plugin import events as ev
from gcs_plugin.fetch import Fetch
from gcs_plugin.pending import Pending, Status
from gcs_plugin.rovers import Rover
from gcs_plugin.vehicle import read_vehicle
from gcs_plugin.wishes import PolicyWish

PACE_S = 0.05
"""Between two messages to one rover: radios and PX4 lose bursts."""
MAX_ROVERS = 16
MAX_PENDING = 64
MAX_EVENTS = 1024
MAX_PROBLEMS = 8
_TO_ONE = frozenset({"COMMAND_ACK", "FILE_TRANSFER_PROTOCOL"})


def _random_transaction() -> int:
    return secrets.randbelow(0xFFFFFFFF) + 1


class OperatorClient:
    """Follows every rover of a link and brings answers to them.

    transactions: gives a new random id in 1..2^32-1 for each answer. ids: the system and component id that
    its messages leave with, None while not known: what is told to others on the same radio is not for us.
    """

    def __init__(self, transactions: Callable[[], int] = _random_transaction) -> None:
        self.ids: tuple[int, int] | None = None
        self._transactions = transactions
        self._rovers: dict[int, Rover] = {}
        self._pending: deque[Pending] = deque(maxlen=MAX_PENDING)
        self._events: deque[ev.Event] = deque(maxlen=MAX_EVENTS)
        self._may_send_at: dict[int, float] = {}
        self._lists_wanted: set[int] = set()
        self._wishes: dict[int, PolicyWish] = {}
        self._fetches: dict[int, Fetch] = {}
        self._problems: set[tuple[int, str]] = set()

    @property
    def rovers(self) -> dict[int, Rover]:
        """By system id: those whose companion was heard."""
        return {system: rover for system, rover in sorted(self._rovers.items()) if rover.known}

    @property
    def unsettled(self) -> list[Pending]:
        """Answers that are still on their way, oldest first."""
        return [pending for pending in self._pending if not pending.settled]

    @property
    def busy(self) -> bool:
        """Whether an answer, a policy or a file is still on its way."""
        if any(not fetch.settled for fetch in self._fetches.values()):
            return True
        return bool(self.unsettled) or any(not wish.settled for wish in self._wishes.values())

    def receive(self, message: Any, now: float) -> None:
        """Take in one decoded message of any dialect. Never raises for what it holds."""
        component = message.get_srcComponent()
        if component not in (COMPONENT_ID, AUTOPILOT_COMPONENT_ID):
            return
        kind = message.get_type()
        rover = self._rover(message.get_srcSystem(), companion=component == COMPONENT_ID)
        if rover is None or kind == "BAD_DATA":
            return
        if component == AUTOPILOT_COMPONENT_ID:
            if kind == "HEARTBEAT":
                vehicle = read_vehicle(message.autopilot, message.base_mode, message.custom_mode)
                self._events.extend(rover.hear_vehicle(vehicle))
            elif kind == "STATUSTEXT":
                self._events.extend(rover.hear_vehicle_text(message.severity, message.text, now))
            return
        frame = bytes(message.get_msgbuf() or b"")
        rover.counters.bytes += len(frame)
        rover.signs = is_signed(frame)
        try:
            told = self._understand(rover, kind, message, now)
        except ValueError as error:
            self._not_understood(rover, str(error))
        else:
            self._close_over(rover.system, told, now)
            self._events.extend(told)

    def outgoing(self, now: float) -> list[Any]:
        """Messages to send now; also notices who fell silent and which answers ran out of time."""
        for rover in self._rovers.values():
            self._events.extend(rover.check_link(now))
        for pending in self._pending:
            if pending.settle(now):
                self._events.append(self._moved(pending))
        for wish in self._wishes.values():
            if wish.settle(now):
                self._events.append(_policy_moved(wish))
        for fetch in self._fetches.values():
            fetch.settle(now)
        messages = (self._next(rover, now) for rover in self._rovers.values())
        return [message for message in messages if message is not None]

    def events(self) -> list[ev.Event]:
        """What happened since the last time it was asked."""
        told = list(self._events)
        self._events.clear()
        return told

    def answer(
        self, system: int, target: int, motion: Motion, operations: Sequence[Operation], now: float
    ) -> Pending:
        """Bring an answer to call or hold `target` (0: words alone) of the rover `system`.

        It leaves with the next `outgoing` calls, once the rover is heard; answers to one rover keep their
        order. Raises PayloadError when it cannot be told on the wire.
        """
        if len(self.unsettled) >= MAX_PENDING:
            raise PayloadError(f"{MAX_PENDING} answers wait already: is the link up?")
        pending = Pending(system, target, motion, tuple(operations), self._transactions(), now)
        while len(self._pending) >= MAX_PENDING:
            self._pending.remove(next(old for old in self._pending if old.settled))
        self._pending.append(pending)
        rover = self._rovers.get(system)
        if rover is None or not rover.alive(now):
            self._events.append(self._moved(pending))
        return pending

    def set_policy(self, system: int, policy: Policy, now: float) -> PolicyWish:
        """Ask for a policy, in place of one asked for before; it leaves once the rover is heard."""
        self._wishes[system] = wish = PolicyWish(system, policy, now)
        rover = self._rovers.get(system)
        if rover is None or not rover.alive(now):
            self._events.append(_policy_moved(wish))
        return wish

    def fetch(self, system: int, path: str, now: float) -> Fetch:
        """Fetch a file of the rover's companion, in place of one on its way; look at what becomes of it."""
        self._fetches[system] = fetch = Fetch(system, path, now)
        return fetch

    def request_parameters(self, system: int) -> None:
        """Ask the rover's companion for its list, as soon as it is heard."""
        self._lists_wanted.add(system)

    def _rover(self, system: int, *, companion: bool) -> Rover | None:
        if system not in self._rovers and 0 < system < 256:
            if companion:
                self._make_room()
            if len(self._rovers) < MAX_ROVERS:
                self._rovers[system] = Rover(system)
        return self._rovers.get(system)

    def _make_room(self) -> None:
        """Of too many vehicles the first without a companion gives its place to one that has."""
        without = next((system for system, rover in self._rovers.items() if not rover.known), None)
        if without is not None and len(self._rovers) >= MAX_ROVERS:
            del self._rovers[without]

    def _understand(self, rover: Rover, kind: str, message: Any, now: float) -> list[ev.Event]:
        if kind == "HEARTBEAT":
            self._events.extend(rover.hear_alive(now))
            return rover.hear_state(message.custom_mode, now)
        if kind == "STATUSTEXT":
            return rover.hear_text(message.severity, message.text, now)
        if kind == "PARAM_VALUE":
            return rover.hear_parameter(message.param_id, message.param_value)
        if kind == "TUNNEL":
            return self._unwrap(rover, message, now)
        if kind in _TO_ONE and not self._is_for_us(message):
            return []
        if kind == "FILE_TRANSFER_PROTOCOL" and rover.system in self._fetches:
            self._fetches[rover.system].hear(FtpPayload.unpack(bytes(message.payload)), now)
        if kind == "COMMAND_ACK" and message.command == ANSWER_COMMAND:
            wish = self._wishes.get(rover.system)
            granted = message.result == mavlink.MAV_RESULT_ACCEPTED
            return [_policy_moved(wish)] if wish is not None and wish.acknowledge(granted=granted) else []
        return []

    def _is_for_us(self, message: Any) -> bool:
        """An acknowledgement of MAVLink 1 says not for whom it is: it may be ours."""
        to = message.target_system, message.target_component
        return self.ids is None or all(said in (0, own) for said, own in zip(to, self.ids, strict=True))

    def _unwrap(self, rover: Rover, message: Any, now: float) -> list[ev.Event]:
        if message.payload_length > MAX_PAYLOAD:
            raise PayloadError(f"payload length {message.payload_length} is over {MAX_PAYLOAD}")
        payload = bytes(message.payload[: message.payload_length])
        if message.payload_type == TUNNEL_SUMMARY:
            return rover.hear_summary(Summary.unpack(payload), now)
        if message.payload_type == TUNNEL_CALL:
            return rover.hear_call(CallData.unpack(payload), now)
        if message.payload_type == TUNNEL_ACKNOWLEDGEMENT:
            return self._acknowledged(rover, Acknowledgement.unpack(payload), now)
        return []

    def _acknowledged(self, rover: Rover, ack: Acknowledgement, now: float) -> list[ev.Event]:
        asked = (rover.system, ack.transaction)
        pending = next((one for one in self._pending if (one.system, one.transaction) == asked), None)
        if pending is None or pending.first_sent is None:
            return []
        if pending.status is Status.ACKNOWLEDGED:
            rover.counters.duplicate_acknowledgements += 1
            return []
        if pending.settled and ack.result is Result.BUSY:
            return []
        pending.acknowledge(ack, final=ack.result is not Result.BUSY)
        return [ev.Acknowledged(rover.system, ack), *rover.hear_acknowledgement(ack, now)]

    def _close_over(self, system: int, told: Iterable[ev.Event], now: float) -> None:
        closed = {event.call.id for event in told if isinstance(event, ev.CallClosed)}
        for pending in self.unsettled:
            if pending.system == system and pending.target in closed:
                pending.close(now)

    def _next(self, rover: Rover, now: float) -> Any | None:
        """At most one message to this rover, and only while it is heard."""
        if not rover.alive(now) or now < self._may_send_at.get(rover.system, 0.0):
            return None
        message = self._next_wish(rover.system, now) or self._next_answer(rover.system, now)
        if message is None and rover.system in self._lists_wanted:
            self._lists_wanted.discard(rover.system)
            message = mavlink.MAVLink_param_request_list_message(rover.system, COMPONENT_ID)
        if message is None and rover.system in self._fetches:
            message = self._fetches[rover.system].due(now)
        if message is not None:
            self._may_send_at[rover.system] = now + PACE_S
        return message

    def _next_wish(self, system: int, now: float) -> Any | None:
        wish = self._wishes.get(system)
        if wish is None:
            return None
        before, message = wish.status, wish.due(now)
        if wish.status is not before:
            self._events.append(_policy_moved(wish))
        return message

    def _next_answer(self, system: int, now: float) -> Any | None:
        for pending in self.unsettled:
            if pending.system != system:
                continue
            before = pending.status
            payload = pending.due(now)
            if payload is not None:
                if pending.status is not before:
                    self._events.append(self._moved(pending))
                padded = payload.ljust(MAX_PAYLOAD, b"\0")
                return mavlink.MAVLink_tunnel_message(
                    system, COMPONENT_ID, TUNNEL_ANSWER, len(payload), padded
                )
            if pending.blocks(now):
                return None
        return None

    def _moved(self, pending: Pending) -> ev.AnswerMoved:
        return ev.AnswerMoved(pending.system, pending.target, pending.transaction, pending.status)

    def _not_understood(self, rover: Rover, problem: str) -> None:
        rover.counters.rubbish += 1
        if (rover.system, problem) not in self._problems and len(self._problems) < MAX_PROBLEMS:
            self._problems.add((rover.system, problem))
            self._events.append(ev.NotUnderstood(rover.system, problem))


def _policy_moved(wish: PolicyWish) -> ev.PolicyMoved:
    return ev.PolicyMoved(wish.system, wish.policy, wish.status)
