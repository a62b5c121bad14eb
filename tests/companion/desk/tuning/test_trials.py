"""A drive judged by many combinations at once is judged as by each alone."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

from anytraverse import engine as engine_module
from anytraverse.engine import AnyTraverse
from anytraverse.evaluation import spreading
from anytraverse.evaluation.spreading import SpreadError, spread
from anytraverse.frame import Image
from anytraverse.light import Light, measure_light
from anytraverse.regions import Box
from companion.config import Config, load_config
from companion.desk.drives.judge import DriveJudge
from companion.desk.tuning.episode import Episode
from companion.desk.tuning.running import Judged, Where, figures_of, perceive, run_episode
from companion.desk.tuning.trial import Combination, MadeCall, Trial, TrialOutcome
from companion.vision.warm_up import load_engine
from companion.wire.typed_answers import read_typed

ANSWERS = (
    (0.4, read_typed("dry grass: 0.4, go")),
    (1.0, read_typed("tap rock -1, go")),
    (1.6, read_typed("tap trunk -1 0.4 0.5 0.6 0.8; gravel: 1")),
    (1.6, read_typed("forget bush, go")),
    (2.2, read_typed("stay")),
)


def of_random(count: int, seed: int) -> list[Combination]:
    rng = random.Random(seed)
    regions = [Box(0.35, 0.46, 0.65, 0.95), Box(0.3, 0.55, 0.7, 0.9), Box(0.4, 0.4, 0.6, 1.0)]
    return [
        Combination(
            rng.uniform(0.6, 0.98),
            rng.uniform(0.05, 0.6),
            rng.choice([None, rng.uniform(0.3, 0.95)]),
            rng.choice(regions),
            misfit_allowed=True,
        )
        for _ in range(count)
    ]


def alone(engine: AnyTraverse, config: Config, episode: Episode, combination: Combination) -> TrialOutcome:
    """Judge the drive by a rover's own engine, without a cache and without other trials."""
    whole = AnyTraverse(engine.perceiver, combination.applied(engine.settings), engine.memory)
    drive, operator = episode.opened()
    trial = Trial(combination, DriveJudge(config, whole), operator)
    for number, frame in enumerate(drive.frames()):
        trial.step(number, frame)
    return trial.outcome


@pytest.mark.slow
@pytest.mark.parametrize(("who", "count"), [("answers", 20), ("go", 5), ("labels", 5)])
def test_random_combinations_are_those_of_a_full_run(
    drive: Path, tmp_path: Path, who: str, count: int
) -> None:
    config = load_config(drive.parent / "companion.toml")
    episode = {
        "go": Episode(str(drive), 10.0),
        "answers": Episode(str(drive), 10.0, ANSWERS),
        "labels": Episode(f"folder:{drive}", 10.0, drivable=("gravel",)),
    }[who]
    combinations = of_random(count, seed=len(who))
    judged = run_episode(config, episode, combinations, Where(tmp_path, 10**9))
    engine, _ = load_engine(config, None)
    outcomes = [alone(engine, config, episode, one) for one in combinations]
    assert judged.outcomes == outcomes
    assert judged.frames == 16
    calls = {len(one.calls) for one in outcomes}
    assert len(calls) > 1, "the combinations tell nothing apart"


@pytest.mark.slow
def test_the_light_of_a_frame_is_measured_once_for_all_combinations(
    drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured = list[int]()

    def measure(picture: Image) -> Light:
        measured.append(id(picture))
        return measure_light(picture)

    monkeypatch.setattr(engine_module, "measure_light", measure)
    config = load_config(drive.parent / "companion.toml")
    run_episode(config, Episode(str(drive), 10.0), of_random(3, seed=1), Where(tmp_path, 10**9))
    assert len(measured) == 16


@pytest.mark.slow
def test_what_was_perceived_is_all_that_judging_asks_for(drive: Path, tmp_path: Path) -> None:
    config = load_config(drive.parent / "companion.toml")
    episode, where = Episode(str(drive), 10.0), Where(tmp_path, 10**9)
    perceive(config, episode, where)
    stored = sorted(tmp_path.rglob("*.npy"))
    assert figures_of(config, episode, where).tiles
    assert sorted(tmp_path.rglob("*.npy")) == stored


@pytest.mark.slow
def test_processes_and_a_second_run_give_the_same(drive: Path, tmp_path: Path) -> None:
    config = load_config(drive.parent / "companion.toml")
    episode, combinations = Episode(str(drive), 10.0, ANSWERS), of_random(5, seed=1)

    def ran(processes: int) -> Judged:
        return run_episode(config, episode, combinations, Where(tmp_path, 10**9, processes))

    assert ran(2).outcomes == ran(1).outcomes


def test_an_answer_that_is_refused_is_told_and_the_call_gets_a_go(drive: Path, tmp_path: Path) -> None:
    config = load_config(drive.parent / "companion.toml")
    answers = tuple((0.1 * at, read_typed("no such word at all: 1, go")) for at in range(30))
    episode = Episode(str(drive), 10.0, answers)
    combination = Combination(0.97, 0.1, 0.4, Box(0.35, 0.46, 0.65, 0.95))
    (outcome,) = run_episode(config, episode, [combination], Where(tmp_path, 10**9)).outcomes
    assert len(outcome.refused) == len(outcome.calls) > 1
    assert "no such word" in outcome.refused[0]


def test_calls_are_told_by_frame_time_and_reason(drive: Path, tmp_path: Path) -> None:
    config = load_config(drive.parent / "companion.toml")
    strict = Combination(0.6, 0.01, None, Box(0.35, 0.46, 0.65, 0.95))
    (outcome,) = run_episode(config, Episode(str(drive), 10.0), [strict], Where(tmp_path, 10**9)).outcomes
    first = outcome.calls[0]
    assert first == MadeCall(1, 0.2, ("unknown_object",))  # 2 of 3 frames are bad


def square(number: int) -> int:
    if number == 3:
        raise SpreadError("three is refused")
    return number * number


@pytest.mark.slow
@pytest.mark.parametrize("processes", [1, 2])
def test_results_come_in_the_order_of_the_jobs_and_are_told_as_they_come(processes: int) -> None:
    told: dict[int, Any] = {}
    assert spread(square, [5, 1, 2], processes=processes, done=told.__setitem__) == [25, 1, 4]
    assert told == {0: 25, 1: 1, 2: 4}
    with pytest.raises(SpreadError, match="three is refused"):
        spread(square, [1, 3], processes=processes, done=told.__setitem__)


def test_a_scheduler_that_is_not_there_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(spreading, "_CONNECT_S", 0.2)
    with pytest.raises(SpreadError, match="no Dask scheduler answers"):
        spread(square, [1], dask="tcp://127.0.0.1:1", done=lambda _number, _result: None)
