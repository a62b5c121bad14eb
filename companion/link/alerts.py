"""Sends texts once, and repeats the open call or hold until it is answered."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

from companion.link import encode
from companion.link.limits import TokenBucket
from companion.link.outbox import Outbox
from companion.wire import notices
from companion.wire.call_report import CallReport
from companion.wire.ids import ALERT, ERROR, INFO, NOTICE, WARNING, SenderId, Stage
from companion.wire.messages import (
    CLOSED_REPEATS,
    DATA_FIRST_PERIOD,
    DATA_PERIOD,
    DATA_REPEATS,
    DATA_SLOW_PERIOD,
    TEXT_ALERT_AFTER,
    TEXT_PERIOD,
    TEXT_SLOW_PERIOD,
)

SAME_TEXT_GAP = 5.0
"""s in which the same text is not sent again."""
MAX_TEXTS = 8
"""Texts that wait to be sent."""
REFUSALS_AT_ONCE = 4
REFUSAL_GAP = 2.0
"""s between refusals after the first four."""


class TextSender:
    """Queues texts, the same one at most once in 5 s; at most eight wait.

    unsaid: texts that were not sent, because eight waited or the rate of refusals was too high.
    """

    def __init__(self, outbox: Outbox) -> None:
        self._outbox = outbox
        self._sent_at: dict[str, float] = {}
        self._refusals = TokenBucket(1 / REFUSAL_GAP, REFUSALS_AT_ONCE, 0.0)
        self._denials = TokenBucket(1 / SAME_TEXT_GAP, 1, 0.0)
        self.unsaid = 0

    def send(self, text: str, severity: int, now: float) -> None:
        """Queue a STATUSTEXT of MAV_SEVERITY `severity`; an ALERT has the priority of a call."""
        self._forget(now)
        if text in self._sent_at:
            return
        if severity > ALERT and self._outbox.waiting("text") >= MAX_TEXTS:
            self.unsaid += 1
            return
        self._sent_at[text] = now
        self._outbox.push("call text" if severity <= ALERT else "text", encode.text(text, severity), now)

    def send_result(self, text: str, now: float, *, accepted: bool) -> None:
        """Send the result of an answer: as INFO when it was accepted, else as a refusal."""
        if accepted:
            self.send(text, INFO, now)
        else:
            self.refuse(text, now)

    def refuse(self, text: str, now: float) -> None:
        """Send why a request was refused. Rate limit of all refusals: four at once, then one in 2 s."""
        self._forget(now)
        if text in self._sent_at:
            return
        if self._refusals.take(1, now):
            self.send(text, WARNING, now)
        else:
            self.unsaid += 1

    def refuse_sender(self, sender: SenderId, now: float) -> None:
        """Send that `sender` may not change anything; at most one such text in 5 s."""
        if self._denials.take(1, now):
            self.send(notices.sender_refused(sender[0]), WARNING, now)

    def _forget(self, now: float) -> None:
        self._sent_at = {old: at for old, at in self._sent_at.items() if now - at < SAME_TEXT_GAP}


TEXT_GAP = 2.0
"""s between texts of a call whose content changes."""
_NEVER = float("-inf")


@dataclass(frozen=True)
class StatusText:
    """A text with its MAV_SEVERITY."""

    text: str
    severity: int


@dataclass
class _Closing:
    call: CallReport
    left: int = CLOSED_REPEATS
    sent_at: float = _NEVER


class AlertRepeater:
    """Decides when the payload and the text of the one open call or hold are sent again.

    New content is sent at once, but at most one payload a second and one text in 2 s.
    """

    def __init__(self) -> None:
        self._call: CallReport | None = None
        self._announced_at = 0.0
        self._text = ""
        self._quiet = False
        self._severity = ERROR
        self._since = 0.0
        self._repeats = 0
        self._data_at = _NEVER
        self._data_new = False
        self._text_at = _NEVER
        self._text_new = False
        self._closing: deque[_Closing] = deque(maxlen=4)
        self._closed: int | None = None
        self._closing_texts: deque[str] = deque(maxlen=4)

    @property
    def repeated(self) -> str:
        """Return the text that is repeated now, "" for none."""
        return self._text

    @property
    def is_open(self) -> bool:
        """Whether a call or hold is open. The numbers then stop and the summaries slow down."""
        return self._call is not None

    def announce(
        self, call: CallReport | None, text: str, now: float, *, quiet: bool = False, severity: int = ERROR
    ) -> None:
        """Repeat the open call or hold, until None or a closed one takes its place. Cheap to call again.

        A closed one is sent three times. quiet: the text repeats slowly and never becomes an ALERT.
        None with a text repeats the text alone ("Companion OFF: ..."). severity: MAV_SEVERITY.
        """
        if call is not None and call.stage == Stage.CLOSED:
            self._close(call, text)
            return
        self._closed = None
        if _id_and_stage(call) != _id_and_stage(self._call) or (call is None and text != self._text):
            self._since = now
            self._repeats = 0
            self._text_new = True
        self._data_new |= _content(call) != _content(self._call)
        self._text_new |= text != self._text or severity != self._severity
        if call != self._call:
            self._announced_at = now
        self._call, self._text, self._quiet, self._severity = call, text, quiet, severity

    def data(self, now: float) -> CallReport | None:
        """The payload that is due, with its age as of `now`; None when none is due."""
        for closing in self._closing:
            if now - closing.sent_at >= DATA_PERIOD:
                closing.left -= 1
                closing.sent_at = now
                if closing.left == 0:
                    self._closing.remove(closing)
                return closing.call
        if self._call is None:
            return None
        silent = now - self._data_at
        first = self._repeats < DATA_REPEATS
        if silent < (DATA_FIRST_PERIOD if first else DATA_PERIOD if self._data_new else DATA_SLOW_PERIOD):
            return None
        self._data_at, self._data_new = now, False
        self._repeats += 1
        return replace(self._call, age_s=self._call.age_s + int(now - self._announced_at))

    def text(self, now: float) -> StatusText | None:
        """The text that is due, None when none is. Several may be due: call until None."""
        if self._closing_texts:
            return StatusText(self._closing_texts.popleft(), NOTICE)
        if not self._text:
            return None
        fast = not self._quiet and self._text_at - self._since < TEXT_ALERT_AFTER
        silent = now - self._text_at
        if silent < (TEXT_GAP if self._text_new else TEXT_PERIOD if fast else TEXT_SLOW_PERIOD):
            return None
        self._text_at, self._text_new = now, False
        alert = not self._quiet and now - self._since >= TEXT_ALERT_AFTER
        return StatusText(self._text, min(ALERT, self._severity) if alert else self._severity)

    def _close(self, call: CallReport, text: str) -> None:
        if self._closed == call.id:
            return
        self._closed = call.id
        self._closing.append(_Closing(call))
        if text:
            self._closing_texts.append(text)
        self._call, self._text = None, ""


def _id_and_stage(call: CallReport | None) -> tuple[int, Stage] | None:
    return None if call is None else (call.id, call.stage)


def _content(call: CallReport | None) -> CallReport | None:
    return None if call is None else replace(call, age_s=0)
