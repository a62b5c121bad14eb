"""Loses a camera again and again, and measures when that is noticed and when its pictures are back.

`python -m bench.cameras --kind rtsp --losses 100`. Kinds: pipe, http, rtsp. In each loss, at random, a server
(for the pipe: its program) is killed or frozen, and comes back after 0.2 to 3 s. The camera's thread runs as
in the vision process, with T = 1 s and the usual latency of the configuration. The pictures show when they
were made. A picture whose stated age is below T and whose true age is not counts as `stale`. The last line
is JSON, in s: `noticed` is from the loss until the status gives a reason, of losses longer than T; `back` is
from the return until the first picture made after it.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import random
import signal
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from statistics import median
from typing import Any, Protocol

import numpy as np

from anytraverse.frame import Frame
from bench.cameras.servers import CameraServer, writer
from bench.cameras.stamps import age
from companion.cameras import CameraOptions, open_camera
from companion.cameras.newest import CameraThread, Patience
from companion.cameras.pipe import Pipe
from companion.config.schema import CameraSection

T = 1.0
BACK_WITHIN = 10.0
_PATIENCE = 30.0
_LEAST, _LONGEST = 0.2, 3.0
_SCRIPTS = {"http": "mjpeg_server", "rtsp": "rtsp_server"}
_OPTIONS = CameraOptions(
    width=640, height=480, pixel_format="gray", latency=CameraSection.latency, freshness=T
)


class Losable(Protocol):
    """Is lost and comes back."""

    def kill(self) -> None:
        """End it for good; `start` begins a new one."""

    def start(self) -> None:
        """Begin anew after `kill`."""

    def freeze(self) -> None:
        """Stop it, as SIGSTOP does."""

    def thaw(self) -> None:
        """Let it go on."""


class Program:
    """The program of a pipe, which the camera itself starts again. While `away`, it cannot be started."""

    def __init__(self) -> None:
        self.away = False
        self._pipe: Pipe | None = None

    def open(self) -> Pipe:
        """Open the pipe; for the camera's thread."""
        command = writer(640, 480, 15) if not self.away else f"{sys.executable} -c raise(SystemExit(1))"
        self._pipe = Pipe(command, _OPTIONS)
        return self._pipe

    def kill(self) -> None:
        """Kill the program, and have those that follow end at once."""
        self.away = True
        self._signal(signal.SIGKILL)

    def start(self) -> None:
        """Let the program run again."""
        self.away = False

    def freeze(self) -> None:
        """Stop the program."""
        self._signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """Let the program go on."""
        self._signal(signal.SIGCONT)

    def _signal(self, number: int) -> None:
        assert self._pipe is not None
        try:
            os.killpg(self._pipe.pid, number)
        except ProcessLookupError:  # the camera's thread has ended it meanwhile
            return


class Watch:
    """Takes the pictures as the vision process does, and knows how old each is."""

    def __init__(self, thread: CameraThread) -> None:
        self.thread = thread
        self.frames = self.stale = 0
        self.oldest = 0.0

    def take(self, timeout: float) -> float | None:
        """Return when the next picture was made, in monotonic s; None when none came in time."""
        frame = self.thread.take(timeout)
        if frame is None:
            return None
        now = time.monotonic()
        true_age = _age(frame, now)
        self.frames += 1
        self.oldest = max(self.oldest, true_age)
        self.stale += true_age > T >= now - frame.captured_at
        return now - true_age

    def until(self, true: Callable[[float | None], bool], seconds: float) -> float:
        """Take pictures until `true` of the newest one's time, and return when; raise TimeoutError."""
        began = time.monotonic()
        while True:
            made = self.take(0.01)
            if true(made):
                return time.monotonic()
            if time.monotonic() - began > seconds:
                raise TimeoutError(f"not after {seconds} s: {self.thread.status}")


def _age(frame: Frame, at: float) -> float:
    height, width, _ = frame.image.shape
    return age(np.ascontiguousarray(frame.image[..., 0]).tobytes(), width, height, at)


def lose(watch: Watch, camera: Losable, losses: int, chance: random.Random) -> dict[str, Any]:
    """Lose the camera so often. Returns the figures."""
    noticed: list[float] = []
    back: list[float] = []
    kinds = {"killed": 0, "frozen": 0}
    watch.until(lambda made: made is not None, _PATIENCE)
    for number in range(losses):
        frozen, lasts = chance.random() < 0.5, chance.uniform(_LEAST, _LONGEST)
        kinds["frozen" if frozen else "killed"] += 1
        lost_at = time.monotonic()
        (camera.freeze if frozen else camera.kill)()
        reason_at: float | None = None
        while time.monotonic() - lost_at < lasts:
            watch.take(0.01)
            if reason_at is None and watch.thread.status.reason:
                reason_at = time.monotonic()
        if lasts > T + 0.2:
            noticed.append(reason_at - lost_at if reason_at is not None else float("inf"))
        (camera.thaw if frozen else camera.start)()
        returned_at = time.monotonic()
        back.append(watch.until(partial(_made_after, returned_at), _PATIENCE) - returned_at)
        watch.until(partial(_made_after, time.monotonic() + 0.3), _PATIENCE)
        print(f"{number + 1}: {'frozen' if frozen else 'killed'} {lasts:.1f} s, back after {back[-1]:.2f} s")
    return {
        "losses": losses,
        **kinds,
        "longer_than_t": len(noticed),
        "noticed_s": _figures(noticed),
        "back_s": _figures(back),
        "back_late": sum(seconds > BACK_WITHIN for seconds in back),
        "frames": watch.frames,
        "stale": watch.stale,
        "oldest_s": round(watch.oldest, 3),
    }


def _made_after(moment: float, made: float | None) -> bool:
    return made is not None and made > moment


def _figures(seconds: list[float]) -> dict[str, float]:
    if not seconds:
        return {}
    return {"p50": round(median(seconds), 2), "max": round(max(seconds), 2)}


def losses(kind: str, count: int, seed: int) -> dict[str, Any]:
    """Lose a camera of this kind so often. Returns the figures of `lose`."""
    with ExitStack() as stack:
        if kind == "pipe":
            program = Program()
            camera: Losable = program
            connect: Callable[[], Any] = program.open
        else:
            server = CameraServer(_SCRIPTS[kind])
            stack.callback(server.kill)
            camera = server
            connect = partial(open_camera, f"{kind}://127.0.0.1:{server.port}/trail", _OPTIONS)
        thread = CameraThread(connect, patience=Patience(late=T))
        stack.callback(thread.close, 5.0)
        return lose(Watch(thread), camera, count, random.Random(seed))


def main() -> int:
    """Run the losses of one kind. Returns 1 when one was not noticed, or a picture was stale or came late."""
    parser = argparse.ArgumentParser(prog="python -m bench.cameras", description=__doc__)
    parser.add_argument("--kind", choices=("pipe", *_SCRIPTS), required=True)
    parser.add_argument("--losses", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    logging.basicConfig(level=logging.ERROR)
    figures = losses(options.kind, options.losses, options.seed)
    print(json.dumps({"kind": options.kind, **figures}))
    missed = figures["noticed_s"].get("max", 0.0) == float("inf")
    return int(missed or bool(figures["stale"] or figures["back_late"]))


if __name__ == "__main__":
    sys.exit(main())
