"""Alerts the owner's URL once for each call or hold that opens."""

from __future__ import annotations

from collections import deque

from companion.calls.machine import OperatorCalls
from companion.daemon.call_texts import CallTexts
from companion.daemon.turn import Observer, Turn
from companion.system.alert import Alert, AlertSender
from companion.wire.texts import name

_KNOWN = 16
"""Newest ids that were alerted: a hold may be shown again after a call that came between."""
_TOLD_WITHIN = 2.0
"""Seconds for which the text of what has opened is waited for."""


class CallAlerts(Observer):
    """Watches for an id that was not alerted before, and alerts with its text and the vehicle's place."""

    def __init__(self, calls: OperatorCalls, texts: CallTexts, sender: AlertSender, link: str) -> None:
        """link: what a click on an alert opens, "" for nothing.

        What is open from before a restart was alerted then.
        """
        self._calls, self._texts, self._sender, self._link = calls, texts, sender, link
        self._known = deque([calls.current_id], maxlen=_KNOWN)
        self._opened: float | None = None

    def see(self, turn: Turn) -> None:
        """Alert for an id that is new, once its text is there."""
        if not turn.current_id or turn.current_id in self._known:
            self._opened = None
            return
        self._opened = turn.now if self._opened is None else self._opened
        named = name(self._calls.kind, turn.current_id)
        told = self._texts.told
        is_told = told.startswith(f"{named} ")
        if not is_told and turn.now - self._opened < _TOLD_WITHIN:
            return
        self._known.append(turn.current_id)
        self._opened = None
        lines = [told if is_told else named]
        if turn.place.latitude is not None and turn.place.longitude is not None:
            lines.append(f"at {turn.place.latitude:.5f} {turn.place.longitude:.5f}")
        lines += [self._link] if self._link else []
        self._sender.send(Alert(f"A rover calls: {named}", "\n".join(lines), self._link))
