"""What is heard: sorted, checked, and handed to whoever answers it."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.link import encode
from companion.link.desk import AnswerDesk
from companion.link.guard import Guard
from companion.link.heard import Heard, ModeAck, Pulses, VehicleHeard
from companion.link.parameter_server import ParameterServer
from companion.link.sender import Sender
from companion.link.vehicle import VehicleTracker
from companion.wire.ids import ANSWER_COMMAND, AUTOPILOT_COMPONENT_ID, COMPONENT_ID, TUNNEL_ANSWER

CLASH_FOR = 10.0
_TELEMETRY = frozenset({"HEARTBEAT", "GLOBAL_POSITION_INT", "RC_CHANNELS", "CURRENT_MODE", "COMMAND_ACK"})
_REQUESTS = frozenset(
    {"PARAM_REQUEST_LIST", "PARAM_REQUEST_READ", "PARAM_SET", "TUNNEL", "COMMAND_LONG", "COMMAND_INT"}
)


class Listener:
    """Our autopilot's messages, and requests to component 191; component 0 may only be read."""

    def __init__(
        self,
        sender: Sender,
        guard: Guard,
        tracker: VehicleTracker,
        parameters: ParameterServer,
        desk: AnswerDesk,
    ) -> None:
        self._sender = sender
        self._guard = guard
        self._tracker = tracker
        self._parameters = parameters
        self._desk = desk
        self._clash_at: float | None = None

    @property
    def clash(self) -> bool:
        """Whether somebody else talks under our ids."""
        return self._clash_at is not None

    def tick(self, now: float) -> None:
        """A clash is over after 10 s of silence."""
        if self._clash_at is not None and now - self._clash_at > CLASH_FOR:
            self._clash_at = None

    def hear(self, message: Any, now: float) -> Heard | None:
        """Answer it here, or return what the daemon must know."""
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if sender == (self._sender.system_id, COMPONENT_ID):
            self._hear_ourselves(message, now)
            return None
        kind = message.get_type()
        if sender[1] == AUTOPILOT_COMPONENT_ID and kind in _TELEMETRY:
            return self._hear_autopilot(kind, sender[0], message, now)
        return None if self.clash else self._hear_request(kind, sender, message, now)

    def _hear_ourselves(self, message: Any, now: float) -> None:
        if self._sender.is_own(message):
            self._guard.rejected["echo"] += 1
            return
        self._guard.rejected["clash"] += 1
        self._clash_at = now
        self._sender.clear()

    def _hear_autopilot(self, kind: str, system_id: int, message: Any, now: float) -> Heard | None:
        if kind == "HEARTBEAT" and self._tracker.heartbeat(system_id, message, now):
            self._sender.system_id = system_id
        elif (kind == "GLOBAL_POSITION_INT" and self._tracker.position(system_id, message, now)) or (
            kind == "CURRENT_MODE" and self._tracker.mode(system_id, message, now)
        ):
            pass
        elif kind == "COMMAND_ACK" and self._tracker.is_ours(system_id):
            return self._hear_mode_ack(message)
        elif kind == "RC_CHANNELS" and self._tracker.is_ours(system_id):
            widths = tuple(int(getattr(message, f"chan{number}_raw")) for number in range(1, 19))
            return Pulses(widths, int(message.chancount))
        else:
            return None
        return None if self._tracker.vehicle is None else VehicleHeard(self._tracker.vehicle)

    def _hear_mode_ack(self, message: Any) -> ModeAck | None:
        for_us = message.target_component in (0, COMPONENT_ID)
        if message.command != mavlink.MAV_CMD_DO_SET_MODE or not for_us:
            return None
        return ModeAck(message.result == mavlink.MAV_RESULT_ACCEPTED, int(message.result))

    def _hear_request(self, kind: str, sender: tuple[int, int], message: Any, now: float) -> Heard | None:
        if kind not in _REQUESTS or message.target_system not in (0, self._sender.system_id):
            return None
        if message.target_component not in (0, COMPONENT_ID) or not self._guard.admits(sender, now):
            return None
        if kind == "PARAM_REQUEST_LIST":
            self._parameters.list_all(sender)
        elif kind == "PARAM_REQUEST_READ":
            self._parameters.read(sender, message, now)
        elif message.target_component != COMPONENT_ID or message.target_system == 0:
            self._guard.rejected["target"] += 1
        elif kind == "PARAM_SET":
            return self._parameters.set(sender, message, now)
        elif kind == "TUNNEL":
            return self._hear_tunnel(sender, message, now)
        else:
            return self._hear_command(sender, message, now)
        return None

    def _hear_tunnel(self, sender: tuple[int, int], message: Any, now: float) -> Heard | None:
        if message.payload_type != TUNNEL_ANSWER:
            return None
        if message.payload_length > len(message.payload):
            self._guard.rejected["payload"] += 1
            return None
        return self._desk.tunnel(sender, bytes(message.payload[: message.payload_length]), now)

    def _hear_command(self, sender: tuple[int, int], message: Any, now: float) -> Heard | None:
        if message.command == ANSWER_COMMAND:
            return self._desk.command(sender, message, now)
        saved = message.command == mavlink.MAV_CMD_PREFLIGHT_STORAGE
        result = mavlink.MAV_RESULT_ACCEPTED if saved else mavlink.MAV_RESULT_UNSUPPORTED
        self._sender.push("command ack", encode.command_ack(message.command, result, sender), now, to=sender)
        return None
