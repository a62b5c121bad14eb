"""Routes each received message: checks it, and passes it to the service that answers it."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.link.access_control import AccessControl
from companion.link.alerts import TextSender
from companion.link.answers import AnswerService
from companion.link.camera import CameraService
from companion.link.channel import Channel
from companion.link.command_service import CommandService
from companion.link.dead_man import STICKS, DeadMan
from companion.link.ftp.server import FtpServer
from companion.link.inbound import InboundEvent, VehicleUpdate
from companion.link.mission_download import KINDS, MissionDownload
from companion.link.mode_commands import ModeCommands
from companion.link.outbox import Outbox
from companion.link.parameter_server import ParameterServer
from companion.link.text_parameters import TextParameters
from companion.link.vehicle import RemoteControl, VehicleTracker
from companion.vehicle.ardupilot import script_hold
from companion.wire import notices
from companion.wire.ids import (
    ANSWER_COMMAND,
    AUTOPILOT_COMPONENT_ID,
    COMPONENT_ID,
    TUNNEL_ANSWER,
    WARNING,
    SenderId,
)
from companion.wire.messages import TELEMETRY
from companion.wire.parameters import ANSWER

WITHIN = 1.0
"""s within which the same request on another connection is a copy."""
MAX_REMEMBERED = 512
"""Requests that are remembered: more than the rate limits admit in a second."""
_HEADER_1, _HEADER_2 = 6, 10


class Deduplicator:
    """Recognizes copies of a request that reached us by several connections.

    The same request again on the same connection is a new request.
    """

    def __init__(self) -> None:
        self._admitted: OrderedDict[tuple[int, int, int, bytes], tuple[str, float]] = OrderedDict()

    def is_repeated(self, message: Any, connection: str, now: float) -> bool:
        """Whether the same request was admitted from another connection within the last second."""
        before, at = self._admitted.get(_key(message), (connection, now))
        return before != connection and now - at <= WITHIN

    def keep(self, message: Any, connection: str, now: float) -> None:
        """Remember `message`, which was admitted."""
        key = _key(message)
        self._admitted[key] = (connection, now)
        self._admitted.move_to_end(key)
        if len(self._admitted) > MAX_REMEMBERED:
            self._admitted.popitem(last=False)


def _key(message: Any) -> tuple[int, int, int, bytes]:
    """Sender, message id and payload, without the zeros at its end that only MAVLink 2 leaves out."""
    frame = message.get_msgbuf()
    start = _HEADER_1 if frame[0] == mavlink.PROTOCOL_MARKER_V1 else _HEADER_2
    payload = bytes(frame[start : start + frame[1]]).rstrip(b"\0")
    return message.get_srcSystem(), message.get_srcComponent(), message.get_msgId(), payload


FILES = "FILE_TRANSFER_PROTOCOL"
COMMANDS = frozenset({"COMMAND_LONG", "COMMAND_INT"})
REQUESTS = frozenset(
    {
        "PARAM_REQUEST_LIST",
        "PARAM_REQUEST_READ",
        "PARAM_SET",
        "PARAM_EXT_REQUEST_LIST",
        "PARAM_EXT_REQUEST_READ",
        "PARAM_EXT_SET",
        "TUNNEL",
        *COMMANDS,
        FILES,
    }
)


class RequestDispatcher:
    """Passes each admitted request (`REQUESTS`) to the service that answers it."""

    def __init__(
        self,
        access: AccessControl,
        parameters: ParameterServer,
        texts: TextParameters,
        answers: AnswerService,
        commands: CommandService,
        files: FtpServer,
        camera: CameraService,
    ) -> None:
        self._access = access
        self._parameters = parameters
        self._texts = texts
        self._answers = answers
        self._commands = commands
        self._files = files
        self.camera = camera

    def dispatch(self, sender: SenderId, message: Any, now: float) -> InboundEvent | None:
        """Answer a request here, or return the event that the daemon must handle."""
        kind = message.get_type()
        if message.target_component not in (0, COMPONENT_ID):
            return self._to_camera(kind, sender, message, now)
        if kind == "PARAM_REQUEST_LIST":
            self._parameters.list_all(sender)
        elif kind == "PARAM_REQUEST_READ":
            self._parameters.read(sender, message, now)
        elif kind == "PARAM_EXT_REQUEST_LIST":
            self._texts.list_all(sender)
        elif kind == "PARAM_EXT_REQUEST_READ":
            self._texts.read(sender, message, now)
        elif message.target_component != COMPONENT_ID or message.target_system == 0:
            self._access.rejected["target"] += 1
        elif kind == FILES:
            self._files.receive(sender, message, now)
        elif kind == "PARAM_SET":
            return self._set(sender, message, now)
        elif kind == "PARAM_EXT_SET":
            text = self._texts.set(sender, message, now)
            return None if text is None else self._answers.admit(text, now)
        elif kind == "TUNNEL":
            return self._take_answer(sender, message, now)
        elif message.command == ANSWER_COMMAND:
            return self._answers.command(sender, message, now)
        else:
            return self._commands.receive(sender, message, now)
        return None

    def _to_camera(self, kind: str, sender: SenderId, message: Any, now: float) -> InboundEvent | None:
        if kind not in COMMANDS or message.target_system == 0:
            self._access.rejected["target"] += 1
            return None
        return self.camera.receive(sender, message, now)

    def _set(self, sender: SenderId, message: Any, now: float) -> InboundEvent | None:
        request = self._parameters.set(sender, message, now)
        if request is not None and request.name == ANSWER:
            return self._answers.parameter(request, now)
        return request

    def _take_answer(self, sender: SenderId, message: Any, now: float) -> InboundEvent | None:
        if message.payload_length > len(message.payload):
            self._access.rejected["payload"] += 1
            return None
        return self._answers.tunnel(sender, bytes(message.payload[: message.payload_length]), now)


class MessageRouter:
    """Takes every accepted message: our autopilot's telemetry, and requests to component 191."""

    def __init__(
        self,
        outbox: Outbox,
        text_sender: TextSender,
        access: AccessControl,
        tracker: VehicleTracker,
        modes: ModeCommands,
        requests: RequestDispatcher,
        dead_man: DeadMan,
        mission: MissionDownload,
    ) -> None:
        self._outbox = outbox
        self._text_sender = text_sender
        self._access = access
        self._tracker = tracker
        self._modes = modes
        self._requests = requests
        self._dead_man = dead_man
        self._mission = mission
        self._deduplicator = Deduplicator()
        self.remote_control = RemoteControl()

    def route(self, message: Any, channel: Channel, now: float) -> InboundEvent | None:
        """Handle a message received on `channel`; return the event that the daemon must handle, if any."""
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if sender == (self._outbox.system_id, COMPONENT_ID):
            self._take_own_ids(message, channel, now)
            return None
        camera = self._requests.camera
        if camera.component and sender == (self._outbox.system_id, camera.component):
            if not self._outbox.is_own(message):
                camera.note_id_conflict(now)
            return None
        channel.note_accepted(sender, now)
        channel.sender.version.received(message, now)
        self._access.renew_share(sender, now)
        self._outbox.note_route(sender, channel, now)
        kind = message.get_type()
        # Telemetry counts from one connection only: on two, every value would arrive twice and out of order.
        if sender[1] == AUTOPILOT_COMPONENT_ID and kind in TELEMETRY:
            if kind == "HEARTBEAT":
                return self._take_heartbeat(sender[0], message, channel, now)
            if self._outbox.is_home(channel):
                return self._take_telemetry(kind, sender[0], message, now)
            return None
        if kind in STICKS:
            self._dead_man.sticks_received(sender, message, now)
            return None
        if channel.id_conflict or not self._is_request(kind, sender, message, channel, now):
            return None
        return self._requests.dispatch(sender, message, now)

    def _take_own_ids(self, message: Any, channel: Channel, now: float) -> None:
        if self._outbox.is_own(message):
            self._access.rejected["echo"] += 1
            return
        self._access.rejected["clash"] += 1
        if message.get_type() in STICKS:
            self._dead_man.sticks_received((self._outbox.system_id, COMPONENT_ID), message, now)
        if channel.note_id_conflict(now):
            self._text_sender.send(notices.ids_taken(self._outbox.system_id, channel.name), WARNING, now)

    def _take_heartbeat(
        self, system_id: int, message: Any, channel: Channel, now: float
    ) -> InboundEvent | None:
        if not self._tracker.claims(system_id, message, now):
            return None
        moves, counts = self._outbox.moves, self._outbox.note_autopilot(channel, now)
        if self._outbox.moves != moves:
            self._tracker.home_moved()
        if not counts:
            return None
        self._tracker.heartbeat(system_id, message, now)
        self._outbox.system_id = system_id
        return None if self._tracker.vehicle is None else VehicleUpdate(self._tracker.vehicle)

    def _take_telemetry(self, kind: str, system_id: int, message: Any, now: float) -> InboundEvent | None:
        changed = {
            "GLOBAL_POSITION_INT": self._tracker.position,
            "CURRENT_MODE": self._tracker.mode,
            "MISSION_CURRENT": self._tracker.mission,
            "MISSION_ITEM_REACHED": self._tracker.item_reached,
        }.get(kind)
        if changed is not None and changed(system_id, message, now):
            pass
        elif kind == "COMMAND_ACK" and self._tracker.is_ours(system_id):
            if message.target_component not in (0, COMPONENT_ID):
                return None
            return self._modes.answered(message, now)
        elif kind == "STATUSTEXT" and self._tracker.is_ours(system_id):
            return script_hold(message.text)
        elif kind == "RC_CHANNELS" and self._tracker.is_ours(system_id):
            channels = self.remote_control.receive_pulses(message, now)
            self._dead_man.rc_received(channels, now)
            return channels
        else:
            if kind == "SYS_STATUS" and self._tracker.is_ours(system_id):
                self.remote_control.receive_health(message, now)
            elif kind == "ATTITUDE":
                self._tracker.attitude(system_id, message, now)
            elif kind == "VFR_HUD":
                self._tracker.throttle(system_id, message, now)
            elif kind == "SYSTEM_TIME":
                self._tracker.time(system_id, message, now)
            elif kind in KINDS and self._tracker.is_ours(system_id):
                self._mission.receive(message, now)
            return None
        return None if self._tracker.vehicle is None else VehicleUpdate(self._tracker.vehicle)

    def _is_request(
        self, kind: str, sender: tuple[int, int], message: Any, channel: Channel, now: float
    ) -> bool:
        if kind not in REQUESTS or message.target_system not in (0, self._outbox.system_id):
            return False
        # Without a camera, component 0 is in this list twice.
        if message.target_component not in (0, COMPONENT_ID, self._requests.camera.component):
            return False
        if kind == "TUNNEL" and message.payload_type != TUNNEL_ANSWER:
            return False  # what the companions of other rovers broadcast
        if self._deduplicator.is_repeated(message, channel.name, now):
            self._access.rejected["repeated"] += 1
            return False
        if not self._access.admits(sender, now, kind=FILES if kind == FILES else ""):
            return False
        self._deduplicator.keep(message, channel.name, now)
        return True
