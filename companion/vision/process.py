"""The vision process itself: it reads requests and frames in turn until its supervisor is gone."""

from __future__ import annotations

import contextlib
import ctypes
import faulthandler
import logging
import os
import select
import signal
import socket
import sys
import time
import traceback
from collections import deque
from functools import partial
from pathlib import Path
from typing import NoReturn

from anytraverse.errors import AnyTraverseError
from companion.cameras import Playback, open_camera
from companion.cameras.newest import CameraThread
from companion.vision.codec import Splitter, decode_trusted, encode
from companion.vision.messages import (
    Alive,
    Failed,
    Logged,
    Model,
    Ready,
    Report,
    Request,
    Scenes,
    Start,
    Tune,
    told,
    update_from,
)
from companion.vision.warm_up import get_ready
from companion.vision.worker import Worker, weak_in_use

log = logging.getLogger(__name__)

NICENESS = 5
FIRST_OUT = 900
"""Added to its share of memory, of 1000, where the kernel chooses whom to kill when memory runs out."""
_PATIENCE = 0.05
_ALIVE_EVERY = 0.2
_MAX_LINES = 100
_LONGEST_LINE = 2000
_SET_DEATH_SIGNAL = 1


class Port:
    """The process's end of the channel. It waits where the supervisor does not read."""

    def __init__(self, channel: socket.socket) -> None:
        self._channel = channel
        self._splitter = Splitter()
        self.lines: deque[Logged] = deque(maxlen=_MAX_LINES)

    def send(self, report: Report) -> None:
        """Waits until the supervisor has room."""
        while self.lines:
            self._channel.sendall(encode(self.lines.popleft()))
        self._channel.sendall(encode(report))

    def has_room(self) -> bool:
        """Whether the supervisor reads: what it was sent before does not wait any more."""
        return bool(select.select([], [self._channel], [], 0)[1])

    def requests(self, timeout: float) -> list[Request]:
        """What has arrived within `timeout` seconds. Raises EOFError when the supervisor is gone."""
        if not select.select([self._channel], [], [], timeout)[0]:
            return []
        data = self._channel.recv(1 << 20)
        if not data:
            raise EOFError("the supervisor is gone")
        return [decode_trusted(packed) for packed in self._splitter.feed(data)]


class _Lines(logging.Handler):
    """The log goes to the supervisor's. Lines that wait while the process hangs are bounded."""

    def __init__(self, port: Port) -> None:
        super().__init__()
        self._port = port

    def emit(self, record: logging.LogRecord) -> None:
        try:
            text = self.format(record)[:_LONGEST_LINE]
        except Exception:  # a mistake in a line is no reason to end
            self.handleError(record)
            return
        self._port.lines.append(Logged(record.levelno, record.name, text))


def main(descriptor: int, parent: int) -> NoReturn:
    """Run until the supervisor, process `parent`, is gone. descriptor: of the channel's socket."""
    end_with(parent)
    step_back()
    faulthandler.enable()
    for number in (signal.SIGINT, signal.SIGTERM):  # a terminal and systemd send them to both processes
        signal.signal(number, signal.SIG_IGN)
    port = Port(socket.socket(fileno=descriptor))
    logging.basicConfig(level=logging.INFO, handlers=[_Lines(port)], format="%(message)s")
    code = 0
    try:
        _serve(port)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        pass
    except BaseException:
        traceback.print_exc()
        code = 1
    sys.stderr.flush()
    os._exit(code)  # neither a hanging camera nor a network in native code may keep the process


def end_with(parent: int) -> None:
    """Die at once when the supervisor dies, however it does: nobody else would give the camera back."""
    ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(0)


def step_back() -> None:
    """The supervisor goes first: lower priority here, and the first choice when memory runs out."""
    os.nice(NICENESS)
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text(str(FIRST_OUT), encoding="ascii")


def _serve(port: Port) -> None:
    start = _all_of_the_start(port)
    camera = start.config.camera
    playback = Playback(camera.playback, camera.loop)
    reader = CameraThread(partial(open_camera, camera.source, playback), first_id=start.first_frame)
    try:
        ready = get_ready(start.config, start.memory)
    except AnyTraverseError as error:
        port.send(Failed(told(error)))
        return
    except MemoryError:
        port.send(
            Failed(
                "the perceiver does not fit into memory: stop other programs, "
                "or take an int8 bundle or one of a smaller --size"
            )
        )
        return
    except Exception as error:
        log.exception("the perceiver failed to load")
        port.send(Failed(told(AnyTraverseError(f"the perceiver failed to load: {error!r}"))))
        return
    engine, revision = ready.engine, start.revision + 1
    update = update_from(
        start.memory, engine.memory, revision, start.revision, weak_in_use(engine, engine.memory)
    )
    model = Model.of(engine.perceiver)
    port.send(Ready(model, engine.settings, update, tuple(ready.notices), ready.step))
    _look(port, Worker(engine, revision), reader, 1.0 / camera.rate)


def _all_of_the_start(port: Port) -> Start:
    start: Start | None = None
    while start is None or start.more:
        for request in port.requests(timeout=10.0):
            if isinstance(request, Start):
                start = request
            elif isinstance(request, Scenes) and start is not None:
                start = start.joined(request.entries)
    return start


def _look(port: Port, worker: Worker, reader: CameraThread, period: float) -> None:
    tuned, due, alive_at = False, time.monotonic(), float("-inf")
    while True:
        for request in port.requests(timeout=0.0):
            tuned = tuned or isinstance(request, Tune)
            for report in worker.handle(request):
                port.send(report)
        frame = reader.take(timeout=_PATIENCE)
        if not reader.running:
            raise RuntimeError("the camera's thread has ended, or hangs in its driver")
        now = time.monotonic()
        if now - alive_at >= _ALIVE_EVERY:
            alive_at = now
            port.send(Alive(reader.status, reader.delivered_at))
        # Judged as it comes or not at all: a frame that waited for its turn would be older than need be.
        if frame is None or not tuned or now < due - period / 2:
            continue
        due = max(due + period, now - period)
        looked = worker.look(frame)
        if looked.update is not None or port.has_room():
            port.send(looked)
