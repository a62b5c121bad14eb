"""One-off texts."""

from __future__ import annotations

from companion.link import encode
from companion.link.outbox import Outbox

SAME_TEXT_GAP = 5.0
MAX_TEXTS = 8
ALERT, WARNING = 1, 4


class Speaker:
    """Says each text at most once in 5 s; at most eight wait."""

    def __init__(self, outbox: Outbox) -> None:
        self._outbox = outbox
        self._said: dict[str, float] = {}

    def say(self, text: str, severity: int, now: float) -> None:
        """Queue a STATUSTEXT of MAV_SEVERITY `severity`; an ALERT goes as early as a call."""
        self._said = {old: at for old, at in self._said.items() if now - at < SAME_TEXT_GAP}
        if text in self._said or (severity > ALERT and self._outbox.waiting("text") >= MAX_TEXTS):
            return
        self._said[text] = now
        self._outbox.push("call text" if severity <= ALERT else "text", encode.text(text, severity), now)
