"""Composes the alert for the open call or hold: a report for programs and a text for people."""

from __future__ import annotations

from dataclasses import dataclass

from anytraverse.history import Place
from anytraverse.preferences import Preferences
from companion.calls.decisions import Call
from companion.calls.machine import OperatorCalls
from companion.calls.summary import call_data, current_data, current_text
from companion.wire.call_report import CallReport
from companion.wire.ids import ALERT, ERROR, Kind, Outcome, words_hash

_REFRESH = 15.0
"""Seconds after which an unchanged alert is composed again: its age and figures have changed."""


@dataclass(frozen=True)
class AlertMessage:
    """The report of the open call or hold, and its text.

    severity: the text's MAV_SEVERITY. quiet: "stay" was answered, so that the text does not escalate.
    """

    data: CallReport
    text: str
    severity: int
    quiet: bool


class ActiveAlert:
    """Composes the alert again when the call, its stage, its reasons or the words change, and every 15 s."""

    def __init__(self, calls: OperatorCalls) -> None:
        self._calls = calls
        self._key: object = None
        self._alert: AlertMessage | None = None
        self._composed_at = 0.0
        self._last_call = calls.call.id if calls.call is not None else 0
        """Id of the last call that was opened. A hold with another id belongs to no call."""

    def call_opened(self, call: Call) -> None:
        """Remember the id of a call, by which `kind_of` knows the call's hold after the call is closed."""
        self._last_call = call.id

    def kind_of(self, number: int) -> Kind:
        """Whether texts name the hold of this id as a call, whose hold it is, or as a hold."""
        return Kind.CALL if number == self._last_call else Kind.HOLD

    def compose(
        self, words: Preferences, place: Place, picture: str, silent: list[str], now: float
    ) -> AlertMessage | None:
        """Return the alert to announce, None when nothing is open.

        picture: path of the call's picture, "" without one. silent: tasks without a sign of life.
        """
        calls = self._calls
        if calls.current_id == 0:
            self._alert = None
            return None
        failed = calls.hold is not None and calls.hold.failed
        # All that the alert says, except the figures, which change with every frame.
        key = (
            calls.current_id,
            calls.stage(),
            calls.reasons(now),
            calls.hold is not None and calls.hold.state,
            calls.call is not None and (calls.call.state, calls.call.seen is None),
            calls.go_at is not None,
            calls.hold is not None and calls.hold.seen is None,
            calls.holding.mission_ended,
            words_hash(words),
            picture,
            tuple(silent),
            failed,
        )
        if self._alert is None or key != self._key or now - self._composed_at >= _REFRESH:
            data = current_data(calls, words, place, picture, now)
            if data is None:
                return None
            text = current_text(calls, silent, now)
            quiet = calls.call is not None and calls.call.quiet
            self._alert = AlertMessage(data, text, ALERT if failed else ERROR, quiet)
            self._key, self._composed_at = key, now
        return self._alert

    def closed_call(self, call: Call, words: Preferences, place: Place, now: float) -> CallReport:
        """Return the final report of a closed call, with the figures of its frame."""
        self._alert = None
        return call_data(
            call.seen,
            self._calls.numbers.judging.region,
            words,
            call.place if call.place.latitude is not None else place,
            number=call.id,
            kind=Kind.CALL,
            outcome=call.outcome,
            reasons=call.reasons,
            frame_id=call.frame_id,
            age=now - call.opened_at,
        )

    def closed_hold(
        self, number: int, outcome: Outcome, words: Preferences, place: Place, now: float
    ) -> CallReport:
        """Return the final report of a hold that has ended, with the figures of the newest frame."""
        self._alert = None
        seen = self._calls.reason_filter.newest
        return call_data(
            seen,
            self._calls.numbers.judging.region,
            words,
            place,
            number=number,
            kind=Kind.HOLD,
            outcome=outcome,
            reasons=self._calls.reasons(now),
            frame_id=seen.frame.id if seen is not None else 0,
        )
