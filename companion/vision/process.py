"""Runs the vision process: handles requests and frames in turn until the supervisor is gone."""

from __future__ import annotations

import faulthandler
import logging
import select
import signal
import socket
import time
from collections import deque
from dataclasses import replace
from functools import partial
from typing import NoReturn

from anytraverse.errors import AnyTraverseError
from anytraverse.history import Entry
from companion.cameras import open_camera
from companion.cameras.newest import CameraThread, Patience
from companion.system.child_process import end_with, step_back
from companion.system.log_lines import StderrHandler, end_process
from companion.vision.answer_queue import AnswerQueue
from companion.vision.beside import BesideJudging
from companion.vision.codec import Splitter, decode_trusted, encode
from companion.vision.memory_copy import parts, update_from
from companion.vision.messages import (
    Alive,
    Apply,
    Encode,
    Failed,
    Logged,
    Model,
    Ready,
    Report,
    Request,
    Restore,
    Scenes,
    Situation,
    Start,
    Tune,
    error_text,
)
from companion.vision.warm_up import load_and_warm_up
from companion.vision.worker import Worker, weak_in_use
from companion.wire.packing import clean

log = logging.getLogger(__name__)

NICENESS = 5
FIRST_OUT = 900
"""The process's oom_score_adj, of 1000: the kernel kills it before others when memory runs out."""
_FRAME_TIMEOUT = 0.02
"""Seconds to wait for a frame before requests are looked at: so a drawing ends before the next frame."""
_ALIVE_EVERY = 0.2
_MAX_LINES = 100
_LONGEST_LINE = 2000


class SupervisorChannel:
    """Sends reports and receives requests on the channel to the supervisor."""

    def __init__(self, channel: socket.socket) -> None:
        self._channel = channel
        self._splitter = Splitter()
        self.lines: deque[Logged] = deque(maxlen=_MAX_LINES)

    def send(self, report: Report) -> None:
        """Send the waiting log lines and a report. Blocks while the supervisor does not read."""
        while self.lines:
            self._channel.sendall(encode(self.lines.popleft()))
        for part in parts(report):
            self._channel.sendall(encode(part))

    def has_room(self) -> bool:
        """Whether the supervisor has read enough of the earlier reports that another one can be sent."""
        return bool(select.select([], [self._channel], [], 0)[1])

    def requests(self, timeout: float) -> list[Request]:
        """Wait up to `timeout` seconds for requests. Raises EOFError when the supervisor is gone."""
        if not select.select([self._channel], [], [], timeout)[0]:
            return []
        data = self._channel.recv(1 << 20)
        if not data:
            raise EOFError("the supervisor is gone")
        return [decode_trusted(packed) for packed in self._splitter.feed(data)]


class _Lines(logging.Handler):
    """Queues log lines for the supervisor's log. The queue drops its oldest line when it is full."""

    def __init__(self, port: SupervisorChannel) -> None:
        super().__init__()
        self._port = port

    def emit(self, record: logging.LogRecord) -> None:
        try:
            text = self.format(record)[:_LONGEST_LINE].encode(errors="backslashreplace").decode()
        except Exception:  # a wrong format in a log call must not end the process
            self.handleError(record)
            return
        self._port.lines.append(Logged(record.levelno, record.name, text))


def main(descriptor: int, parent: int) -> NoReturn:
    """Run until the supervisor, process `parent`, is gone. descriptor: the channel's socket."""
    end_with(parent)  # so that the camera is free again
    step_back(NICENESS, FIRST_OUT)
    faulthandler.enable()
    for number in (signal.SIGINT, signal.SIGTERM):  # a terminal and systemd send them to both processes
        signal.signal(number, signal.SIG_IGN)
    port = SupervisorChannel(socket.socket(fileno=descriptor))
    crash = StderrHandler()
    crash.setLevel(logging.CRITICAL)
    logging.basicConfig(level=logging.INFO, handlers=[_Lines(port), crash], format="%(message)s")
    code = 0
    try:
        _serve(port)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        pass
    except BaseException:
        log.critical("the vision process failed", exc_info=True)
        code = 1
    end_process(code)


def _serve(port: SupervisorChannel) -> None:
    start = receive_start(port)
    camera, freshness = start.config.camera, start.config.freshness
    reader = CameraThread(
        partial(open_camera, camera.source, start.config.camera_options),
        first_id=start.first_frame,
        # Before T, so that the reason is there when the fault is, but not before the next frame is due.
        patience=Patience(late=max(0.6 * freshness, 1.1 / camera.rate)),
        size=(camera.width, camera.height),
    )
    try:
        ready = load_and_warm_up(start.config, start.memory, partial(_send_alive, port, reader))
    except AnyTraverseError as error:
        port.send(Failed(error_text(error)))
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
        port.send(Failed(error_text(AnyTraverseError(f"the perceiver failed to load: {error!r}"))))
        return
    engine, revision = ready.engine, start.revision + 1
    update = update_from(
        start.memory, engine.memory, revision, start.revision, weak_in_use(engine, engine.memory)
    )
    model = Model.of(engine.perceiver)
    port.send(Ready(model, engine.settings, update, tuple(ready.notices), ready.step))
    _judge_frames(port, Worker(engine, revision), reader, camera.rate)


def _send_alive(port: SupervisorChannel, reader: CameraThread) -> None:
    status = reader.status
    port.send(Alive(replace(status, reason=clean(status.reason)), reader.delivered_at))


def receive_start(port: SupervisorChannel) -> Start:
    """Wait for the first message, and for all remembered scenes that follow it."""
    start: Start | None = None
    scenes: list[Entry] = []
    while start is None or len(scenes) < start.more:
        for request in port.requests(timeout=10.0):
            if isinstance(request, Start):
                start = request
            elif isinstance(request, Scenes):
                scenes += request.entries
    return start.joined(tuple(scenes)) if scenes else start


def _judge_frames(port: SupervisorChannel, worker: Worker, reader: CameraThread, rate: float) -> None:
    period, encoder, answers = 1.0 / rate, BesideJudging(), AnswerQueue()
    tuned, due, alive_at = False, time.monotonic(), float("-inf")
    while True:
        for request in port.requests(timeout=0.0):
            tuned = tuned or isinstance(request, Tune)
            if isinstance(request, Situation):
                period = 1.0 / (request.rate or rate)
            if isinstance(request, Encode):
                encoder.start(request, worker.recent(request.frame_id))
            elif isinstance(request, (Apply, Restore)):
                answers.add(request)
            else:
                _handle(request, worker, port)
        began = time.monotonic()
        if (answer := answers.take(began)) is not None:
            _handle(answer, worker, port)
            answers.handled(began, time.monotonic())
        while port.has_room() and (encoded := encoder.take()) is not None:
            port.send(encoded)
        frame = reader.take(timeout=_FRAME_TIMEOUT)
        if not reader.running:
            raise RuntimeError("the camera's thread has ended, or hangs in its driver")
        now = time.monotonic()
        if now - alive_at >= _ALIVE_EVERY:
            alive_at = now
            _send_alive(port, reader)
        # A frame that comes too early is dropped, since it would be old when its turn comes. Half a period of
        # tolerance lets every frame pass of a camera that runs at the configured rate with some jitter.
        if frame is None or not tuned or now < due - period / 2:
            continue
        due = max(due + period, now - period)
        judged = worker.judge(frame)
        answers.judged()
        if judged.update is not None or port.has_room():
            port.send(judged)
        ground = worker.remember_ground(judged.assessment)
        if ground is not None and port.has_room():
            port.send(ground)
        planned = worker.plan(judged.assessment)
        if planned is not None and port.has_room():
            port.send(planned)


def _handle(request: Request, worker: Worker, port: SupervisorChannel) -> None:
    for report in worker.handle(request):
        port.send(report)
