"""Knows which answers wait for a decision and what was replied to the others, over a restart, too."""

from __future__ import annotations

import contextlib
import math
from collections import deque
from collections.abc import Hashable, ItemsView
from dataclasses import replace
from typing import Any, Generic, TypeVar

from companion.wire.answers import COMMANDS, PAYLOADS, Acknowledgement, Answer, Via
from companion.wire.ids import CHANGING_RESULTS, PAGE_SENDER, Motion, Result

_Key = tuple[Any, ...]
_T = TypeVar("_T")
_ROW = (0, 0xFF), (0, 0xFF), (1, 0xFFFFFFFF), (0, 0xFFFF), (0, max(Result))
"""Least and most of the numbers of a saved reply: system, component, transaction, target, result."""


class SenderCache(Generic[_T]):
    """Stores the newest entries of each sender, up to a number of each and in all.

    A key is a tuple that begins with the sender, or with what else the first bound counts by.
    """

    def __init__(self, of_a_sender: int, in_all: int) -> None:
        self._of_a_sender, self._in_all = of_a_sender, in_all
        self._entries: dict[_Key, _T] = {}
        self._counts: dict[Hashable, int] = {}

    def __len__(self) -> int:
        return len(self._entries)

    def items(self) -> ItemsView[_Key, _T]:
        """All keys and values, the oldest first."""
        return self._entries.items()

    def get(self, key: _Key) -> _T | None:
        """The value of `key`; None when there is none."""
        return self._entries.get(key)

    def put(self, key: _Key, value: _T) -> None:
        """Store `value` as the newest entry; above a limit, drop the oldest of its sender, or of all."""
        self.pop(key)
        self._entries[key] = value
        own = self._counts[key[0]] = self._counts.get(key[0], 0) + 1
        if own > self._of_a_sender:
            self.pop(next(one for one in self._entries if one[0] == key[0]))
        elif len(self._entries) > self._in_all:
            self.pop(next(iter(self._entries)))

    def pop(self, key: _Key) -> None:
        """Remove `key`, if it is stored."""
        if self._entries.pop(key, None) is not None:
            self._counts[key[0]] -= 1
            if not self._counts[key[0]]:
                del self._counts[key[0]]


OF_A_SENDER, IN_ALL = 64, 2048
"""Answers that are known of one sender by the same message, and in all."""
MAX_TEXTS = 16
"""Texts that wait for a decision."""
UNDECIDED_FOR = 30.0
"""s within which an answer is decided, unless set otherwise."""
REPEAT_WITHIN = 5.0
"""s in which the same command or AT_ANSWER counts as a repetition."""
_SAVED = 16


Known = tuple[float, Acknowledgement | None]
"""When an answer was received, or decided, s; and the reply that it got, None while it is undecided."""


class AnswerStore:
    """Recognizes repeated answers, so that each is applied once and gets the same reply again.

    - A TUNNEL, or an answer on the page, is repeated when its transaction is known.
    - A COMMAND is repeated when it comes within 5 s and its confirmation count is above 0.
    - AT_ANSWER has no count. The same "go" or "look again" within 5 s is repeated, with the call's id or with
      0. So is "other place", until another place matches. "Stay" is always new, as it may follow a go. A
      stale answer to id 0 is repeated for 5 s, too: ground stations set a refused parameter again by
      themselves, and would otherwise answer a new call that the operator has not read.
    - A TEXT is repeated only while it is undecided.

    An answer that is sent again while it is undecided is a repetition in any case, except for a "stay" by
    AT_ANSWER.
    """

    def __init__(self, saved: Any = None) -> None:
        """saved: what `saved` returned before a restart. Anything else in it is ignored."""
        self._entries: SenderCache[Known] = SenderCache(OF_A_SENDER, IN_ALL)
        self._undecided_for = UNDECIDED_FOR
        self._before: dict[tuple[Any, ...], Acknowledgement] = {}
        self._rows: deque[list[Any]] = deque(maxlen=_SAVED)
        for row in saved if isinstance(saved, list) else []:
            with contextlib.suppress(AttributeError, TypeError, ValueError):
                self._restore(*row)

    def __len__(self) -> int:
        """How many answers are known."""
        return len(self._entries)

    def set_undecided_for(self, seconds: float) -> None:
        """Set the s within which an answer is decided; a repetition is not new before."""
        self._undecided_for = seconds

    def find(self, answer: Answer, now: float) -> Known | None:
        """Find what `answer` is a repetition of; None for a new answer."""
        known = self._entries.get(answer.key)
        if known is None or (answer.via is Via.AT_ANSWER and answer.motion is Motion.STAY):
            return None
        at, reply = known
        age = now - at
        if reply is None:
            return known if age < self._undecided_for else None
        if answer.via in COMMANDS and not answer.confirmation:
            return None
        if age > (math.inf if answer.via in PAYLOADS else REPEAT_WITHIN):
            return None
        self._entries.put(answer.key, known)
        return known

    def begin(self, answer: Answer, now: float) -> bool:
        """Note that a new answer is being decided. False, and not noted, if too many texts wait already."""
        if answer.via is Via.TEXT and self._undecided_texts(now) >= MAX_TEXTS:
            return False
        self._entries.put(answer.key, (now, None))
        return True

    def finish(self, answer: Answer, reply: Acknowledgement, now: float) -> None:
        """Note the reply to an answer, unless it is BUSY: then the answer may be sent again.

        An AT_ANSWER that was accepted is also known by the id that it was applied to: id 0 and then the
        call's own id are one answer. One that was not may be sent again at once.
        """
        targets, known = {answer.target}, reply.result is not Result.BUSY and answer.via is not Via.TEXT
        if answer.via is Via.AT_ANSWER:
            targets.add(reply.target)
            stale = reply.result is Result.STALE and answer.target == 0
            known = stale or reply.result in CHANGING_RESULTS
        for target in targets:
            key = replace(answer, target=target).key
            self._entries.pop(key)
            if known:
                self._entries.put(key, (now, reply))

    def forget_refused_matches(self) -> None:
        """Forget the decided AT_ANSWERs that refused a match: now they may mean the next one."""
        of_matches = [
            key
            for key, (_, reply) in self._entries.items()
            if key[0][1] is Via.AT_ANSWER and reply is not None and key[3]
        ]
        for key in of_matches:
            self._entries.pop(key)

    def before_restart(self, answer: Answer) -> Acknowledgement | None:
        """Return the reply from before the restart, None without one. Its figures are those of no frame."""
        return self._before.get(answer.key)

    def save(self, answer: Answer, reply: Acknowledgement) -> None:
        """Have a reply saved over a restart, with the newest 16.

        A reply to what changed nothing is not saved, nor one to a command or a parameter: without a
        transaction number each is a new answer after a restart.
        """
        if answer.via in PAYLOADS and reply.result in CHANGING_RESULTS:
            self._append(answer, reply)

    def saved(self) -> list[list[Any]]:
        """Return the saved replies as JSON values for the journal."""
        return list(self._rows)

    def _restore(self, *row: Any) -> None:
        *numbers, text = row
        for number, (least, most) in zip(numbers, _ROW, strict=True):
            if type(number) is not int or not least <= number <= most:
                return
        text.encode()  # what is no text, or has half a character, cannot be sent
        system, component, transaction, target, result = numbers
        via = Via.PAGE if (system, component) == PAGE_SENDER else Via.TUNNEL
        answer = Answer(0, Motion.NONE, (), transaction, (system, component), via)
        reply = Acknowledgement.without_figures(transaction, target, Result(result), text)
        self._before[answer.key] = reply
        self._append(answer, reply)

    def _append(self, answer: Answer, reply: Acknowledgement) -> None:
        self._rows.append([*answer.sender, answer.transaction, reply.target, int(reply.result), reply.text])

    def _undecided_texts(self, now: float) -> int:
        texts = [known for key, known in self._entries.items() if key[0][1] is Via.TEXT]
        return sum(reply is None and now - at < self._undecided_for for at, reply in texts)
