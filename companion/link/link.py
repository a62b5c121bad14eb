"""The one owner of the MAVLink connections. Everything takes `now` (s, monotonic); nothing here blocks."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from companion.link import encode
from companion.link.access_control import AccessControl
from companion.link.alerts import ERROR, AlertRepeater, TextSender
from companion.link.answers import AnswerService
from companion.link.channel import Channel, channels_of
from companion.link.command_service import CommandService
from companion.link.counters import Counters, count
from companion.link.ftp.server import FtpServer
from companion.link.inbound import AnswerRequest, InboundEvent, PolicyRequest, ResetRequest, WordsRequest
from companion.link.outbox import Outbox
from companion.link.parameter_server import FOLDER as PARAMETERS
from companion.link.parameter_server import ParameterFile, ParameterServer
from companion.link.router import MessageRouter, RequestDispatcher
from companion.link.settings import LinkSettings
from companion.link.signing import Signing
from companion.link.text_parameters import TextParameters
from companion.link.transport import Transport
from companion.link.vehicle import VehicleTracker
from companion.link.vehicle_commands import MessageIntervals, ModeCommands, Setpoints
from companion.storage.served_tree import Tree
from companion.system.error_guard import ErrorGuard
from companion.vehicle.state import Vehicle
from companion.wire import notices
from companion.wire.answers import Acknowledgement
from companion.wire.ids import TUNNEL_CALL, Policy, State
from companion.wire.parameters import Parameter
from companion.wire.payloads import CallData, Summary

READING_FOR = 0.05
"""s of one `poll`, all connections together: what waits longer stays in the devices' buffers."""


class Link:
    """MAVLink component 191. Call `poll` when one of `filenos` is readable or `wait` is over, then `tick`."""

    def __init__(
        self,
        settings: LinkSettings,
        parameters: Sequence[Parameter],
        now: float,
        *,
        openers: Mapping[str, Callable[[], Transport]] | None = None,
        tree: Tree | None = None,
        signing: Signing | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """openers: make the transports in place of the urls', by name. tree: what the ground may read.

        signing: signs all that leaves, and lets in only what is signed; each connection has a link id.
        clock: s, by which `poll` sees that it took long enough.
        Raises LinkError, ParameterError.
        """
        self.most_budget = settings.most_budget
        self._signing = signing
        self._clock = clock
        self._channels = channels_of(settings, now, openers=openers or {}, signing=signing)
        self._access = AccessControl(settings.allowed_senders, signing)
        self._outbox = Outbox(self._channels, self._access.share)
        self._text_sender = TextSender(self._outbox)
        self._error_guard = ErrorGuard(lambda now: self.say(notices.unexpected_error(), ERROR, now))
        self._parameters = ParameterServer(self._outbox, self._text_sender, self._access, parameters)
        self._texts = TextParameters(self._outbox, self._text_sender, self._access, self._parameters)
        self._answers = AnswerService(self._outbox, self._text_sender, self._access, self._parameters)
        self._commands = CommandService(self._outbox, self._text_sender, self._access, self._parameters)
        self._tracker = VehicleTracker(settings.system_id)
        served = (tree or Tree()).beside(PARAMETERS, ParameterFile(self._parameters.packed))
        self._files = FtpServer(self._outbox, self._access, served)
        requests = RequestDispatcher(
            self._access,
            self._parameters,
            self._texts,
            self._answers,
            self._commands,
            self._files,
        )
        self._router = MessageRouter(self._outbox, self._text_sender, self._access, self._tracker, requests)
        self._alerts = AlertRepeater()
        self._returns_seen = 0
        self._intervals = MessageIntervals(self._outbox, self._router.remote_control)
        self._modes = ModeCommands(self._outbox, self._access)
        self._setpoints = Setpoints(self._outbox, now)

    @property
    def vehicle(self) -> Vehicle | None:
        """The newest that the autopilot said."""
        return self._tracker.vehicle

    @property
    def trouble(self) -> str | None:
        """Where and why nothing can be said now, for a person; None when all is well."""
        each = [channel.trouble for channel in self._channels]
        if self._signing is not None:
            each.append(self._signing.trouble)
        return "; ".join(trouble for trouble in each if trouble) or None

    @property
    def counters(self) -> Counters:
        """What was sent and what was turned away."""
        return count(self._channels, self._outbox, self._text_sender, self._access)

    def filenos(self) -> list[int]:
        """For select: the devices that are there. Ask each time: a reconnect changes them."""
        numbers = (channel.fileno() for channel in self._channels)
        return [number for number in numbers if number is not None]

    def wait(self, now: float) -> float:
        """Seconds after which `tick` may have something to send, at most 0.1."""
        return min(channel.wait(now) for channel in self._channels)

    def close(self) -> None:
        """Give the devices back."""
        for channel in self._channels:
            channel.close()
        if self._signing is not None:
            self._signing.close()

    def poll(self, now: float) -> list[InboundEvent]:
        """What arrived for the daemon; the protocol's own matters are answered here.

        Connections are read by turns, for 50 ms and once each at least: none that is flooded keeps another
        unheard. An error over one message is survived and said: nobody ends the companion by a frame.
        """
        events: list[InboundEvent] = []
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
                    events += self._hear(messages, channel, now)
            if self._clock() >= until:
                break
        return events

    def skip(self, now: float) -> None:
        """Throw away what waits to be read."""
        for channel in self._channels:
            channel.skip(now)

    def tick(self, now: float) -> None:
        """Send what is due, within pace and budgets."""
        self._tracker.tick(now)
        has_vehicle = self.vehicle is not None
        if self._signing is not None:
            self._signing.tick(now)
            has_vehicle |= self._signing.behind
        speaking = [one for one in self._channels if one.may_speak(now, has_vehicle=has_vehicle)]
        self._setpoints.tick(self.vehicle, now)
        returns = self._tracker.returns + self._outbox.moves
        if speaking:
            self._announce_due(now)
            self._parameters.tick(now)
            self._texts.tick(now)
            self._intervals.tick(self.vehicle, returns, now)
        if returns != self._returns_seen:
            self._returns_seen = returns
            for channel in speaking:
                channel.periodic.hurry()
        for channel in self._channels:
            with self._error_guard.survived(channel.label, now):
                channel.tick(now, calling=self._alerts.is_open)
        with self._error_guard.survived("files", now):
            self._files.tick(now)

    def set_state(self, state: State, current_id: int, policy: Policy) -> None:
        """The heartbeat's state, open id (0 for none) and policy in force."""
        for channel in self._channels:
            channel.periodic.set_state(state, current_id, policy)

    def summary(self, summary: Summary, now: float) -> None:
        """The newest figures; told at the table's rate; each connection fills in its sequence and drops."""
        for channel in self._channels:
            channel.periodic.summary(summary, now)

    def numbers(self, values: Mapping[str, float], now: float) -> None:
        """AT_TRAV, AT_UNC, AT_SIM, AT_CALL, for plots; silent while a call is open."""
        for channel in self._channels:
            channel.periodic.numbers(values, now)

    def announce(
        self, call: CallData | None, text: str, now: float, *, quiet: bool = False, severity: int = ERROR
    ) -> None:
        """The open call or hold, repeated until None or a closed one takes its place; cheap to say again.

        A closed one is told three times. quiet: the text repeats, but slowly and without becoming an ALERT.
        None with a text repeats the text alone ("Companion OFF: ...").
        """
        self._alerts.announce(call, text, now, quiet=quiet, severity=severity)

    def say(self, text: str, severity: int, now: float) -> None:
        """A text once, MAV_SEVERITY `severity`; the same one not again within 5 s."""
        self._text_sender.say(text, severity, now)

    def acknowledge(self, request: AnswerRequest, ack: Acknowledgement, now: float) -> None:
        """What became of an answer, to the asker; kept for when it asks again."""
        self._answers.acknowledge(request, ack, now)

    def acknowledge_words(self, request: WordsRequest, now: float, *, accepted: bool) -> None:
        """Whether words that were set as text are in force, to the asker."""
        self._texts.acknowledge(request, now, accepted=accepted)

    def acknowledge_command(self, request: PolicyRequest | ResetRequest, result: int, now: float) -> None:
        """What became of it, MAV_RESULT, to the asker."""
        self._commands.acknowledge(request, result, now)

    def ask_for_pulses(self) -> None:
        """From now on ask the autopilot for RC_CHANNELS, again whenever they stay away."""
        self._intervals.wants_pulses = True

    def set_parameter(self, name: str, value: float, now: float) -> None:
        """The value now in force: echoed to the asker, or told to all when it changed by itself.

        Raises ParameterError for a name that is not listed or a value out of range.
        """
        self._parameters.changed(name, value, now)

    def set_configured(self, values: Mapping[str, float]) -> None:
        """What the parameters are as configured, for who asks for their defaults."""
        self._parameters.configured = values

    def keep_parameter(self, name: str, now: float) -> None:
        """A value that was asked for is not taken: the one in force is echoed."""
        self._parameters.changed(name, self._parameters.value(name), now)

    def set_undecided_for(self, seconds: float) -> None:
        """A request that was handed on is decided within so long, and not handed on again before."""
        self._access.undecided_for = seconds

    def set_words(self, words: Mapping[str, float]) -> None:
        """The words in force, for who reads them as text."""
        self._texts.set_words(words)

    def set_rate(self, name: str, rate: float) -> None:
        """How often a second summaries ("summary") or each of the numbers ("number") are told; 0: never."""
        for channel in self._channels:
            channel.periodic.periods[name] = 1.0 / rate if rate else math.inf

    def set_budget(self, rate: float, now: float) -> None:
        """B/s of unsolicited traffic on the first connection, 0 unlimited; `most_budget` at most."""
        self._channels[0].sender.set_budget(rate, now)

    def set_mode(self, custom_mode: int, now: float) -> None:
        """Ask the autopilot for a mode, before all else; forgotten when it cannot be sent within 1 s.

        Where somebody else speaks under our ids, only for one that does not drive.
        """
        self._modes.ask(self.vehicle, custom_mode, now)

    def urge_hold(self, now: float) -> None:
        """A mode that was asked for and does not drive leaves now, not with the next `tick`."""
        self._modes.urge_hold(now)

    def stand_still(self, *, on: bool) -> None:
        """Whether zero velocity is streamed to the autopilot, at the table's rate, until told otherwise."""
        self._setpoints.on = on

    def forget_mode(self) -> None:
        """A mode that was asked for and waits to be sent is not wanted any more."""
        self._modes.forget()

    def _hear(self, messages: Sequence[Any], channel: Channel, now: float) -> Iterator[InboundEvent]:
        for message in messages:
            with self._error_guard.survived(message.get_type(), now):
                if not self._access.believes(message, now):
                    continue
                event = self._router.hear(message, channel, now)
                if event is not None:
                    yield event

    def _announce_due(self, now: float) -> None:
        while (due := self._alerts.text(now)) is not None:
            self._outbox.push("call text", encode.text(due.text, due.severity), now)
        call = self._alerts.data(now)
        if call is not None:
            self._outbox.push("call data", encode.tunnel(TUNNEL_CALL, call.pack()), now, key=call.id)
