"""Signs what the operator sends, and drops received messages that are unsigned or replayed."""

from __future__ import annotations

import fcntl
import os
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from companion.wire import signing as wire
from companion.wire.signing import SignedStream, SigningKey, Timestamps
from companion.wire.signing_store import TimestampFile


def state_folder() -> Path:
    """Return the user's folder for state, by the XDG Base Directory Specification."""
    configured = Path(os.environ.get("XDG_STATE_HOME", ""))
    return (configured if configured.is_absolute() else Path.home() / ".local" / "state") / "anytraverse"


class StoredTimestamps:
    """Stores the signing timestamps of one key and our own ids, locked for this program alone."""

    def __init__(self, key: SigningKey, system: int, component: int, *, clock: int) -> None:
        """clock: now, as a signing timestamp. Raises OSError; BlockingIOError if another program has them."""
        self._folder = state_folder() / f"signing-{key.fingerprint}-{system}-{component}"
        self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._lock = os.open(self._folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self.file = TimestampFile(self._folder, clock=clock)
        except BaseException:
            os.close(self._lock)
            raise

    def close(self) -> None:
        """Write all timestamps to disk, and unlock them."""
        self.file.close()
        os.close(self._lock)


MAX_PROBLEMS = 8
RECENT = 512
"""Accepted frames by whose signature a copy that came over another link is known."""
_SIGNATURE_BYTES = 13
_RADIO = frozenset({"RADIO", "RADIO_STATUS"})
_WHY = {
    wire.UNSIGNED: "is not signed, and ignored: load the key into it",
    wire.SIGNATURE: "is signed with another key, and ignored: load this key into it",
    wire.REPLAY: "repeats itself or has an old time, and is ignored: it needs a clock, or GPS",
    wire.AHEAD: "has a clock over a year ahead of ours, and is ignored: set the wrong one",
}
NOT_KEPT = "signing timestamps are not kept ({}): old frames could be played to the next run"
NOT_ALONE = (
    "another program signs as {} with this key: give one of them another --component. "
    "Until then old frames could be played to the next run"
)


class OperatorSigning:
    """Signs and checks with one key on a link. kept: stores timestamps over runs; None: nothing is stored."""

    def __init__(
        self,
        key: SigningKey,
        kept: StoredTimestamps | None = None,
        link: int = 0,
        wall: Callable[[], float] = time.time,
    ) -> None:
        """link: our link id. wall: returns the seconds since 1970."""
        self._key = key
        self._kept = kept
        self._link = link
        self._wall = wall
        self._timestamps = Timestamps() if kept is None else kept.file.timestamps
        self.doubled = 0
        """Frames that came again over another link."""
        self._recent: deque[tuple[bytes, object]] = deque(maxlen=RECENT)
        self._own: SignedStream | None = None
        self._reported: set[tuple[str, str]] = set()
        self._problems: list[str] = []

    def accepts(self, message: Any, link: object = None) -> bool:
        """Return whether a decoded message is signed with our key and is not a replay.

        link: over which it came; a copy that comes over another one is dropped without a report.
        """
        frame = bytes(message.get_msgbuf())
        reason = wire.refusal(frame, self._key, self._timestamps, self._clock())
        if not reason:
            self._recent.append((frame[-_SIGNATURE_BYTES:], link))
        elif reason == wire.REPLAY and self._came_elsewhere(frame[-_SIGNATURE_BYTES:], link):
            self.doubled += 1
        elif not self._is_expected(reason, frame, message):
            self._report_ignored(reason, f"{message.get_srcSystem()}/{message.get_srcComponent()}")
        return not reason

    def sign(self, frame: bytes, message: Any) -> bytes:
        """Sign `message`, packed as `frame`, and return the signed frame."""
        self._own = SignedStream(frame[5], frame[6], self._link)
        timestamp = self._timestamps.next(self._own, self._clock())
        return self._key.sign(frame, message.crc_extra, self._link, timestamp)

    def tick(self, now: float) -> None:
        """Have new timestamps stored. now: seconds, monotonic."""
        if self._kept is not None:
            self._kept.file.tick(now)
            if self._kept.file.trouble:
                self.say(NOT_KEPT.format(self._kept.file.trouble))

    def close(self) -> None:
        """Write all timestamps to disk."""
        if self._kept is not None:
            self._kept.close()

    def say(self, problem: str) -> None:
        """Report a problem for a person; each one is reported once."""
        if ("", problem) not in self._reported:
            self._reported.add(("", problem))
            self._problems.append(problem)

    def problems(self) -> list[str]:
        """Return new problems: whose messages are ignored and why, once for each sender, and others."""
        problems, self._problems = self._problems, []
        return problems

    def _came_elsewhere(self, signature: bytes, link: object) -> bool:
        return any(one == signature and where is not link for one, where in self._recent)

    def _is_expected(self, reason: str, frame: bytes, message: Any) -> bool:
        """Return whether no report is needed: radios have no key, and routers echo our own frames."""
        echo = reason == wire.REPLAY and wire.stream_of(frame) == self._own
        return echo or message.get_type() in _RADIO

    def _report_ignored(self, reason: str, who: str) -> None:
        if (reason, who) not in self._reported and len(self._reported) < MAX_PROBLEMS:
            self._reported.add((reason, who))
            self._problems.append(f"what {who} says {_WHY[reason]}")

    def _clock(self) -> int:
        return wire.ticks(self._wall())


def open_signing(key: SigningKey, system: int, component: int) -> OperatorSigning:
    """Make an OperatorSigning with the timestamps of earlier runs under these ids, if they can be opened.

    If not, it works without them, and reports that as a problem.
    """
    try:
        kept = StoredTimestamps(key, system, component, clock=wire.ticks(time.time()))
    except BlockingIOError:
        signing = OperatorSigning(key)
        signing.say(NOT_ALONE.format(f"{system}/{component}"))
    except (OSError, RuntimeError) as error:
        signing = OperatorSigning(key)
        signing.say(NOT_KEPT.format(getattr(error, "strerror", None) or error))
    else:
        signing = OperatorSigning(key, kept)
        if kept.file.notice:
            signing.say(kept.file.notice)
    return signing
