"""What is on its way to rovers: answers, policies, files and lists, each sent until something settles it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Sequence
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from companion.wire.answers import MAX_PAYLOAD, Operation
from companion.wire.ftp import FtpPayload
from companion.wire.ids import COMPONENT_ID, TUNNEL_ANSWER, Motion, Policy
from companion.wire.packing import PayloadError
from gcs_plugin.client import events as ev
from gcs_plugin.client.delivery import Pending, PolicyOnItsWay
from gcs_plugin.client.fetch import Fetch

PACE_S = 0.05
"""Between two messages to one rover: radios and PX4 lose bursts."""
MAX_PENDING = 64


class Outbox:
    """For each rover: answers in their order, the newest policy, the newest file, the list.

    transactions: gives each answer's id. tell: takes what became of answers and policies.
    """

    def __init__(self, transactions: Callable[[], int], tell: Callable[[ev.Event], None]) -> None:
        self._transactions = transactions
        self._tell = tell
        self._pending: deque[Pending] = deque(maxlen=MAX_PENDING)
        self._wishes: dict[int, PolicyOnItsWay] = {}
        self._fetches: dict[int, Fetch] = {}
        self._lists_wanted: set[int] = set()
        self._may_send_at: dict[int, float] = {}

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

    def answer(
        self,
        system: int,
        target: int,
        motion: Motion,
        operations: Sequence[Operation],
        now: float,
        *,
        heard: bool,
    ) -> Pending:
        """See `OperatorClient.answer`. heard: whether the rover is, or the answer is told to wait."""
        if len(self.unsettled) >= MAX_PENDING:
            raise PayloadError(f"{MAX_PENDING} answers wait already: is the link up?")
        pending = Pending(system, target, motion, tuple(operations), self._transactions(), now)
        while len(self._pending) >= MAX_PENDING:
            self._pending.remove(next(old for old in self._pending if old.settled))
        self._pending.append(pending)
        if not heard:
            self._tell_answer(pending)
        return pending

    def set_policy(self, system: int, policy: Policy, now: float, *, heard: bool) -> PolicyOnItsWay:
        """Ask for a policy, in place of one asked for before. heard: as for `answer`."""
        self._wishes[system] = wish = PolicyOnItsWay(system, policy, now)
        if not heard:
            self._tell_policy(wish)
        return wish

    def fetch(self, system: int, path: str, now: float) -> Fetch:
        """Fetch a file, in place of one on its way."""
        self._fetches[system] = fetch = Fetch(system, path, now)
        return fetch

    def request_parameters(self, system: int) -> None:
        """Ask for the list."""
        self._lists_wanted.add(system)

    def sent(self, system: int, transaction: int) -> Pending | None:
        """The answer that an acknowledgement is for, if it was sent from here."""
        asked = (system, transaction)
        pending = next((one for one in self._pending if (one.system, one.transaction) == asked), None)
        return None if pending is None or pending.first_sent is None else pending

    def hear_file(self, system: int, payload: bytes, now: float) -> None:
        """A part of a file. Raises FtpError for one that is none."""
        if system in self._fetches:
            self._fetches[system].hear(FtpPayload.unpack(payload), now)

    def hear_policy(self, system: int, *, granted: bool) -> None:
        """The rover has said whether its policy is as asked for."""
        wish = self._wishes.get(system)
        if wish is not None and wish.acknowledge(granted=granted):
            self._tell_policy(wish)

    def close(self, system: int, closed: Collection[int], now: float) -> None:
        """These calls are over: their answers are sent no more."""
        for pending in self.unsettled:
            if pending.system == system and pending.target in closed:
                pending.close(now)

    def settle(self, now: float) -> None:
        """Notice what ran out of time."""
        for pending in self._pending:
            if pending.settle(now):
                self._tell_answer(pending)
        for wish in self._wishes.values():
            if wish.settle(now):
                self._tell_policy(wish)
        for fetch in self._fetches.values():
            fetch.settle(now)

    def next(self, system: int, now: float) -> Any | None:
        """At most one message to this rover, which is heard."""
        if now < self._may_send_at.get(system, 0.0):
            return None
        message = self._next_wish(system, now) or self._next_answer(system, now)
        if message is None and system in self._lists_wanted:
            self._lists_wanted.discard(system)
            message = mavlink.MAVLink_param_request_list_message(system, COMPONENT_ID)
        if message is None and system in self._fetches:
            message = self._fetches[system].due(now)
        if message is not None:
            self._may_send_at[system] = now + PACE_S
        return message

    def _next_wish(self, system: int, now: float) -> Any | None:
        wish = self._wishes.get(system)
        if wish is None:
            return None
        before, message = wish.status, wish.due(now)
        if wish.status is not before:
            self._tell_policy(wish)
        return message

    def _next_answer(self, system: int, now: float) -> Any | None:
        for pending in self.unsettled:
            if pending.system != system:
                continue
            before = pending.status
            payload = pending.due(now)
            if payload is not None:
                if pending.status is not before:
                    self._tell_answer(pending)
                padded = payload.ljust(MAX_PAYLOAD, b"\0")
                return mavlink.MAVLink_tunnel_message(
                    system, COMPONENT_ID, TUNNEL_ANSWER, len(payload), padded
                )
            if pending.blocks(now):
                return None
        return None

    def _tell_answer(self, pending: Pending) -> None:
        self._tell(ev.AnswerMoved(pending.system, pending.target, pending.transaction, pending.status))

    def _tell_policy(self, wish: PolicyOnItsWay) -> None:
        self._tell(ev.PolicyMoved(wish.system, wish.policy, wish.status))
