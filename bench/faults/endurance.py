"""A row of the fault table: an hour's frames, run as fast as they go, with memory, files and threads watched.

`python -m bench.faults.endurance --frames 36000`, in virtual time: the daemon as it ships with journal, log,
pictures and link, and the engine with the perceiver `builtin`, in one process. Calls are opened and answered,
a parameter is set every two seconds, and the link is cut for half a minute of every five. The last line of
output is JSON.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import json
import logging
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from statistics import median
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame
from anytraverse.judging import Settings, Thresholds
from anytraverse.memory import Memory, first_memory
from anytraverse.operations import SetWord
from anytraverse.perception import make_perceiver
from anytraverse.perception.runtime import Runtime
from anytraverse.preferences import Preferences
from bench.faults.row import Row, RowOutcome, Work
from bench.faults.standing import StandingPicture
from bench.link.lossy import Radio
from bench.link.radio_model import LinkConditions
from bench.link.rover import Companion, make_ready
from bench.virtual_time import Clock, virtual_time
from companion.cameras.newest import CameraState, CameraStatus
from companion.config import Config
from companion.sim.loopback_vision import LoopbackVision
from companion.storage.call_files import MAX_CALLS
from companion.storage.journal import LARGEST
from companion.storage.log_file import LONGEST, log_to_file
from companion.tasks import VISION
from companion.vision.client import VisionClient
from companion.wire.answers import Answer
from companion.wire.ids import COMPONENT_ID, Motion, Result
from companion.wire.parameters import SUMMARY_RATE
from gcs_plugin.client import events as ev
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.terminal.runner import Runner

FRAMES = 36_000
PERIOD = 0.1
TURNS = 4
"""Turns of the daemon in a frame period."""
GROWTH = 3.0
"""MB by which the memory of the last four tenths may exceed that of the second to fifth, by their medians.

Single tenths differ by some MB, by what is in SQLite's and the allocator's hands at that moment.
"""
PICTURES = 20
SCENES = 64
"""Answered scenes that are remembered at most: so many are answered within the first 20 % of the frames."""
_THING_EVERY, _THING_FOR = 300, 40
"""Frames from one unknown thing to the next, and for how long it is ahead."""
_CUT_EVERY, _CUT_FOR = 3000, 300
_SET_EVERY = 20
_WORDS = ("gravel", "dirt path", "dry grass")


class CutRadio(Radio):
    """A radio that carries nothing while it is `cut`."""

    cut = False

    def carry(self, now: float) -> None:
        """Carry frames, or throw away what was sent."""
        if not self.cut:
            super().carry(now)
            return
        while self._far.read():
            pass


class Endurance(Companion):
    """The daemon and its engine; `frame` lets it judge one more."""

    def __init__(self, folder: Path, radio: Radio, seed: int) -> None:
        self._perceiver = make_perceiver("builtin", Runtime(threads=1))
        self._child = LoopbackVision(self._make_engine)
        vision = VisionClient(lambda: self._child, Config(), None, VISION)
        make_ready(vision, self._child)
        super().__init__(folder, lambda: radio.near, vision, pictures=PICTURES)
        self._picture = StandingPicture(seed)
        self.frames = 0

    def frame(self, *, thing: bool) -> None:
        """Judge a frame."""
        self.frames += 1
        now = time.monotonic()
        self._child.judge(Frame(self.frames, now, self._picture.draw(thing=thing)))
        self._child.live(CameraStatus(CameraState.DELIVERING), now)

    def turn(self) -> None:
        """Let vision work, and run one turn of the daemon."""
        self._child.work()
        super().turn()

    def _make_engine(self, memory: Memory | None) -> AnyTraverse:
        words = Preferences.parse("grass: 1; sky: -1")
        known = memory or first_memory(self._perceiver.model_id, words, SCENES)
        return AnyTraverse(self._perceiver, Settings(thresholds=Thresholds(roi=0.6)), known)


class EnduranceOperator:
    """Answers every call, first with a word that does not cover the thing, then with go."""

    def __init__(self, radio: Radio) -> None:
        self._radio = radio
        self._client = OperatorClient()
        self._runner = Runner(radio, self._client)
        self._encoder = mavlink.MAVLink(None, 255, 190)
        self.calls = self.acknowledged = self.settings = 0

    def step(self, now: float) -> None:
        """Hear, and answer."""
        self._runner.step(now)
        for event in self._client.events():
            if isinstance(event, ev.CallAnnounced):
                self.calls += 1
                word = SetWord(_WORDS[self.calls % len(_WORDS)], 1.0)
                self._client.answer(event.system, Answer(event.call.id, Motion.NONE, (word,)), now)
            elif isinstance(event, ev.Acknowledged):
                self.acknowledged += 1
                if event.acknowledgement.result is Result.NOT_COVERED:
                    self._client.answer(
                        event.system, Answer(event.acknowledgement.target, Motion.GO, ()), now
                    )

    def set_parameter(self) -> None:
        """Set how often summaries come."""
        self.settings += 1
        value = 1.0 + self.settings % 4 / 4
        message = mavlink.MAVLink_param_set_message(1, COMPONENT_ID, SUMMARY_RATE.encode(), value, 9)
        self._radio.write(bytes(message.pack(self._encoder)))


def own_memory() -> float:
    """Memory of this process's own in MB, without what the allocator keeps for later.

    Not the proportional set size: it grows when other programs that share our libraries end.
    """
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    found = re.search(r"^Anonymous: +(\d+) kB$", Path("/proc/self/smaps_rollup").read_text(), re.M)
    assert found is not None
    return int(found[1]) / 1024


def pass_period(clock: Clock, radio: CutRadio, rover: Endurance, operator: EnduranceOperator) -> None:
    """Let the time from one frame to the next pass."""
    for _ in range(TURNS):
        clock.now += PERIOD / TURNS
        radio.carry(clock.now)
        rover.turn()
        radio.carry(clock.now)
        operator.step(clock.now)


def bytes_in(folder: Path) -> int:
    """Return the bytes of all files in a folder and those below."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def run(frames: int, seed: int, folder: Path) -> dict[str, Any]:
    """Judge so many frames, and return the figures; memory, files and threads at each tenth."""
    logging.getLogger().setLevel(logging.INFO)
    memory, files, threads, sizes = list[float](), list[int](), list[int](), list[int]()
    began = time.perf_counter()
    with virtual_time() as clock, ExitStack() as closed:
        radio = CutRadio(LinkConditions(), str(seed))
        rover = closed.enter_context(closing(Endurance(folder, radio, seed)))
        closed.enter_context(log_to_file(folder, rover.writer))
        operator = EnduranceOperator(radio)
        for number in range(frames):
            radio.cut = number % _CUT_EVERY >= _CUT_EVERY - _CUT_FOR
            rover.frame(thing=number % _THING_EVERY >= _THING_EVERY - _THING_FOR)
            if number % _SET_EVERY == 0:
                operator.set_parameter()
            pass_period(clock, radio, rover, operator)
            if (number + 1) % max(1, frames // 10) == 0:
                memory.append(round(own_memory(), 2))
                files.append(len(os.listdir("/proc/self/fd")))
                threads.append(len(os.listdir("/proc/self/task")))
                sizes.append(bytes_in(folder))
    return {
        "frames": frames,
        "seconds": round(time.perf_counter() - began, 1),
        "calls": operator.calls,
        "acknowledged": operator.acknowledged,
        "settings": operator.settings,
        "memory_mb": memory,
        "files": files,
        "threads": threads,
        "disk_kb": [size // 1024 for size in sizes],
        "wrong": _wrong(frames, folder, memory, files, threads, operator),
    }


def _wrong(
    frames: int,
    folder: Path,
    memory: Sequence[float],
    files: Sequence[int],
    threads: Sequence[int],
    operator: EnduranceOperator,
) -> list[str]:
    wrong = list[str]()
    growth = median(memory[-4:]) - median(memory[1:5])
    if growth > GROWTH:
        wrong.append(f"memory grew by {growth:.1f} MB: {memory}")
    if len(set(files[1:])) > 1 or len(set(threads[1:])) > 1:
        wrong.append(f"open files {files}, threads {threads}")
    if operator.calls < frames // _THING_EVERY // 2 or operator.acknowledged < 2 * (operator.calls - 1):
        wrong.append(f"{operator.calls} calls, {operator.acknowledged} acknowledged answers")
    logged = sum(path.stat().st_size for path in (folder / "logs").iterdir())
    journal = sum(path.stat().st_size for path in folder.glob("journal.db*"))
    pictures, of_calls = (len(list((folder / name).iterdir())) for name in ("pictures", "calls"))
    if logged > 2 * LONGEST + 4096 or journal > LARGEST or pictures > PICTURES or of_calls > 3 * MAX_CALLS:
        wrong.append(f"log {logged} B, journal {journal} B, {pictures} pictures, {of_calls} files of calls")
    return wrong


def _produce(work: Work) -> RowOutcome:
    frames = 400 if work.short else FRAMES
    command = [
        sys.executable,
        "-m",
        "bench.faults.endurance",
        "--frames",
        str(frames),
        "--seed",
        str(work.seed),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=3600.0, check=False)
    try:
        told = json.loads(done.stdout.splitlines()[-1])
    except (IndexError, ValueError):
        return RowOutcome(0, (f"it ended with {done.returncode}: {done.stderr[-500:]}",))
    memory, files, threads = told["memory_mb"], told["files"][-1], told["threads"][-1]
    saw = (
        f"{told['frames']} frames in {told['seconds']:.0f} s, {told['calls']} calls; "
        f"{median(memory[1:5]):.1f} MB, then {median(memory[-4:]):.1f} MB, {files} files, {threads} threads"
    )
    return RowOutcome(told["frames"], tuple(told["wrong"]), saw=saw)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run it; returns 0 when nothing grew."""
    parser = argparse.ArgumentParser(prog="python -m bench.faults.endurance", description=__doc__)
    parser.add_argument("--frames", type=int, default=FRAMES)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        told = run(options.frames, options.seed, Path(folder))
    print(json.dumps(told))
    return 1 if told["wrong"] else 0


ROWS = (
    Row(
        "an hour's frames",
        "36,000 frames as fast as they go, with calls, answers, settings and a link that comes and goes",
        "memory, files and threads stay",
        _produce,
    ),
)
"""Of time."""

if __name__ == "__main__":
    sys.exit(main())
