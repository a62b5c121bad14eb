"""Implements the operator's end of the protocol: takes decoded messages, returns messages to send and events.

It has no I/O and no clock, so that it runs in a terminal, in a ground station and in a test's virtual time.
Call `receive` with every message of the link, then send what `outgoing` returns, at least ten times a second.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from companion.wire.answers import MAX_PAYLOAD, Acknowledgement, Answer
from companion.wire.call_report import CallReport
from companion.wire.delivery import DeliveryStatus, Pending, random_transaction
from companion.wire.ids import (
    ANSWER_COMMAND,
    AUTOPILOT_COMPONENT_ID,
    COMPONENT_ID,
    TUNNEL_ACKNOWLEDGEMENT,
    TUNNEL_CALL,
    TUNNEL_SUMMARY,
    Policy,
    Result,
)
from companion.wire.packing import PayloadError
from companion.wire.payloads import Summary
from companion.wire.signing import is_signed
from gcs_plugin.client import events as ev
from gcs_plugin.client.fetch import Fetch
from gcs_plugin.client.listing import Listing
from gcs_plugin.client.outbox import RequestOutbox
from gcs_plugin.client.policy_request import PendingPolicy
from gcs_plugin.client.rovers import FRESH_S, TrackedRover
from gcs_plugin.client.vehicle import read_position, read_vehicle

MAX_ROVERS = 16
"""Beyond that silent rovers are forgotten. One that is heard has a place: there are only 255 system ids."""
KEPT_S = 600.0
"""Seconds of silence for which an open call keeps a rover."""
MOST_SENT = 16
"""Messages that `outgoing` returns at once, at most."""
MAX_EVENTS = 1024
MAX_PROBLEMS = 8
_ADDRESSED = frozenset({"COMMAND_ACK", "FILE_TRANSFER_PROTOCOL"})


class OperatorClient:
    """Tracks every rover of a link and delivers answers to them.

    transactions: returns a new random id in 1..2^32-1 for each answer. ids: the system and component id of
    the messages that we send; None while not known. Replies addressed to other ids are ignored.
    """

    def __init__(self, transactions: Callable[[], int] = random_transaction) -> None:
        self.ids: tuple[int, int] | None = None
        self._rovers: dict[int, TrackedRover] = {}
        self._events: deque[ev.Event] = deque(maxlen=MAX_EVENTS)
        self._outbox = RequestOutbox(transactions, self._events.append)
        self._problems: set[tuple[int, str]] = set()

    @property
    def rovers(self) -> dict[int, TrackedRover]:
        """The rovers from whose companion something was received, by system id."""
        return {system: rover for system, rover in sorted(self._rovers.items()) if rover.known}

    @property
    def unsettled(self) -> list[Pending]:
        """The answers that are not settled yet, oldest first."""
        return self._outbox.unsettled

    @property
    def busy(self) -> bool:
        """Whether an answer, a policy request or a file that somebody waits for is not settled yet."""
        return self._outbox.busy

    def receive(self, message: Any, now: float) -> None:
        """Process one decoded message of any dialect. Never raises for its content."""
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
                self._events.extend(rover.handle_vehicle(vehicle))
            elif kind == "STATUSTEXT":
                self._events.extend(rover.handle_vehicle_text(message.severity, message.text, now))
            elif kind == "GLOBAL_POSITION_INT":
                rover.position = read_position(message.lat, message.lon, message.hdg) or rover.position
            return
        frame = bytes(message.get_msgbuf() or b"")
        rover.counters.bytes += len(frame)
        rover.signs = is_signed(frame)
        try:
            new_events = self._dispatch(rover, kind, message, now)
        except ValueError as error:
            self._not_understood(rover, str(error))
        else:
            closed = {event.call.id for event in new_events if isinstance(event, ev.CallEnded)}
            self._outbox.close(rover.system, closed, now)
            self._events.extend(new_events)

    def outgoing(self, now: float) -> list[Any]:
        """Return the messages to send now; also detects silent rovers and answers past their lifetime."""
        for rover in self._rovers.values():
            self._events.extend(rover.check_link(now))
        self._forget_silent(now)
        self._outbox.settle(now)
        messages: list[Any] = []
        for system in [rover.system for rover in self._rovers.values() if rover.alive(now)]:
            if len(messages) < MOST_SENT and (message := self._outbox.next(system, now)) is not None:
                messages.append(message)
                self._rovers[system] = self._rovers.pop(system)  # the others go first next time
        return messages

    def events(self) -> list[ev.Event]:
        """Return the events since the last call of this method."""
        new_events = list(self._events)
        self._events.clear()
        return new_events

    def answer(self, system: int, answer: Answer, now: float) -> Pending:
        """Send an answer to the rover `system`. It gets a transaction.

        The next calls of `outgoing` return it, once the rover is heard; answers to one rover keep their
        order. Raises PayloadError when it does not fit the wire format.
        """
        return self._outbox.answer(system, answer, now, heard=self._is_alive(system, now))

    def set_policy(self, system: int, policy: Policy, now: float) -> PendingPolicy:
        """Request a policy; it is sent once the rover is heard. Replaces an earlier request."""
        return self._outbox.set_policy(system, policy, now, heard=self._is_alive(system, now))

    def fetch(self, system: int, path: str, now: float, *, background: bool = False) -> Fetch:
        """Fetch a file of the rover's companion; the returned object shows the progress. Replaces another.

        background: nobody waits for it, so that it does not make this client `busy`.
        """
        return self._outbox.fetch(system, path, now, background=background)

    def resume(self, fetch: Fetch, now: float) -> None:
        """Go on with a fetch that was replaced, stopped or has failed: only what is missing is fetched."""
        self._outbox.resume(fetch, now)

    def stop(self, fetch: Fetch) -> None:
        """Stop a fetch. It may be resumed."""
        self._outbox.stop(fetch)

    def list_folder(self, system: int, path: str, now: float) -> Listing:
        """List a folder of the rover's companion; as `fetch`, which it replaces."""
        return self._outbox.list_folder(system, path, now)

    def request_parameters(self, system: int) -> None:
        """Request the parameter list of the rover's companion, as soon as it is heard."""
        self._outbox.request_parameters(system)

    def _is_alive(self, system: int, now: float) -> bool:
        rover = self._rovers.get(system)
        return rover is not None and rover.alive(now)

    def _rover(self, system: int, *, companion: bool) -> TrackedRover | None:
        may_come = 0 < system < 256 and (companion or len(self._rovers) < MAX_ROVERS)
        if system not in self._rovers and may_come:
            self._rovers[system] = TrackedRover(system)
        return self._rovers.get(system)

    def _forget_silent(self, now: float) -> None:
        """Beyond `MAX_ROVERS` forget those silent longest, but none that is heard or kept by an open call."""
        silent = [
            rover
            for rover in self._rovers.values()
            if rover.silence(now) >= (KEPT_S if rover.open_calls() else FRESH_S)
        ]
        silent.sort(key=lambda rover: rover.silence(now), reverse=True)
        for rover in silent[: max(0, len(self._rovers) - MAX_ROVERS)]:
            del self._rovers[rover.system]

    def _dispatch(self, rover: TrackedRover, kind: str, message: Any, now: float) -> list[ev.Event]:
        if kind == "HEARTBEAT":
            self._events.extend(rover.handle_heartbeat(now))
            return rover.handle_state(message.custom_mode, now)
        if kind == "STATUSTEXT":
            return rover.handle_text(message.severity, message.text, now)
        if kind == "PARAM_VALUE":
            return rover.handle_parameter(message.param_id, message.param_value)
        if kind == "ONBOARD_COMPUTER_STATUS":
            flags = getattr(message, "status_flags", 0)  # an old dialect does not have it
            rover.handle_computer(message.temperature_board, message.cpu_combined[0], flags, now)
        if kind == "TUNNEL":
            return self._unwrap(rover, message, now)
        if kind in _ADDRESSED and not self._is_for_us(message):
            return []
        if kind == "FILE_TRANSFER_PROTOCOL":
            self._outbox.handle_file(rover.system, bytes(message.payload), now)
        if kind == "COMMAND_ACK" and message.command == ANSWER_COMMAND:
            self._outbox.handle_policy_result(
                rover.system, granted=message.result == mavlink.MAV_RESULT_ACCEPTED
            )
        return []

    def _is_for_us(self, message: Any) -> bool:
        """Return whether a message is addressed to us; a target of 0, as MAVLink 1 leaves it, may be us."""
        to = message.target_system, message.target_component
        return self.ids is None or all(said in (0, own) for said, own in zip(to, self.ids, strict=True))

    def _unwrap(self, rover: TrackedRover, message: Any, now: float) -> list[ev.Event]:
        if message.payload_length > MAX_PAYLOAD:
            raise PayloadError(f"payload length {message.payload_length} is over {MAX_PAYLOAD}")
        payload = bytes(message.payload[: message.payload_length])
        if message.payload_type == TUNNEL_SUMMARY:
            return rover.handle_summary(Summary.unpack(payload), now)
        if message.payload_type == TUNNEL_CALL:
            return rover.handle_call(CallReport.unpack(payload), now)
        if message.payload_type == TUNNEL_ACKNOWLEDGEMENT:
            return self._acknowledged(rover, Acknowledgement.unpack(payload), now)
        return []

    def _acknowledged(self, rover: TrackedRover, ack: Acknowledgement, now: float) -> list[ev.Event]:
        pending = self._outbox.sent(rover.system, ack.transaction)
        if pending is None:
            return []
        if pending.status is DeliveryStatus.ACKNOWLEDGED:
            rover.counters.duplicate_acknowledgements += 1
            return []
        if pending.settled and ack.result is Result.BUSY:
            return []  # it will not be sent again, so "busy, will be sent again" would be wrong
        pending.acknowledge(ack, final=ack.result is not Result.BUSY)
        return [ev.Acknowledged(rover.system, ack), *rover.handle_acknowledgement(ack, now)]

    def _not_understood(self, rover: TrackedRover, problem: str) -> None:
        rover.counters.unreadable += 1
        if (rover.system, problem) not in self._problems and len(self._problems) < MAX_PROBLEMS:
            self._problems.add((rover.system, problem))
            self._events.append(ev.NotUnderstood(rover.system, problem))
