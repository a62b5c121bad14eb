"""Schedules what is sent to rovers: answers, policy requests, file requests and list requests."""

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
"""Seconds between two messages to one rover, since radios and PX4 lose messages of a burst."""
MAX_PENDING = 64


class Outbox:
    """Holds, for each rover, answers in order, the newest policy request, the newest file, a list request.

    transactions: returns an id for each answer. tell: receives the events of answers and policy requests.
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
        """The answers that are not settled yet, oldest first."""
        return [pending for pending in self._pending if not pending.settled]

    @property
    def busy(self) -> bool:
        """Whether an answer, a policy request or a file is not settled yet."""
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
        """Queue an answer: see `OperatorClient.answer`. heard: whether the rover is; else report WAITING."""
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
        """Request a policy, in place of an earlier request. heard: as for `answer`."""
        self._wishes[system] = wish = PolicyOnItsWay(system, policy, now)
        if not heard:
            self._tell_policy(wish)
        return wish

    def fetch(self, system: int, path: str, now: float) -> Fetch:
        """Fetch a file, in place of an earlier fetch from this rover."""
        self._fetches[system] = fetch = Fetch(system, path, now)
        return fetch

    def request_parameters(self, system: int) -> None:
        """Request the parameter list."""
        self._lists_wanted.add(system)

    def sent(self, system: int, transaction: int) -> Pending | None:
        """Return the answer with this transaction, if it was sent from here."""
        asked = (system, transaction)
        pending = next((one for one in self._pending if (one.system, one.transaction) == asked), None)
        return None if pending is None or pending.first_sent is None else pending

    def hear_file(self, system: int, payload: bytes, now: float) -> None:
        """Pass a file transfer payload to the rover's fetch. Raises PayloadError."""
        if system in self._fetches:
            self._fetches[system].hear(FtpPayload.unpack(payload), now)

    def hear_policy(self, system: int, *, granted: bool) -> None:
        """Take in the rover's acknowledgement of a policy request."""
        wish = self._wishes.get(system)
        if wish is not None and wish.acknowledge(granted=granted):
            self._tell_policy(wish)

    def close(self, system: int, closed: Collection[int], now: float) -> None:
        """Stop sending the answers to these closed calls."""
        for pending in self.unsettled:
            if pending.system == system and pending.target in closed:
                pending.close(now)

    def settle(self, now: float) -> None:
        """Settle what is past its lifetime."""
        for pending in self._pending:
            if pending.settle(now):
                self._tell_answer(pending)
        for wish in self._wishes.values():
            if wish.settle(now):
                self._tell_policy(wish)
        for fetch in self._fetches.values():
            fetch.settle(now)

    def next(self, system: int, now: float) -> Any | None:
        """Return at most one message to this rover, which must be heard; policy requests go first."""
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
