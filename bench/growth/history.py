"""Measures what remembered scenes cost: matching, answers, the journal, a start, the supervisor's turn."""

from __future__ import annotations

import sqlite3
import tempfile
import time
import tracemalloc
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from anytraverse.history import Embedding, Entry, History, Place
from anytraverse.memory import Memory, first_memory, resumed_memory
from anytraverse.perception import Example
from anytraverse.preferences import Preferences
from bench.link.rover import Companion, make_engine, make_ready
from bench.link.synthetic_frames import NumberPerceiver
from bench.series import PlottedSeries, cpu_ms
from companion.cameras.newest import CameraState, CameraStatus
from companion.config import Config
from companion.desk.memory.scene_file import Scene, write_scenes
from companion.sim.loopback_link import pair
from companion.sim.loopback_vision import LoopbackVision
from companion.storage import Journal
from companion.storage.batch import Batch
from companion.tasks import VISION
from companion.vision.client import VisionClient
from companion.vision.codec import decode, decode_trusted, encode, encode_trusted
from companion.vision.memory_copy import MemoryCopy, update_from, updated
from companion.vision.messages import Done, Scenes, Start
from companion.vision.process import SupervisorChannel, receive_start

COUNTS = (10, 100, 256, 1000, 3000, 10_000)
"""256 is the limit as configured, 10,000 the highest that may be configured."""
NUMBERS = 512
"""Of an embedding, as CLIPSeg's has. The built-in network's is shorter."""
_TAPS_EVERY = 10
"""Scenes that share one tapped example."""
_LARGEST = 1 << 30
"""Bytes that the measured journal may have: more than a rover's, so that what does not fit is measured."""
_MODEL = NumberPerceiver().model_id


def measure(*, quick: bool, bundle: Path | None) -> list[PlottedSeries]:
    """Measures up to 10,000 scenes; quick: up to 1,000. `bundle` is not needed."""
    del bundle
    rounds, counts = (5, COUNTS[:4]) if quick else (11, COUNTS)
    frame = PlottedSeries("A frame of a changed scene, and an answer", "remembered scenes", "ms of CPU")
    start = PlottedSeries("A start with these scenes", "remembered scenes", "ms of CPU")
    disk = PlottedSeries("What remembered scenes take", "remembered scenes", "MB")
    for count in counts:
        memory = _remembering(count)
        _measure_frame(memory, count, rounds, frame)
        with tempfile.TemporaryDirectory(prefix="growth-") as folder:
            _measure_journal(memory, count, rounds, Path(folder), frame, start, disk)
        _measure_start(memory, count, max(3, rounds // 3), start)
        with tempfile.TemporaryDirectory(prefix="growth-") as folder:
            _measure_turns(memory, count, Path(folder), frame)
        disk.add("in memory of each process", count, [_traced_mb(count)])
        print(f"{count} scenes: matched in {frame.lines['match'][-1][1]} ms", flush=True)
    return [frame, start, disk]


def _remembering(count: int) -> Memory:
    """Returns a memory of so many scenes, each with five words and a place, some with a tapped thing."""
    random = np.random.default_rng(count)
    words = Preferences.of({"grass": 1.0, "dirt path": 1.0, "bush": -1.0, "rock": -1.0, "drum": -1.0}, 1)
    entries, example = [], Example(_MODEL, _vector(random))
    for stamp in range(1, count + 1):
        if stamp % _TAPS_EVERY == 0:
            example = Example(_MODEL, _vector(random))
        place = Place(50.0 + stamp * 1e-5, 8.0, 90.0, 1.79e9 + stamp, (0.0, 0.0, 90.0))
        entries.append(Entry(_vector(random), words, stamp, stamp, stamp, {"drum": (example,)}, place))
    memory = first_memory(_MODEL, words, count + 1)
    return replace(
        memory, reference=_vector(random), history=History(entries, count + 1), clock=count, settled={}
    )


def _traced_mb(count: int) -> float:
    """Returns the MB of so many scenes that are ready to be compared with frames."""
    tracemalloc.start()
    memory = _remembering(count)
    memory.history.best(memory.history[0].embedding)
    taken = tracemalloc.get_traced_memory()[0] / 1e6
    tracemalloc.stop()
    return taken


def _vector(random: np.random.Generator) -> Embedding:
    vector = random.standard_normal(NUMBERS).astype(np.float32)
    return np.asarray(vector / np.linalg.norm(vector), np.float32)


def _measure_frame(memory: Memory, count: int, rounds: int, series: PlottedSeries) -> None:
    scene = _vector(np.random.default_rng(count + 1))
    series.add("match", count, cpu_ms(lambda: memory.history.best(scene), rounds))

    def answer() -> Memory:
        return memory.remembering(scene, count + 1, Place(), move=True)

    series.add("answer: remember a scene", count, cpu_ms(answer, rounds))
    series.add(
        "adopt: stamp a match",
        count,
        cpu_ms(lambda: memory.history.touched(memory.history[0], count + 1), rounds),
    )
    after = answer()

    def follow() -> Memory:
        packed = encode(Done(1, None, "", update_from(memory, after, 2, 1, ())))
        told = decode(packed[4:])
        assert isinstance(told, Done)
        assert told.update is not None
        return updated(memory, told.update)

    series.add("tell the supervisor", count, cpu_ms(follow, rounds))


def _measure_journal(
    memory: Memory,
    count: int,
    rounds: int,
    folder: Path,
    frame: PlottedSeries,
    start: PlottedSeries,
    disk: PlottedSeries,
) -> None:
    scene = _vector(np.random.default_rng(count + 2))
    after = memory.remembering(scene, count + 1, Place(), move=True)
    with closing(Journal(folder, _LARGEST)) as journal:
        journal.commit(Batch(memory=memory))
        turn = [memory, after]

        def commit() -> None:
            turn.reverse()
            journal.commit(Batch(memory=turn[0]))

        frame.add("journal: commit it", count, cpu_ms(commit, rounds))
        journal.commit(Batch(memory=memory))
    _checkpoint(folder / "journal.db")
    disk.add("journal", count, [(folder / "journal.db").stat().st_size / 1e6])

    def opened() -> None:
        Journal(folder, _LARGEST).close()

    start.add("journal: open and read", count, cpu_ms(opened, max(3, rounds // 3)))
    write_scenes(folder / "scenes", _MODEL, [Scene(entry) for entry in memory.history])
    disk.add("file to carry, without pictures", count, [(folder / "scenes").stat().st_size / 1e6])


def _checkpoint(path: Path) -> None:
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()


def _measure_start(memory: Memory, count: int, rounds: int, series: PlottedSeries) -> None:
    """Measures what the supervisor sends to a new vision process, and what that does with it."""
    parts = list(_handed_over(memory))
    series.add("supervisor: encode", count, cpu_ms(lambda: list(_handed_over(memory)), rounds))
    series.add("vision: receive", count, cpu_ms(lambda: receive_start(_Sent(parts)), rounds))
    meaning = NumberPerceiver().meaning
    words = memory.configured
    series.add(
        "vision: resume", count, cpu_ms(lambda: resumed_memory(memory, _MODEL, words, meaning), rounds)
    )


def _handed_over(memory: Memory) -> Iterator[bytes]:
    copy = MemoryCopy(memory, memory.history.limit)
    first, more = copy.first_part()
    yield encode_trusted(Start(Config(), first, 0, 1, more))
    while scenes := copy.next_scenes():
        yield encode_trusted(Scenes(scenes))


class _Sent(SupervisorChannel):
    """The vision process's end, with all that it was sent."""

    def __init__(self, parts: list[bytes]) -> None:
        self._parts = parts

    def requests(self, timeout: float) -> list[Any]:
        del timeout
        return [decode_trusted(part[4:]) for part in self._parts]


def _measure_turns(memory: Memory, count: int, folder: Path, series: PlottedSeries) -> None:
    """Measures turns of the supervisor's loop with this memory, while nothing is answered."""
    child = LoopbackVision(make_engine)
    vision = VisionClient(lambda: child, Config(), memory, VISION)
    make_ready(vision, child)
    near, _ = pair()
    with closing(Companion(folder, lambda: near, vision)) as companion:

        def turn() -> None:
            now = time.monotonic()
            child.live(CameraStatus(CameraState.DELIVERING), now)
            companion.turn()

        series.add("supervisor: a turn", count, cpu_ms(turn, 11))
