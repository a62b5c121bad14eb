"""Drives labelled frames of one vehicle in their order, twice: how soon the calls become fewer."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from anytraverse.assessment import Reason
from anytraverse.engine import AnyTraverse
from anytraverse.evaluation.datasets import Selection, open_folder
from anytraverse.evaluation.datasets.splits import ALL
from anytraverse.frame import Frame, Image
from anytraverse.look import read_picture
from bench.calls.engines import engines, shipped
from bench.calls.operators import OPERATORS, AnsweredCall, Listed, nothing_known, operator
from bench.perception.figures import share
from bench.perception.frames import DRIVABLE
from companion.desk.drives.judge import DriveJudge
from companion.desk.tuning.episode import LabelledDrive, LabelOperator
from companion.desk.tuning.trial import Combination, Trial, run_trials

RATE = 2.0
"""Frames/s. No time passes between frames but by the next frame: see `companion.desk.drives.judge`."""
AWAY_S = 3600.0
"""Seconds from the first pass to the second."""
TRAINED = "the shipped network was trained on these frames, but for blocks 2 and 4 (200-299 and 400-499)"


@dataclass(frozen=True)
class Passes:
    """Names the labelled folder, and every how many-th frame of it is driven."""

    folder: Path
    every: int = 1


@dataclass(frozen=True)
class Driven:
    """Holds what two passes led to. frames: of one pass. half, again: seconds at which the second half of
    the first pass begins, and the second pass. calls: by operator.

    remembered: scenes after the first pass. foreign: whether each frame of another region was then taken for
    a known scene.
    """

    frames: int
    half: float
    again: float
    calls: dict[str, list[AnsweredCall]]
    remembered: int
    foreign: tuple[bool, ...]


def drive(job: Passes) -> Driven:
    """Drive the frames twice with each operator. Raises DatasetError, OSError."""
    dataset = open_folder(job.folder, ALL, Selection(every=job.every))
    drivable = [name for folded, name in dataset.classes.known.items() if folded in DRIVABLE]
    config = shipped(RATE)
    labels = LabelOperator.of(dataset, drivable)
    listed = {name: Listed(operator(name, labels, drivable), nothing_known) for name in OPERATORS}
    made = engines(config, len(listed))
    own = zip(made, listed.values(), strict=True)
    trials = [Trial(Combination.of(one.settings), DriveJudge(config, one), each) for one, each in own]
    frames, films = len(dataset), LabelledDrive(dataset, RATE)
    run_trials(trials, films.frames())
    named = made[OPERATORS.index("word")]
    foreign = tuple(_known(named, image, (frames + 1) / RATE) for image in foreign_frames(job.folder.parent))
    remembered = len(named.memory.history)
    run_trials(trials, (replace(frame, at=frame.at + AWAY_S) for frame in films.frames()))
    calls = {name: each.calls for name, each in listed.items()}
    return Driven(frames, frames / 2 / RATE, AWAY_S, calls, remembered, foreign)


def foreign_frames(data: Path) -> Iterator[Image]:
    """Read the frames of other regions and vehicles. Raises AnyTraverseError, OSError."""
    for path in sorted([*data.glob("abroad/*/*.jpg"), *data.glob("frames/*.jpg")]):
        yield read_picture(str(path))


def _known(engine: AnyTraverse, image: Image, now: float) -> bool:
    """Whether a rover that has just driven takes a frame for a scene that it knows. Changes nothing."""
    # what a perceiver and the newest frame hold is not needed twice
    then = copy.deepcopy(engine, {id(engine.perceiver): engine.perceiver, id(engine.newest): None})
    seen = then.step(Frame(1, now, image), now)
    return seen.match is not None or Reason.UNKNOWN_SCENE not in seen.reasons


def figures(driven: Driven) -> dict[str, Any]:
    """Return the figures as JSON values."""
    found: dict[str, Any] = {}
    for name, calls in driven.calls.items():
        first = [call for call in calls if call.at <= driven.again]
        late = [call for call in first if call.at > driven.half]
        scenes = [call for call in first if call.scene]
        idle = sum(not call.words for call in scenes)
        found[name] = {
            "calls_per_100": _per_100(len(first), driven.frames),
            "last_half_per_100": _per_100(len(late), driven.frames / 2),
            "second_pass_per_100": _per_100(len(calls) - len(first), driven.frames),
            "without_new_word": round(idle / len(scenes), 3) if scenes and name != "go" else None,
            "scene_calls": len(scenes),
            "object_calls": sum(call.thing for call in first),
        }
    return found


def foreign_known(driven: Driven) -> dict[str, Any] | None:
    """Return the share of foreign frames that were taken for a known scene; None without such frames."""
    if not driven.foreign:
        return None
    return {**share(driven.foreign).as_json(), "scenes": driven.remembered}


def _per_100(calls: int, frames: float) -> float:
    return round(100 * calls / frames, 2)
