"""The one owner of the MAVLink connection. Everything takes `now` (s, monotonic); nothing here blocks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from companion.autopilots import known_autopilot
from companion.link import encode
from companion.link.announcer import ERROR, Announcer
from companion.link.asking import Asking
from companion.link.connection import Connection
from companion.link.desk import AnswerDesk
from companion.link.guard import Guard
from companion.link.heard import AnswerRequest, Heard, PolicyRequest, Pulses, Vehicle
from companion.link.listener import Listener
from companion.link.parameter_server import ParameterServer
from companion.link.parser import Parser
from companion.link.sender import Sender
from companion.link.setpoints import Setpoints
from companion.link.settings import LinkSettings
from companion.link.speaker import Speaker
from companion.link.telling import Telling
from companion.link.transport import Transport, check_installed, open_transport
from companion.link.vehicle import VehicleTracker
from companion.wire.answers import Acknowledgement
from companion.wire.ids import AUTOPILOT_COMPONENT_ID, COMPONENT_ID, TUNNEL_CALL, Policy, State
from companion.wire.parameters import Parameter
from companion.wire.payloads import CallData, Summary

READS_PER_POLL = 512
"""More than a UDP socket keeps by default: after a stall the newest mode is heard before one decides."""
READS_AT_MOST = 4096
MODE_LIFETIME = 1.0


@dataclass(frozen=True)
class Counters:
    """Since the start. sent: bytes by budget ("unsolicited", "asked", "autopilot").

    dropped_summaries: kept off the wire by the budget. lost: frames that waited too long or found the queue
    full. bad: broken frames heard. rejected: requests turned away, by reason.
    """

    sent: Mapping[str, int]
    dropped_summaries: int
    lost: int
    bad: int
    rejected: Mapping[str, int]


class Link:
    """MAVLink component 191. Call `poll` when `fileno` is readable or `wait` has passed, then `tick`."""

    def __init__(
        self,
        settings: LinkSettings,
        parameters: Sequence[Parameter],
        now: float,
        *,
        opener: Callable[[], Transport] | None = None,
    ) -> None:
        """opener: makes the transport in place of the url's. Raises LinkError, ParameterError."""
        address = settings.address()
        if opener is None:
            check_installed(address)
            opener = partial(open_transport, address)
        self._connection = Connection(opener, now)
        self._opened = 0
        self._parser = Parser()
        self._sender = Sender(self._connection, settings, now)
        self._guard = Guard(settings.allowed_senders)
        self._speaker = Speaker(self._sender)
        self._parameters = ParameterServer(self._sender, self._speaker, self._guard, parameters)
        self._desk = AnswerDesk(self._sender, self._speaker, self._guard, self._parameters)
        self._tracker = VehicleTracker(settings.system_id)
        self._listener = Listener(self._sender, self._guard, self._tracker, self._parameters, self._desk)
        self._announcer = Announcer()
        self._telling = Telling(self._sender, now)
        self._returns = 0
        self._waits = settings.waits_for_vehicle
        self._asking = Asking(self._sender)
        self._setpoints = Setpoints(self._sender, now)

    @property
    def vehicle(self) -> Vehicle | None:
        """The newest that the autopilot said."""
        return self._tracker.vehicle

    @property
    def trouble(self) -> str | None:
        """Why nothing can be said now, for a person; None when all is well."""
        if self._listener.clash:
            own = f"{self._sender.system_id}/{COMPONENT_ID}"
            return f"another component {own} talks on this link: stop it, or this one stays silent"
        if self._connection.trouble is not None:
            return f"link lost: {self._connection.trouble}"
        return None

    @property
    def counters(self) -> Counters:
        """What was sent and what was turned away."""
        return Counters(
            sent=dict(self._sender.sent),
            dropped_summaries=self._telling.dropped,
            lost=self._sender.lost,
            bad=self._parser.bad,
            rejected=dict(self._guard.rejected),
        )

    def fileno(self) -> int | None:
        """For select; None while the device is absent. Ask each time: a reconnect changes it."""
        return self._connection.fileno()

    def wait(self, now: float) -> float:
        """Seconds after which `tick` may have something to send, at most 0.1."""
        return min(0.1, self._sender.wait(now))

    def close(self) -> None:
        """Give the device back."""
        self._connection.close()

    def poll(self, now: float) -> list[Heard]:
        """What arrived for the daemon; the protocol's own matters are answered here."""
        heard: list[Heard] = []
        for _ in range(READS_PER_POLL):
            data = self._connection.read(now)
            if not data:
                break
            for message in self._parser.feed(data, whole=self._connection.datagrams):
                event = self._listener.hear(message, now)
                if isinstance(event, Pulses):
                    self._asking.hear_pulses(now)
                if event is not None:
                    heard.append(event)
        return heard

    def skip(self, now: float) -> None:
        """Throw away what waits to be read."""
        for _ in range(READS_AT_MOST):
            if not self._connection.read(now):
                break

    def tick(self, now: float) -> None:
        """Send what is due, within pace and budgets."""
        self._tracker.tick(now)
        self._listener.tick(now)
        if self._listener.clash:
            self._sender.clear()
        self._setpoints.tick(self.vehicle, now)
        if self._listener.clash:  # nothing else is said, but an end of setpoints would set the vehicle moving
            self._sender.tick(now)
            return
        if self._waits and self.vehicle is None:
            return
        if (self._opened, self._returns) != (self._connection.opened, self._tracker.returns):
            self._opened, self._returns = self._connection.opened, self._tracker.returns
            self._telling.hurry()
        self._announce_due(now)
        self._parameters.tick(now)
        self._telling.tick(now, calling=self._announcer.is_open)
        self._asking.tick(self.vehicle, self._tracker.returns, now)
        self._sender.tick(now)

    def set_state(self, state: State, current_id: int, policy: Policy) -> None:
        """The heartbeat's state, open id (0 for none) and policy in force."""
        self._telling.set_state(state, current_id, policy)

    def summary(self, summary: Summary, now: float) -> None:
        """The newest figures; told at the table's rate, sequence and dropped filled in here."""
        self._telling.summary(summary, now)

    def numbers(self, values: Mapping[str, float], now: float) -> None:
        """AT_TRAV, AT_UNC, AT_SIM, AT_CALL, for plots; silent while a call is open."""
        self._telling.numbers(values, now)

    def announce(
        self, call: CallData | None, text: str, now: float, *, quiet: bool = False, severity: int = ERROR
    ) -> None:
        """The open call or hold, repeated until None or a closed one takes its place; cheap to say again.

        A closed one is told three times. quiet: the text repeats, but slowly and without becoming an ALERT.
        None with a text repeats the text alone ("Companion OFF: ...").
        """
        self._announcer.announce(call, text, now, quiet=quiet, severity=severity)

    def say(self, text: str, severity: int, now: float) -> None:
        """A text once, MAV_SEVERITY `severity`; the same one not again within 5 s."""
        self._speaker.say(text, severity, now)

    def acknowledge(self, request: AnswerRequest, ack: Acknowledgement, now: float) -> None:
        """What became of an answer, to the asker; kept for when it asks again."""
        self._desk.acknowledge(request, ack, now)

    def acknowledge_policy(self, request: PolicyRequest, now: float, *, accepted: bool) -> None:
        """Whether the policy asked for is in force, to the asker."""
        self._desk.acknowledge_policy(request, now, accepted=accepted)

    def ask_for_pulses(self) -> None:
        """From now on ask the autopilot for RC_CHANNELS, again whenever they stay away."""
        self._asking.wants_pulses = True

    def set_parameter(self, name: str, value: float, now: float) -> None:
        """The value now in force: echoed to the asker, or told to all when it changed by itself.

        Raises ParameterError for a name that is not listed or a value out of range.
        """
        self._parameters.changed(name, value, now)

    def set_mode(self, custom_mode: int, now: float) -> None:
        """Ask the autopilot for a mode, before all else; forgotten when it cannot be sent within 1 s."""
        vehicle = self.vehicle
        autopilot = known_autopilot(vehicle.autopilot, vehicle.type) if vehicle is not None else None
        if vehicle is None or autopilot is None:
            self._guard.rejected["no autopilot for modes"] += 1
        else:
            message = encode.set_mode(vehicle.system_id, autopilot.command(custom_mode))
            to = (vehicle.system_id, AUTOPILOT_COMPONENT_ID)
            self._sender.push("mode", message, now, key=0, lifetime=MODE_LIFETIME, to=to)

    def stand_still(self, *, on: bool) -> None:
        """Whether zero velocity is streamed to the autopilot, at the table's rate, until told otherwise."""
        self._setpoints.on = on

    def forget_mode(self) -> None:
        """A mode that was asked for and waits to be sent is not wanted any more."""
        self._sender.forget("mode")

    def _announce_due(self, now: float) -> None:
        while (spoken := self._announcer.text(now)) is not None:
            self._sender.push("call text", encode.text(spoken.text, spoken.severity), now)
        call = self._announcer.data(now)
        if call is not None:
            self._sender.push("call data", encode.tunnel(TUNNEL_CALL, call.pack()), now, key=call.id)
