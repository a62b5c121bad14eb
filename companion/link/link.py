"""Joins the parts of the link. Everything takes `now` (s, monotonic); nothing here blocks."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from companion.config.link_settings import LinkSettings
from companion.config.video import CameraSettings
from companion.link import encode
from companion.link.access_control import AccessControl
from companion.link.alerts import AlertRepeater, TextSender
from companion.link.answer_store import AnswerStore
from companion.link.answers import AnswerService
from companion.link.camera import CameraService
from companion.link.channel import Channel, channels_of
from companion.link.command_service import CommandService
from companion.link.counters import Counters, count
from companion.link.dead_man import DeadMan
from companion.link.ftp.server import FtpServer
from companion.link.inbound import InboundEvent
from companion.link.mission_download import MissionDownload
from companion.link.mode_commands import ModeCommands
from companion.link.outbox import Outbox
from companion.link.parameter_server import FOLDER as PARAMETERS
from companion.link.parameter_server import ParameterFile, ParameterServer
from companion.link.router import MessageRouter, RequestDispatcher
from companion.link.setpoints_and_intervals import MessageIntervals, Setpoints
from companion.link.signing import Signing
from companion.link.text_parameters import TextParameters
from companion.link.transport import Transport
from companion.link.vehicle import VehicleTracker
from companion.storage.served_tree import Tree
from companion.system.error_guard import ErrorGuard
from companion.vehicle.state import Vehicle
from companion.wire import notices
from companion.wire.ids import (
    AUTOPILOT_COMPONENT_ID,
    CAMERA_COMPONENT_ID,
    ERROR,
    TUNNEL_CALL,
    HeartbeatMode,
    Policy,
    SenderId,
    State,
)
from companion.wire.parameters import Parameter
from companion.wire.payloads import Summary

READING_FOR = 0.05
"""s that one `poll` may take for all connections together. What is left waits in the devices' buffers."""


class Link:
    """Acts as MAVLink component 191.

    Call `poll` when one of `filenos` is readable or `wait` is over, then `tick`. texts, alerts, parameters,
    text_parameters, answers, commands, modes, setpoints, camera, dead_man, mission: the
    services that the daemon uses.
    """

    def __init__(
        self,
        settings: LinkSettings,
        parameters: Sequence[Parameter],
        now: float,
        *,
        openers: Mapping[str, Callable[[], Transport]] | None = None,
        tree: Tree | None = None,
        signing: Signing | None = None,
        answer_store: AnswerStore | None = None,
        camera: CameraSettings | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """openers: by connection name, what makes its transport in place of the url. tree: files to serve.

        signing: signs each frame sent, and accepts only signed frames; each connection has its own link id.
        answer_store: with the replies from before a restart. camera: None where it is none.
        clock: monotonic s, by which `poll` limits its duration. Raises LinkSettingError, ParameterError.
        """
        self.most_budget = settings.most_budget
        self._signing = signing
        self._clock = clock
        self._channels = channels_of(
            settings,
            now,
            openers=openers or {},
            signing=signing,
            camera_id=camera.component if camera is not None else CAMERA_COMPONENT_ID,
        )
        self._access = AccessControl(settings.allowed_senders, signing)
        self._outbox = Outbox(self._channels, self._access.share)
        self.texts = TextSender(self._outbox)
        self._error_guard = ErrorGuard(lambda now: self.texts.send(notices.unexpected_error(), ERROR, now))
        self.parameters = ParameterServer(self._outbox, self.texts, self._access, parameters)
        self.text_parameters = TextParameters(self._outbox, self.texts, self._access, self.parameters)
        self.answer_store = AnswerStore() if answer_store is None else answer_store
        self.answers = AnswerService(
            self._outbox, self.texts, self._access, self.parameters, self.text_parameters, self.answer_store
        )
        self.commands = CommandService(self._outbox, self.texts, self._access, self.parameters)
        self.camera = CameraService(self._outbox, self.texts, self._access, self.answers, camera)
        self._tracker = VehicleTracker(settings.system_id)
        served = (tree or Tree()).with_folder(PARAMETERS, ParameterFile(self.parameters.packed))
        self._files = FtpServer(self._outbox, self._access, served)
        requests = RequestDispatcher(
            self._access,
            self.parameters,
            self.text_parameters,
            self.answers,
            self.commands,
            self._files,
            self.camera,
        )
        self.modes = ModeCommands(self._outbox, self._access, self._tracker)
        self.dead_man = DeadMan(self._outbox, self.texts)
        self.mission = MissionDownload(self._outbox)
        self._router = MessageRouter(
            self._outbox,
            self.texts,
            self._access,
            self._tracker,
            self.modes,
            requests,
            self.dead_man,
            self.mission,
        )
        self.alerts = AlertRepeater()
        self._returns_seen = 0
        self._intervals = MessageIntervals(self._outbox, self._router.remote_control)
        self.setpoints = Setpoints(self._outbox, now)
        self.sent_at = now
        """When `tick` last sent on every connection without an error."""

    @property
    def vehicle(self) -> Vehicle | None:
        """The newest state that the autopilot reported; None before it is received."""
        return self._tracker.vehicle

    @property
    def trouble(self) -> str | None:
        """Where and why nothing can be sent now, for a person; None when all is well."""
        each = [channel.trouble for channel in self._channels]
        if self._signing is not None:
            each.append(self._signing.trouble)
        return "; ".join(trouble for trouble in each if trouble) or None

    @property
    def stores_timestamps(self) -> bool:
        """Whether signing timestamps can be stored, as far as is known; True without a key."""
        return self._signing is None or self._signing.stores

    @property
    def counters(self) -> Counters:
        """The counters of all connections as they stand now."""
        return count(self._channels, self._outbox, self.texts, self._access)

    def filenos(self) -> list[int]:
        """The file descriptors to select on. Read them each time: a reconnect changes them."""
        numbers = (channel.fileno() for channel in self._channels)
        return [number for number in numbers if number is not None]

    def wait(self, now: float) -> float:
        """Seconds after which `tick` may have something to send, at most 0.1."""
        return min(channel.wait(now) for channel in self._channels)

    def close(self) -> None:
        """Close the devices and write signing timestamps to disk."""
        for channel in self._channels:
            channel.close()
        if self._signing is not None:
            self._signing.close()

    def poll(self, now: float) -> list[InboundEvent]:
        """Read what arrived; answer protocol requests here, and return the events for the daemon.

        Connections are read in turn, for 50 ms and at least once each, so that a flooded one does not block
        the others. An error in one message is logged and reported: no frame can end the companion.
        """
        events: list[InboundEvent] = []
        with self._error_guard.survived("page", now):
            events += self.answers.poll_page(now)
        until = self._clock() + READING_FOR
        reads = {channel: channel.poll(now) for channel in self._channels}
        while reads:
            for channel in list(reads):
                messages = None
                with self._error_guard.survived(channel.label, now):
                    messages = next(reads[channel], None)
                if messages is None:
                    del reads[channel]
                else:
                    events += self._route(messages, channel, now)
            if self._clock() >= until:
                break
        return events

    def discard_received(self, now: float) -> None:
        """Discard what waits to be read."""
        for channel in self._channels:
            channel.discard_received(now)

    def tick(self, now: float) -> None:
        """Send what is due on all connections, within pace and budgets."""
        self._tracker.tick(now)
        has_vehicle = self.vehicle is not None
        if self._signing is not None:
            self._signing.tick(now)
            # Frames of an autopilot with an old clock are refused; one frame of ours sets its clock right.
            has_vehicle |= self._signing.behind
        sending = [one for one in self._channels if one.may_send(now, has_vehicle=has_vehicle)]
        self.setpoints.tick(self.vehicle, now)
        self.dead_man.tick(self.vehicle, now)
        self._intervals.wants_rc_channels |= self.dead_man.wants_rc_channels
        returns = self._tracker.returns + self._outbox.moves
        if sending:
            self._announce_due(now)
            self.parameters.tick(now)
            self.text_parameters.tick(now)
            self.camera.tick(now)
            self._intervals.tick(self.vehicle, returns, now)
            self.mission.tick(self.vehicle, returns, now)
        self.modes.tick(now)
        # The autopilot may have rebooted, or be on another connection: a heartbeat announces us at once.
        if returns != self._returns_seen:
            self._returns_seen = returns
            for channel in sending:
                channel.periodic.send_heartbeat_now()
        sound = 0
        for channel in self._channels:
            with self._error_guard.survived(channel.label, now):
                channel.tick(now, calling=self.alerts.is_open)
                sound += 1
        if sound == len(self._channels):
            self.sent_at = now
        with self._error_guard.survived("files", now):
            self._files.tick(now)

    def set_state(
        self,
        state: State,
        current_id: int,
        policy: Policy,
        *,
        fault_accepted: bool = False,
        braking: bool = False,
        guiding: bool = False,
    ) -> None:
        """Set what the heartbeat reports, see `HeartbeatMode`: current_id 0 for none, policy in force."""
        content = HeartbeatMode(state, current_id, policy, fault_accepted, braking, guiding)
        for channel in self._channels:
            channel.periodic.set_state(content)

    def summary(self, summary: Summary, now: float) -> None:
        """Set the newest summary, which is sent at the table's rate.

        Each connection fills in its own sequence number and count of dropped summaries.
        """
        for channel in self._channels:
            channel.periodic.summary(summary, now)

    def numbers(self, values: Mapping[str, float], now: float) -> None:
        """Set the newest AT_TRAV, AT_UNC, AT_SIM and AT_CALL, for plots. Not sent while a call is open."""
        for channel in self._channels:
            channel.periodic.numbers(values, now)

    def computer(self, figures: Mapping[str, Any], now: float) -> None:
        """Set the newest figures of this computer, see `Computer.measure`. Not sent while a call is open."""
        for channel in self._channels:
            channel.periodic.computer(figures, now)

    def share(self, sender: SenderId) -> SenderId:
        """Return the key of the share of the link that `sender` counts under: see `AccessControl.share`."""
        return self._access.share(sender)

    def request_quick_motion(self, *, quick: bool) -> None:
        """Request attitude and position ten times a second, as the vehicle is driven by them, or as usual."""
        self._intervals.quick = quick

    def set_current_item(self, item: int, now: float) -> None:
        """Make an item of the mission the current one. MISSION_CURRENT shows whether it is."""
        if self.vehicle is not None:
            system = self.vehicle.system_id
            message, to = encode.set_item(system, item), (system, AUTOPILOT_COMPONENT_ID)
            self._outbox.push("set item", message, now, key=0, lifetime=0.5, to=to)

    def request_rc_channels(self) -> None:
        """Request RC_CHANNELS from the autopilot from now on, and again whenever they stop."""
        self._intervals.wants_rc_channels = True

    def set_rate(self, name: str, rate: float) -> None:
        """Set how many summaries ("summary"), or of each number ("number"), are sent per second; 0: none."""
        for channel in self._channels:
            channel.periodic.periods[name] = 1.0 / rate if rate else math.inf

    def set_budget(self, rate: float, now: float) -> None:
        """Set the B/s of unsolicited traffic on the first connection, 0 unlimited; `most_budget` at most."""
        self._channels[0].sender.set_budget(rate, now)

    def _route(self, messages: Sequence[Any], channel: Channel, now: float) -> Iterator[InboundEvent]:
        for message in messages:
            with self._error_guard.survived(message.get_type(), now):
                if not self._access.accepts(message, now, first=channel is self._channels[0]):
                    continue
                event = self._router.route(message, channel, now)
                if event is not None:
                    yield event

    def _announce_due(self, now: float) -> None:
        while (due := self.alerts.text(now)) is not None:
            self._outbox.push("call text", encode.text(due.text, due.severity), now)
        call = self.alerts.data(now)
        if call is not None:
            self._outbox.push("call data", encode.tunnel(TUNNEL_CALL, call.pack()), now, key=call.id)
