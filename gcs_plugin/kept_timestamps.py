"""Where the operator's signing timestamps lie from one run to the next."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from companion.wire.signing import SigningKey
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
