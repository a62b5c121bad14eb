"""Raises a test call, which is sent and answered like a real one, to try the way to the operator and back.

It holds no vehicle and teaches no word. `companion check --dry-run` requests one by a file in the state
folder, where only the companion's own user and root can write, and reads the outcome in the status file.
"""

from __future__ import annotations

import contextlib
import logging
import os
import time
from collections import deque
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from companion.calls.machine import OperatorCalls
from companion.calls.summary import call_data
from companion.daemon.turn import Reminder
from companion.link.link import Link
from companion.vehicle.state import VehiclePosition
from companion.vision.client import VisionClient
from companion.wire import notices, texts
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.call_report import CallReport
from companion.wire.ids import Kind, Motion, Outcome, Result, Stage, words_hash

log = logging.getLogger(__name__)

REQUEST = "test-call"
"""Name of the file that requests a test call. Its modification time, in ns, identifies the request."""
ANSWERED_WITHIN = 60.0
_OLDEST_REQUEST = 10.0
"""Seconds after which a request is ignored: it was left by a check that is over."""


@dataclass(frozen=True)
class _Open:
    data: CallReport
    since: float


class TrialCall:
    """Runs at most one test call, and none while a call or hold is open: a real one ends it at once."""

    def __init__(
        self, folder: Path, calls: OperatorCalls, link: Link, vision: VisionClient, position: VehiclePosition
    ) -> None:
        self._request = folder / REQUEST
        self._calls = calls
        self._link = link
        self._vision = vision
        self._position = position
        self._open: _Open | None = None
        self._asked: deque[int] = deque(maxlen=1)
        self.status: dict[str, Any] = {}
        """The last test call, for the status file: asked, id, state and text; who answered, after how many
        seconds; a request that was refused meanwhile."""

    @property
    def id(self) -> int:
        """Return the open test call's id, 0 without one."""
        return self._open.data.id if self._open is not None else 0

    def look(self) -> None:
        """Look for a request, which the next `tick` takes. Not for the main loop: the disk may hang."""
        asked = self._take_request()
        if asked is not None:
            self._asked.append(asked)

    def tick(self, now: float) -> None:
        """Begin a requested test call, and end one that is over."""
        if self._asked:
            self._begin(self._asked.popleft(), now)
        if self._open is None:
            return
        if self._calls.current_id:
            self._end("cut short", notices.trial_cut_short(self.id), Outcome.NONE, now)
        elif now - self._open.since >= ANSWERED_WITHIN:
            self._end("unanswered", notices.trial_unanswered(self.id), Outcome.PASSED, now)

    @property
    def reminder(self) -> Reminder | None:
        """Return what is repeated of the open test call, as of a call; None without one."""
        return Reminder(texts.trial_call(self.id), data=self._open.data) if self._open is not None else None

    def receive(self, answer: Answer, now: float) -> bool:
        """Take an answer, if it is for the test call: acknowledge it and end the test. Whether it was.

        The answer's words and motion change nothing.
        """
        if self._open is None or answer.target not in (0, self.id):
            return False
        if answer.target == 0 and answer.motion is Motion.NONE:
            return False
        seconds, number = now - self._open.since, self.id
        # An answer to "the current call" that comes this early was sent before the operator saw this one.
        if answer.target == 0 and seconds < self._calls.numbers.announce_guard:
            self._acknowledge(answer, number, Result.STALE, texts.just_announced(Kind.CALL, number), now)
            return True
        text = notices.trial_answered(number, *answer.sender, seconds)
        self.status |= {"by": list(answer.sender), "after": round(seconds, 1)}
        self._end("answered", text, Outcome.ANSWERED, now)
        result = Result.REFUSED if answer.operations else Result.APPLIED
        reply = f"{text}; a test teaches no words" if answer.operations else text
        self._acknowledge(answer, number, result, reply, now)
        return True

    def _take_request(self) -> int | None:
        """Remove the request file, and return its modification time in ns. None when there is none."""
        try:
            seen = os.lstat(self._request)  # not stat: a link to a file of root's is no request of root's
        except OSError:
            return None
        with contextlib.suppress(OSError):
            os.unlink(self._request)
        if seen.st_uid not in (0, os.geteuid()) or abs(time.time() - seen.st_mtime) > _OLDEST_REQUEST:
            log.warning("a request for a test call is ignored: it is too old, or not by root or this user")
            return None
        return seen.st_mtime_ns

    def _begin(self, asked: int, now: float) -> None:
        if self._open is not None or self._calls.current_id:
            kind = self._calls.kind if self._calls.current_id else Kind.CALL
            text = f"{texts.name(kind, self._calls.current_id or self.id)} is open: answer it first"
            if self._open is not None:
                self.status["refused"] = {"asked": asked, "text": text}
            else:
                self.status = {"asked": asked, "id": 0, "state": "refused", "text": text}
            return
        number, newest = self._calls.take_id(), self._calls.reason_filter.newest
        data = call_data(
            None,
            self._calls.numbers.judging.region,
            self._vision.words,
            self._position.place(),
            number=number,
            kind=Kind.CALL,
            stage=Stage.OPEN,
            outcome=Outcome.NONE,
            reasons=(),
            holding=False,
            frame_id=newest.frame.id if newest is not None else 0,
            age=0.0,
            picture="",
        )
        self._open = _Open(replace(data, test=True), now)
        self.status = {"asked": asked, "id": number, "state": "open", "text": texts.trial_call(number)}
        log.warning("%s", self.status["text"])

    def _end(self, state: str, text: str, outcome: Outcome, now: float) -> None:
        assert self._open is not None
        data = replace(self._open.data, stage=Stage.CLOSED, outcome=outcome)
        self._open = None
        self.status |= {"state": state, "text": text}
        log.warning("%s", text)
        self._link.alerts.announce(data, text, now)

    def _acknowledge(self, answer: Answer, number: int, result: Result, text: str, now: float) -> None:
        closed = self._open is None
        acknowledgement = replace(
            Acknowledgement.without_figures(answer.transaction, number, result, text),
            stage=Stage.CLOSED if closed else Stage.OPEN,
            outcome=Outcome.ANSWERED if closed else Outcome.NONE,
            words=words_hash(self._vision.words),
        )
        self._link.answers.acknowledge(answer, acknowledgement, now)
