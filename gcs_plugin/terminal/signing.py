"""Signing on the operator's side: what leaves is signed, what arrives unsigned or old is not shown."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from companion.wire import signing as wire
from companion.wire.signing import SigningKey, Stream, Timestamps
from companion.wire.signing_store import TimestampFile


def state_folder() -> Path:
    """The user's, as the XDG Base Directory Specification has it."""
    told = Path(os.environ.get("XDG_STATE_HOME", ""))
    return (told if told.is_absolute() else Path.home() / ".local" / "state") / "anytraverse"


class KeptTimestamps:
    """Those of one key and of our own ids, for this program alone."""

    def __init__(self, key: SigningKey, system: int, component: int, *, clock: int) -> None:
        """clock: the time as a timestamp. Raises OSError, BlockingIOError where another program has them."""
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
        """All is on disk; another program may have them."""
        self.file.close()
        os.close(self._lock)


MAX_PROBLEMS = 8
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


class Signing:
    """One key for a link. kept: timestamps of earlier runs; None: nothing outlives it."""

    def __init__(
        self,
        key: SigningKey,
        kept: KeptTimestamps | None = None,
        link: int = 0,
        wall: Callable[[], float] = time.time,
    ) -> None:
        """link: our link id. wall: s since 1970."""
        self._key = key
        self._kept = kept
        self._link = link
        self._wall = wall
        self._timestamps = Timestamps() if kept is None else kept.file.timestamps
        self._own: Stream | None = None
        self._told: set[tuple[str, str]] = set()
        self._problems: list[str] = []

    def hears(self, message: Any) -> bool:
        """Whether a decoded message is signed with our key and new."""
        frame = bytes(message.get_msgbuf())
        reason = wire.refusal(frame, self._key, self._timestamps, self._clock())
        if not reason:
            self._keep(wire.stream_of(frame))
        elif not self._may_come(reason, frame, message):
            self._tell(reason, f"{message.get_srcSystem()}/{message.get_srcComponent()}")
        return not reason

    def sign(self, frame: bytes, message: Any) -> bytes:
        """`message`, packed as `frame`, with our signature."""
        self._own = Stream(frame[5], frame[6], self._link)
        timestamp = self._timestamps.next(self._own, self._clock())
        self._keep(self._own)
        return self._key.sign(frame, message.crc_extra, self._link, timestamp)

    def tick(self, now: float) -> None:
        """Put on disk what is due. now: s, monotonic."""
        if self._kept is not None:
            self._kept.file.tick(now)
            if self._kept.file.trouble:
                self.say(NOT_KEPT.format(self._kept.file.trouble))

    def close(self) -> None:
        """Put everything on disk."""
        if self._kept is not None:
            self._kept.close()

    def say(self, problem: str) -> None:
        """Something that a person should know, once."""
        if ("", problem) not in self._told:
            self._told.add(("", problem))
            self._problems.append(problem)

    def problems(self) -> list[str]:
        """What was ignored and why, once of each sender, and what else is wrong."""
        problems, self._problems = self._problems, []
        return problems

    def _keep(self, stream: Stream) -> None:
        if self._kept is not None:
            self._kept.file.keep(stream)

    def _may_come(self, reason: str, frame: bytes, message: Any) -> bool:
        """A radio has no key, and routers send back what is ours."""
        echo = reason == wire.REPLAY and wire.stream_of(frame) == self._own
        return echo or message.get_type() in _RADIO

    def _tell(self, reason: str, who: str) -> None:
        if (reason, who) not in self._told and len(self._told) < MAX_PROBLEMS:
            self._told.add((reason, who))
            self._problems.append(f"what {who} says {_WHY[reason]}")

    def _clock(self) -> int:
        return wire.ticks(self._wall())


def open_signing(key: SigningKey, system: int, component: int) -> Signing:
    """With the timestamps of earlier runs under these ids, if they can be had."""
    try:
        kept = KeptTimestamps(key, system, component, clock=wire.ticks(time.time()))
    except BlockingIOError:
        signing = Signing(key)
        signing.say(NOT_ALONE.format(f"{system}/{component}"))
    except (OSError, RuntimeError) as error:
        signing = Signing(key)
        signing.say(NOT_KEPT.format(getattr(error, "strerror", None) or error))
    else:
        signing = Signing(key, kept)
        if kept.file.notice:
            signing.say(kept.file.notice)
    return signing
