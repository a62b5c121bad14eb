"""Schedules what is sent to rovers: answers, policy requests, file requests and list requests."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from companion.wire.answers import MAX_PAYLOAD, Answer
from companion.wire.delivery import Pending
from companion.wire.ftp import FtpPayload
from companion.wire.ids import COMPONENT_ID, TUNNEL_ANSWER, Policy
from companion.wire.packing import PayloadError
from gcs_plugin.client import events as ev
from gcs_plugin.client.fetch import Fetch
from gcs_plugin.client.listing import Listing
from gcs_plugin.client.policy_request import PendingPolicy

PACE_S = 0.05
"""Seconds between two messages to one rover, since radios and PX4 lose messages of a burst."""
MAX_PENDING = 64


class RequestOutbox:
    """Holds, for each rover, answers in order, the newest policy request, the newest file, a list request.

    transactions: returns an id for each answer. report_event: receives events of answers and policy requests.
    """

    def __init__(self, transactions: Callable[[], int], report_event: Callable[[ev.Event], None]) -> None:
        self._transactions = transactions
        self._report = report_event
        self._pending: deque[Pending] = deque(maxlen=MAX_PENDING)
        self._policy_requests: dict[int, PendingPolicy] = {}
        self._fetches: dict[int, Fetch | Listing] = {}
        self._ends: dict[int, Any] = {}
        """What ends a fetch that was replaced."""
        self._lists_wanted: set[int] = set()
        self._may_send_at: dict[int, float] = {}

    @property
    def unsettled(self) -> list[Pending]:
        """The answers that are not settled yet, oldest first."""
        return [pending for pending in self._pending if not pending.settled]

    @property
    def busy(self) -> bool:
        """Whether an answer, a policy request or a file that somebody waits for is not settled yet."""
        if any(not (fetch.settled or fetch.background) for fetch in self._fetches.values()):
            return True
        return bool(self.unsettled) or any(
            not policy_request.settled for policy_request in self._policy_requests.values()
        )

    def answer(self, system: int, answer: Answer, now: float, *, heard: bool) -> Pending:
        """Queue an answer: see `OperatorClient.answer`. heard: whether the rover is; else report WAITING."""
        if len(self.unsettled) >= MAX_PENDING:
            raise PayloadError(f"{MAX_PENDING} answers wait already: is the link up?")
        pending = Pending(system, replace(answer, transaction=self._transactions()), now)
        pending.overrule(self.unsettled, now)
        while len(self._pending) >= MAX_PENDING:
            self._pending.remove(next(old for old in self._pending if old.settled))
        self._pending.append(pending)
        if not heard:
            self._report_answer(pending)
        return pending

    def set_policy(self, system: int, policy: Policy, now: float, *, heard: bool) -> PendingPolicy:
        """Request a policy, in place of an earlier request. heard: as for `answer`."""
        self._policy_requests[system] = policy_request = PendingPolicy(system, policy, now)
        if not heard:
            self._report_policy(policy_request)
        return policy_request

    def fetch(self, system: int, path: str, now: float, *, background: bool = False) -> Fetch:
        """Fetch a file, in place of an earlier fetch from this rover. background: nobody waits for it."""
        fetch = Fetch(system, path, now, background=background)
        self._replace(system, fetch)
        return fetch

    def resume(self, fetch: Fetch, now: float) -> None:
        """Go on with a fetch that was replaced, stopped or has failed, in place of another from its rover."""
        fetch.resume(now)
        self._replace(fetch.system, fetch)

    def stop(self, fetch: Fetch) -> None:
        """End a fetch, if it is the newest of its rover."""
        if self._fetches.get(fetch.system) is fetch:
            del self._fetches[fetch.system]
            if (end := fetch.end()) is not None:
                self._ends[fetch.system] = end

    def list_folder(self, system: int, path: str, now: float) -> Listing:
        """List a folder, in place of an earlier fetch from this rover."""
        listing = Listing(system, path, now)
        self._replace(system, listing)
        return listing

    def request_parameters(self, system: int) -> None:
        """Request the parameter list."""
        self._lists_wanted.add(system)

    def sent(self, system: int, transaction: int) -> Pending | None:
        """Return the answer with this transaction, if it was sent from here."""
        asked = (system, transaction)
        pending = next((one for one in self._pending if (one.system, one.answer.transaction) == asked), None)
        return None if pending is None or pending.first_sent is None else pending

    def handle_file(self, system: int, payload: bytes, now: float) -> None:
        """Pass a file transfer payload to the rover's fetch. Raises PayloadError."""
        if system in self._fetches:
            self._fetches[system].receive(FtpPayload.unpack(payload), now)

    def handle_policy_result(self, system: int, *, granted: bool) -> None:
        """Take in the rover's acknowledgement of a policy request."""
        policy_request = self._policy_requests.get(system)
        if policy_request is not None and policy_request.acknowledge(granted=granted):
            self._report_policy(policy_request)

    def close(self, system: int, closed: Collection[int], now: float) -> None:
        """Stop sending the answers to these closed calls."""
        for pending in self.unsettled:
            if pending.system == system and pending.answer.target in closed:
                pending.close(now)

    def settle(self, now: float) -> None:
        """Settle what is past its lifetime."""
        for pending in self._pending:
            if pending.settle(now):
                self._report_answer(pending)
        for policy_request in self._policy_requests.values():
            if policy_request.settle(now):
                self._report_policy(policy_request)
        for fetch in self._fetches.values():
            fetch.settle(now)

    def next(self, system: int, now: float) -> Any | None:
        """Return at most one message to this rover, which must be heard; policy requests go first."""
        if now < self._may_send_at.get(system, 0.0):
            return None
        message = self._next_policy_request(system, now) or self._next_answer(system, now)
        if message is None and system in self._lists_wanted:
            self._lists_wanted.discard(system)
            message = mavlink.MAVLink_param_request_list_message(system, COMPONENT_ID)
        if message is None:
            message = self._ends.pop(system, None)
        if message is None and system in self._fetches:
            message = self._fetches[system].due(now)
        if message is not None:
            self._may_send_at[system] = now + PACE_S
        return message

    def _replace(self, system: int, fetch: Fetch | Listing) -> None:
        """Begin `fetch`. What is left of an earlier one is ended, so that its burst takes no more budget."""
        earlier = self._fetches.get(system)
        if isinstance(earlier, Fetch) and (end := earlier.end()) is not None:
            self._ends[system] = end
        self._fetches[system] = fetch

    def _next_policy_request(self, system: int, now: float) -> Any | None:
        policy_request = self._policy_requests.get(system)
        if policy_request is None:
            return None
        before, message = policy_request.status, policy_request.due(now)
        if policy_request.status is not before:
            self._report_policy(policy_request)
        return message

    def _next_answer(self, system: int, now: float) -> Any | None:
        for pending in sorted(self.unsettled, key=lambda one: one.urgency):
            if pending.system != system:
                continue
            before = pending.status
            payload = pending.due(now)
            if payload is not None:
                if pending.status is not before:
                    self._report_answer(pending)
                padded = payload.ljust(MAX_PAYLOAD, b"\0")  # TUNNEL's payload field has a fixed length
                return mavlink.MAVLink_tunnel_message(
                    system, COMPONENT_ID, TUNNEL_ANSWER, len(payload), padded
                )
            if pending.blocks(now):
                return None
        return None

    def _report_answer(self, pending: Pending) -> None:
        answer = pending.answer
        self._report(
            ev.AnswerStatusChanged(pending.system, answer.target, answer.transaction, pending.status)
        )

    def _report_policy(self, policy_request: PendingPolicy) -> None:
        self._report(
            ev.PolicyStatusChanged(policy_request.system, policy_request.policy, policy_request.status)
        )
