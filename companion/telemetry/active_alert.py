"""What stands announced: the open call or hold, composed anew when there is news, not with every frame."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from anytraverse.assessment import Assessment, Reason
from anytraverse.history import Place
from anytraverse.preferences import Preferences
from companion.calls.decisions import Call
from companion.calls.machine import OperatorCalls
from companion.telemetry.summary import call_data, current_data, current_text
from companion.wire import texts
from companion.wire.ids import Kind, Outcome, Stage, words_hash
from companion.wire.payloads import CallData

ALERT, ERROR = 1, 3
_REFRESH = 15.0


@dataclass(frozen=True)
class Said:
    """The open call or hold as data and as text, with the text's MAV_SEVERITY."""

    data: CallData
    text: str
    severity: int
    quiet: bool


class ActiveAlert:
    """Composes anew when the call, its stage, its reasons or the words change, and every 15 s."""

    def __init__(self, calls: OperatorCalls) -> None:
        self._calls = calls
        self._key: object = None
        self._said: Said | None = None
        self._composed_at = 0.0
        self.last_call = calls.call.id if calls.call is not None else 0
        """Id of the last call opened: what tells a call's hold from a hold without one."""

    def now(
        self, words: Preferences, place: Place, picture: str, silent: list[str], now: float
    ) -> Said | None:
        """What to announce; None when nothing is open."""
        calls = self._calls
        if calls.current_id == 0:
            self._said = None
            return None
        failed = calls.hold is not None and calls.hold.failed
        key = (
            calls.current_id,
            calls.stage(),
            calls.reasons(now),
            calls.hold is not None and calls.hold.stage,
            calls.call is not None and (calls.call.tried, calls.call.answered, calls.call.seen is None),
            calls.go_at is not None,
            calls.hold is not None and calls.hold.seen is None,
            words_hash(words),
            picture,
            tuple(silent),
            failed,
        )
        if self._said is None or key != self._key or now - self._composed_at >= _REFRESH:
            data = current_data(calls, words, place, picture, now)
            if data is None:
                return None
            text = current_text(calls, silent, now)
            if failed:
                text = texts.hold_failed(calls.kind, calls.current_id)
            quiet = calls.call is not None and calls.call.quiet
            self._said = Said(data, text, ALERT if failed else ERROR, quiet)
            self._key, self._composed_at = key, now
        return self._said

    def closed_call(self, call: Call, words: Preferences, place: Place, now: float) -> CallData:
        """The last word on a call, with the figures of its frame."""
        return self._closed(
            Kind.CALL,
            call.id,
            call.outcome,
            call.reasons,
            call.seen,
            call.frame_id,
            words,
            call.place if call.place.latitude is not None else place,
            now - call.opened_at,
        )

    def closed_hold(
        self, number: int, outcome: Outcome, words: Preferences, place: Place, now: float
    ) -> CallData:
        """The last word on a hold, with the figures of the newest frame."""
        seen = self._calls.reason_filter.newest
        frame_id = seen.frame.id if seen is not None else 0
        reasons = self._calls.reasons(now)
        return self._closed(Kind.HOLD, number, outcome, reasons, seen, frame_id, words, place, 0.0)

    def _closed(
        self,
        kind: Kind,
        number: int,
        outcome: Outcome,
        reasons: Iterable[Reason],
        seen: Assessment | None,
        frame_id: int,
        words: Preferences,
        place: Place,
        age: float,
    ) -> CallData:
        self._said = None
        return call_data(
            seen,
            self._calls.numbers.judging.region,
            words,
            place,
            number=number,
            kind=kind,
            stage=Stage.CLOSED,
            outcome=outcome,
            reasons=reasons,
            holding=False,
            frame_id=frame_id,
            age=age,
            picture="",
        )
