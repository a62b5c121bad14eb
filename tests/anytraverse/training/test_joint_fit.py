"""Bias, limits and tile fitted together: what a choice keeps, and that a drive left out has no say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anytraverse.perception.builtin.network import Outputs
from anytraverse.training.calibration import plain
from anytraverse.training.classes import CLASSES, DRIVABLE
from anytraverse.training.folders import Folder, read_folder
from anytraverse.training.joint import BIASES, FACTORS, TILES, Outcomes, judged
from anytraverse.training.scores import score
from anytraverse.training.things import noticed, seen
from tests.anytraverse.training.made_outputs import by_colour

GRASS = CLASSES.index("grass")


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer things and points, so that the tests are fast."""
    monkeypatch.setattr("anytraverse.training.things.THINGS", 24)
    monkeypatch.setattr("anytraverse.training.joint.FACTORS", (0.5, 1.0))
    monkeypatch.setattr("anytraverse.training.joint.BIASES", (-0.5, 0.0, 0.5))


def table(iou: list[float], stops: list[int], noticed_share: list[float], bias: list[float]) -> Outcomes:
    """Rows with these figures on each of two drives of 100 frames and 100 things, and one tile threshold."""
    count = len(iou)
    rows = tuple(replace(plain(), bias=np.full(len(CLASSES), b, np.float32)) for b in bias)
    frames, ranks = np.repeat([0, 1], 100), np.tile(np.arange(100), 2)
    stopped = np.array([[rank < stop for rank in ranks] for stop in stops])
    values = np.array([[float(rank < 100 * share) for rank in ranks] for share in noticed_share])
    ones, yes = np.ones((count, 200)), np.ones(200, np.bool_)
    return Outcomes(
        rows, (0.5,), ones * np.array(iou)[:, None], ones, stopped.astype(float), stopped & False,
        yes, yes, frames, values, frames,
    )  # fmt: skip


def test_the_choice_notices_enough_and_weighs_ground_against_false_stops() -> None:
    made = table([0.80, 0.85, 0.90], [2, 4, 20], [0.97, 0.96, 0.90], [0.0, 0.0, 0.0])
    assert made.choose(0.95) == (1, 0)
    assert made.choose(0.97) == (0, 0)
    assert made.choose(0.99) == (0, 0)  # none notices so many: as many as any
    assert table([0.80, 0.95], [2, 2], [0.97, 0.80], [0.0, 0.0]).choose(0.5) == (1, 0)


def test_a_bias_that_helps_by_luck_only_is_not_taken() -> None:
    assert table([0.800, 0.803], [2, 2], [0.96, 0.97], [0.0, 0.25]).choose(0.95) == (0, 0)
    assert table([0.800, 0.820], [2, 2], [0.96, 0.97], [0.0, 0.25]).choose(0.95) == (1, 0)


def test_a_drive_that_is_left_out_has_no_say_and_is_reported() -> None:
    made = table([0.80, 0.70], [0, 0], [1.0, 1.0], [0.0, 0.0])
    own = made.drives == 1
    made.overlap[0, own], made.overlap[1, own] = 0.1, 0.9
    assert made.choose(0.9) == (1, 0)
    assert made.choose(0.9, without=1) == (0, 0)
    left = made.left_out(0.9)
    assert left[1].overlap / left[1].union == pytest.approx(0.1)
    assert left[0].overlap / left[0].union == pytest.approx(0.70)
    assert made.frontier()[0.9].as_json() == {
        "iou": 0.4, "stopped": 0, "clean": 200, "noticed": 200, "things": 200,
    }  # fmt: skip


def test_the_grid_is_judged_as_the_network_is_scored(tiny_folder: Path) -> None:
    folder = read_folder(tiny_folder).of([1, 2])
    start = replace(plain(), limits=np.array([0.2, 1e6], np.float32), tile=0.6)
    found = judged(by_colour, folder, start)
    assert len(found.rows) == 3 * 2 + 1
    assert found.rows[-1] is start
    assert found.tiles == (*TILES, 0.6)
    assert set(found.drives) == set(found.of) == {1, 2}
    at = len(found.rows) - 1, len(found.tiles) - 1
    both = found.outcome(at, 1) + found.outcome(at, 2)
    results = [(by_colour(frame.image), frame.labels[::2, ::2]) for frame in folder.frames]
    assert both.overlap / both.union == pytest.approx(score(results, start).iou, abs=0.01)
    things = [thing for block in (1, 2) for thing in seen(by_colour, folder.of([block]), 9, (), 2)]
    assert both.noticed == sum(noticed(thing, start) for thing in things)
    assert both.things == len(things) == 24


def test_one_drive_alone_is_split_so_that_a_half_can_be_left_out(tiny_folder: Path) -> None:
    found = judged(by_colour, read_folder(tiny_folder).of([1]), plain())
    assert set(found.left_out(0.9)) == {0, 1}


def test_ground_that_the_network_holds_back_is_given_back_by_the_bias(tiny_folder: Path) -> None:
    def holding_back(image: np.ndarray) -> Outputs:
        made = by_colour(image)
        logits = made.logits.copy()
        logits[list(DRIVABLE)] = logits[list(DRIVABLE)].max(axis=0) - 0.2
        logits[CLASSES.index("low vegetation")] = logits[GRASS] + np.float32(np.log(3) + 0.2)
        return made._replace(logits=logits)

    folder: Folder = read_folder(tiny_folder).of([1, 2])
    found = judged(holding_back, folder, plain())
    assert found.calibration(found.choose(0.0)).bias[GRASS] > 0
    assert 0.0 in BIASES
    assert 1.0 in FACTORS
