"""One-off texts."""

from __future__ import annotations

from companion.link import encode
from companion.link.bucket import TokenBucket
from companion.link.heard import Sender
from companion.link.outbox import Outbox
from companion.wire import notices

SAME_TEXT_GAP = 5.0
MAX_TEXTS = 8
REFUSALS_AT_ONCE = 4
REFUSAL_GAP = 2.0
ALERT, WARNING, INFO = 1, 4, 6


class Speaker:
    """Says each text at most once in 5 s; at most eight wait.

    unsaid: texts that found eight waiting, and refusals that came too thick.
    """

    def __init__(self, outbox: Outbox) -> None:
        self._outbox = outbox
        self._said: dict[str, float] = {}
        self._refusals = TokenBucket(1 / REFUSAL_GAP, REFUSALS_AT_ONCE, 0.0)
        self._strangers = TokenBucket(1 / SAME_TEXT_GAP, 1, 0.0)
        self.unsaid = 0

    def say(self, text: str, severity: int, now: float) -> None:
        """Queue a STATUSTEXT of MAV_SEVERITY `severity`; an ALERT goes as early as a call."""
        self._forget(now)
        if text in self._said:
            return
        if severity > ALERT and self._outbox.waiting("text") >= MAX_TEXTS:
            self.unsaid += 1
            return
        self._said[text] = now
        self._outbox.push("call text" if severity <= ALERT else "text", encode.text(text, severity), now)

    def answer(self, text: str, now: float, *, taken: bool) -> None:
        """What became of somebody's answer."""
        if taken:
            self.say(text, INFO, now)
        else:
            self.refuse(text, now)

    def refuse(self, text: str, now: float) -> None:
        """Say why somebody's wish is not granted: four at once, then one in 2 s, however many come."""
        self._forget(now)
        if text in self._said:
            return
        if self._refusals.take(1, now):
            self.say(text, WARNING, now)
        else:
            self.unsaid += 1

    def refuse_sender(self, sender: Sender, now: float) -> None:
        """Say that he may not change anything; in 5 s one of however many."""
        if self._strangers.take(1, now):
            self.say(notices.sender_refused(sender[0]), WARNING, now)

    def _forget(self, now: float) -> None:
        self._said = {old: at for old, at in self._said.items() if now - at < SAME_TEXT_GAP}
