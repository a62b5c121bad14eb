"""What is heard: sorted, checked, and handed to whoever answers it."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.autopilots.ardupilot import script_hold
from companion.link.channel import Channel
from companion.link.guard import Guard
from companion.link.heard import Heard, ModeAck, VehicleHeard
from companion.link.outbox import Outbox
from companion.link.receiver import Receiver
from companion.link.repeats import Repeats
from companion.link.requests import FILES, REQUESTS, Requests
from companion.link.speaker import WARNING, Speaker
from companion.link.vehicle import VehicleTracker
from companion.wire import notices
from companion.wire.ids import AUTOPILOT_COMPONENT_ID, COMPONENT_ID, TUNNEL_ANSWER
from companion.wire.messages import TELEMETRY


class Listener:
    """Our autopilot's messages, and requests to component 191, each on its way."""

    def __init__(
        self,
        outbox: Outbox,
        speaker: Speaker,
        guard: Guard,
        tracker: VehicleTracker,
        requests: Requests,
    ) -> None:
        self._outbox = outbox
        self._speaker = speaker
        self._guard = guard
        self._tracker = tracker
        self._requests = requests
        self._repeats = Repeats()
        self.receiver = Receiver()
        """Of the remote control."""

    def hear(self, message: Any, channel: Channel, now: float) -> Heard | None:
        """Answer what came by `channel` here, or return what the daemon must know."""
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if sender == (self._outbox.system_id, COMPONENT_ID):
            self._hear_ourselves(message, channel, now)
            return None
        channel.believe(sender, now)
        channel.sender.version.hear(message, now)
        self._guard.hear(sender, now)
        self._outbox.hear(sender, channel, now)
        kind = message.get_type()
        if sender[1] == AUTOPILOT_COMPONENT_ID and kind in TELEMETRY:
            if kind == "HEARTBEAT":
                return self._hear_heartbeat(sender[0], message, channel, now)
            if self._outbox.is_home(channel):
                return self._hear_autopilot(kind, sender[0], message, now)
            return None
        if channel.clash or not self._is_request(kind, sender, message, channel, now):
            return None
        return self._requests.hear(sender, message, now)

    def _hear_ourselves(self, message: Any, channel: Channel, now: float) -> None:
        if self._outbox.is_own(message):
            self._guard.rejected["echo"] += 1
            return
        self._guard.rejected["clash"] += 1
        if channel.hear_ourselves(now):
            self._speaker.say(notices.ids_taken(self._outbox.system_id, channel.name), WARNING, now)

    def _hear_heartbeat(self, system_id: int, message: Any, channel: Channel, now: float) -> Heard | None:
        if not self._tracker.claims(system_id, message, now):
            return None
        if not self._outbox.hear_autopilot(channel, now):
            return None
        self._tracker.heartbeat(system_id, message, now)
        self._outbox.system_id = system_id
        return None if self._tracker.vehicle is None else VehicleHeard(self._tracker.vehicle)

    def _hear_autopilot(self, kind: str, system_id: int, message: Any, now: float) -> Heard | None:
        if (kind == "GLOBAL_POSITION_INT" and self._tracker.position(system_id, message, now)) or (
            kind == "CURRENT_MODE" and self._tracker.mode(system_id, message, now)
        ):
            pass
        elif kind == "COMMAND_ACK" and self._tracker.is_ours(system_id):
            return self._hear_mode_ack(message)
        elif kind == "STATUSTEXT" and self._tracker.is_ours(system_id):
            return script_hold(message.text)
        elif kind == "RC_CHANNELS" and self._tracker.is_ours(system_id):
            return self.receiver.hear_pulses(message, now)
        else:
            if kind == "SYS_STATUS" and self._tracker.is_ours(system_id):
                self.receiver.hear_health(message, now)
            elif kind == "ATTITUDE":
                self._tracker.attitude(system_id, message, now)
            elif kind == "SYSTEM_TIME":
                self._tracker.time(system_id, message, now)
            return None
        return None if self._tracker.vehicle is None else VehicleHeard(self._tracker.vehicle)

    def _hear_mode_ack(self, message: Any) -> ModeAck | None:
        for_us = message.target_component in (0, COMPONENT_ID)
        if message.command != mavlink.MAV_CMD_DO_SET_MODE or not for_us:
            return None
        return ModeAck(message.result == mavlink.MAV_RESULT_ACCEPTED, int(message.result))

    def _is_request(
        self, kind: str, sender: tuple[int, int], message: Any, channel: Channel, now: float
    ) -> bool:
        if kind not in REQUESTS or message.target_system not in (0, self._outbox.system_id):
            return False
        if message.target_component not in (0, COMPONENT_ID):
            return False
        if kind == "TUNNEL" and message.payload_type != TUNNEL_ANSWER:
            return False  # what other rovers' companions tell everybody
        if self._repeats.is_repeated(message, channel.name, now):
            self._guard.rejected["repeated"] += 1
            return False
        if not self._guard.admits(sender, now, kind=FILES if kind == FILES else ""):
            return False
        self._repeats.keep(message, channel.name, now)
        return True
