"""Judges an episode by all combinations: first every frame is perceived once, then the trials are run."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, TypeVar

from anytraverse.engine import AnyTraverse
from anytraverse.errors import PerceiverError
from anytraverse.evaluation.progress import Progress, doing
from anytraverse.evaluation.seeing import maps_identity
from anytraverse.evaluation.spreading import spread, tick
from anytraverse.perception import surroundings_of
from anytraverse.perception.stored import PerceptionStore, StoredPerceiver
from companion.config import Config
from companion.desk.drives.drive import DriveError, DriveFrame
from companion.desk.drives.judge import DriveJudge
from companion.desk.tuning.episode import Episode
from companion.desk.tuning.trial import Combination, GridError, Trial, TrialEngine, TrialOutcome, run_trials
from companion.vision.warm_up import load_engine

_MANY = 40
"""Combinations from which they are judged in smaller parts, so that the progress is seen."""
_MOST_JOBS = 256
_Result = TypeVar("_Result")


def processes_of(jobs: int) -> int:
    """Return how many processes `--jobs` asks for; 0: as many as there are cores. Raises GridError."""
    if not 0 <= jobs <= _MOST_JOBS:
        raise GridError(f"--jobs {jobs}: give a number of processes, 1 to {_MOST_JOBS}, or 0 for all cores")
    return jobs or len(os.sched_getaffinity(0))


@dataclass(frozen=True)
class Where:
    """Says where work is done. cache: folder of what was seen. most: its bytes. dask: a scheduler."""

    cache: Path
    most: int
    processes: int = 1
    dask: str | None = None


@dataclass(frozen=True)
class _Part:
    """A part of the work. number, of: which of how many equal parts of the frames are perceived."""

    config: Config
    episode: Episode
    where: Where
    number: int
    of: int
    combinations: tuple[Combination, ...] = ()


@dataclass(frozen=True)
class Judged:
    """Holds what became of an episode. Seconds as they passed."""

    outcomes: list[TrialOutcome]
    frames: int
    perceiving_s: float
    judging_s: float


def run_episode(
    config: Config, episode: Episode, combinations: Sequence[Combination], where: Where
) -> Judged:
    """Judge an episode by all combinations, whose outcomes keep their order. Shows the progress on stderr.

    Raises DriveError, AnyTraverseError, OSError.
    """
    began = time.monotonic()
    frames = perceive(config, episode, where)
    seen = time.monotonic()
    outcomes = judge(config, episode, combinations, where)
    return Judged(outcomes, frames, seen - began, time.monotonic() - seen)


def perceive(config: Config, episode: Episode, where: Where) -> int:
    """See all frames of an episode, so that they are in the cache. Return how many can be read.

    Raises DriveError where none can, and as `run_episode` does.
    """
    parts = max(1, where.processes)
    shares = [_Part(_of_a_process(config, where), episode, where, number, parts) for number in range(parts)]
    frames = sum(_spread(_perceive, shares, where, episode.opened()[0].count, "perceived"))
    if not frames:
        raise DriveError(f"{episode.where} has no frame that can be read: copy it again")
    return frames


def judge(
    config: Config, episode: Episode, combinations: Sequence[Combination], where: Where
) -> list[TrialOutcome]:
    """Judge an episode by all combinations, as `run_episode` does, without seeing all frames first."""
    parts = max(1, where.processes)
    config = _of_a_process(config, where)
    # trials of one region share its figures, so they stay together
    order = sorted(range(len(combinations)), key=lambda one: repr(combinations[one].region))
    count = parts if len(order) < _MANY else 2 * parts
    chunks = [order[len(order) * part // count : len(order) * (part + 1) // count] for part in range(count)]
    jobs = [
        _Part(config, episode, where, number, parts, tuple(combinations[one] for one in chunk))
        for number, chunk in enumerate(chunks)
        if chunk
    ]
    steps = len(jobs) * episode.opened()[0].count
    found = [one for outcomes in _spread(_judge, jobs, where, steps, "judged") for one in outcomes]
    placed = dict(zip(order, found, strict=True))
    return [placed[number] for number in range(len(combinations))]


def _of_a_process(config: Config, where: Where) -> Config:
    """Return the configuration for one of several processes, each of which has one core."""
    if where.processes <= 1 and not where.dask:
        return config
    return replace(config, perceiver=replace(config.perceiver, threads=1))


class _Figures(NamedTuple):
    """Holds figures of a drive's frames by the settings in force, one of each frame that has it."""

    seconds: float
    similarities: list[float]
    uncertainties: list[float]
    tiles: list[float]


def figures_of(config: Config, episode: Episode, where: Where) -> _Figures:
    """Judge a drive by the settings in force. Raises DriveError, AnyTraverseError, OSError."""
    part = _Part(config, episode, where, 0, 1)
    with doing(f"loading {config.perceiver.name}"):
        engine, (drive, operator) = _engine(part), episode.opened()
    found = _Figures(0.0, [], [], [])
    judge = DriveJudge(config, engine)
    trial = Trial(Combination.of(engine.settings), judge, operator)
    seconds = 0.0
    with Progress(drive.count, "frames judged by the settings in force") as progress:
        for number, frame in enumerate(drive.frames()):
            seen, seconds = trial.step(number, frame), frame.at
            progress.step()
            if seen is None:
                continue
            if seen.similarity is not None:
                found.similarities.append(seen.similarity)
            if seen.roi is not None:
                found.uncertainties.append(seen.roi.uncertainty)
                found.tiles.append(seen.roi.worst_tile.uncertainty)
    return found._replace(seconds=seconds)


def _spread(
    work: Callable[[_Part], _Result], parts: Sequence[_Part], where: Where, frames: int, what: str
) -> list[_Result]:
    """Do the parts, and show the progress: by frames, or by parts on a cluster, which tells no more."""
    whole = len(parts) if where.dask else frames
    with Progress(whole, f"{'parts' if where.dask else 'frames'} {what}") as progress:
        return spread(
            work,
            parts,
            processes=where.processes,
            dask=where.dask,
            done=lambda _number, _result: progress.step() if where.dask else None,
            ticked=progress.reach,
        )


def _engine(part: _Part) -> AnyTraverse:
    """Load the engine of the configuration, with a perceiver that asks the cache first."""
    engine, _ = load_engine(part.config, None)
    identity = maps_identity(part.config.perceiver.name, engine.perceiver)
    store = PerceptionStore(part.where.cache, identity, part.where.most)
    return AnyTraverse(StoredPerceiver(engine.perceiver, store), engine.settings, engine.memory)


def _perceive(part: _Part) -> int:
    """See a share of the frames, so that they are in the cache. Return how many frames can be read."""
    engine, (drive, _) = _engine(part), part.episode.opened()
    seen = 0
    for number, frame in enumerate(drive.frames()):
        if number % part.of != part.number or frame.image is None:
            continue
        seen += 1
        tick()
        try:
            observation = engine.observe(frame.numbered(number + 1))
            surroundings_of(engine.perceiver, observation.features)
            engine.maps_of(observation)
        except PerceiverError:
            continue  # each trial finds it a fault
    return seen


def _judge(part: _Part) -> list[TrialOutcome]:
    engine, (drive, operator) = _engine(part), part.episode.opened()
    trials = []
    for one in part.combinations:
        own = TrialEngine(engine.perceiver, one.applied(engine.settings), engine.memory)
        trials.append(Trial(one, DriveJudge(part.config, own), operator))
    return run_trials(trials, _ticking(drive.frames()))


def _ticking(frames: Iterator[DriveFrame]) -> Iterator[DriveFrame]:
    for frame in frames:
        yield frame
        tick()
