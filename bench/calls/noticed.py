"""Pastes things into clean frames: whether a rover still notices them after taps and answers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from anytraverse.engine import AnyTraverse
from anytraverse.evaluation.datasets import Selection, open_folder
from anytraverse.evaluation.datasets.splits import ALL
from anytraverse.memory import Memory
from bench.calls.engines import alone, shipped
from bench.calls.operators import Listed, nothing_known, operator
from bench.calls.real import RATE
from bench.perception.approaches import approaches
from bench.perception.figures import share
from bench.perception.frames import DRIVABLE, Frames, read_frames
from bench.perception.judged import Judge
from bench.perception.pasting import Cutout
from bench.perception.things import gather
from companion.desk.drives.judge import DriveJudge
from companion.desk.tuning.episode import LabelledDrive, LabelOperator
from companion.desk.tuning.trial import Combination, Trial

BLOCKS = (2, 4)
"""Drives of home that the network was not trained on."""
COUNT, QUICK_COUNT = 24, 8
"""Approaches for each place and kind of thing."""
SEED = 1


@dataclass(frozen=True)
class Taught:
    """Says after how many answers of which operator things are pasted, and how many. answers: 0 for fresh."""

    data: Path
    count: int
    name: str
    by: str = "word"
    answers: int = 0


def states(data: Path, count: int) -> list[Taught]:
    """Return what is measured."""
    return [
        Taught(data, count, "fresh"),
        Taught(data, count, "after_3_taps", "tap", 3),
        Taught(data, count, "after_10_taps", "tap", 10),
        Taught(data, count, "after_10_answers", "word", 10),
    ]


def drive(job: Taught) -> dict[str, Any]:
    """Teach a rover on the drives of home, and paste things. Return the share that it notices, as JSON.

    taught: answers that it was given, of which with taps as many as were asked for, if there were so many.
    """
    config = shipped(RATE)
    engine = alone(config)
    memory, taught = _taught(job, engine) if job.answers else (engine.memory, 0)
    # no reference: what is asked is whether things are noticed, not whether the place is known
    judge = Judge(AnyTraverse(engine.perceiver, engine.settings, replace(memory, reference=None)))
    frames = read_frames(job.data, BLOCKS)
    cutouts = gather(None, frames.abroad, SEED)
    return {**share(list(_noticed(judge, frames, cutouts, job.count))).as_json(), "taught": taught}


def _taught(job: Taught, engine: AnyTraverse) -> tuple[Memory, int]:
    """Drive home until so many answers were given. Return what is remembered then, and how many were."""
    dataset = open_folder(job.data / "trail", ALL, Selection())
    drivable = [name for folded, name in dataset.classes.known.items() if folded in DRIVABLE]
    listed = Listed(operator(job.by, LabelOperator.of(dataset, drivable), drivable), nothing_known)
    trial = Trial(Combination.of(engine.settings), DriveJudge(shipped(RATE), engine), listed)
    taught = 0
    for number, frame in enumerate(LabelledDrive(dataset, RATE).frames()):
        trial.step(number, frame)
        taught = sum(call.thing or job.by != "tap" for call in listed.calls)
        if taught >= job.answers:
            break
    return engine.memory, taught


def _noticed(judge: Judge, frames: Frames, cutouts: dict[str, list[Cutout]], count: int) -> Iterator[bool]:
    for approach in approaches(judge, frames, cutouts, count, SEED, whole=False):
        if approach.counts():
            yield approach.noticed_at() is not None
