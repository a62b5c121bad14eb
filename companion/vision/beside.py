"""Encodes frames for the recording in a thread beside judging."""

from __future__ import annotations

import os
import threading
from collections import deque
from queue import Queue

from anytraverse.assessment import Assessment
from companion.vision.messages import Encode, Encoded
from companion.vision.pictures import encoded

_NICENESS = 19
"""Of the thread alone: while the network wants the cores, the encoder gets a twentieth of one."""


class BesideJudging:
    """Encodes one frame at a time. One that is asked for meanwhile is left out: it would delay judging."""

    def __init__(self) -> None:
        self._asked: Queue[tuple[Encode, Assessment | None]] = Queue(1)
        self._done: deque[Encoded] = deque()
        self._busy = False
        self._thread: threading.Thread | None = None

    def start(self, request: Encode, seen: Assessment | None) -> None:
        """Begin to encode a frame. seen: None for a frame that is gone."""
        if self._busy:
            self._done.append(Encoded(request.number, request.frame_id))
            return
        if self._thread is None:  # nothing that is not recorded costs a thread
            self._thread = threading.Thread(target=self._run, name="encoder", daemon=True)
            self._thread.start()
        self._busy = True
        self._asked.put_nowait((request, seen))

    def take(self) -> Encoded | None:
        """Return the oldest frame that is done, None without one. Never blocks."""
        return self._done.popleft() if self._done else None

    def _run(self) -> None:
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICENESS)
        while True:
            done = encoded(*self._asked.get())
            self._busy = False
            self._done.append(done)
