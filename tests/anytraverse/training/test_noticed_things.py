"""Things pasted where a rover would drive: which of them it would notice, and how many a fit must keep."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.judging import Settings
from anytraverse.training.calibration import plain
from anytraverse.training.classes import CLASSES, DRIVABLE
from anytraverse.training.folders import Folder, Labelled, read_folder
from anytraverse.training.joint import recalibrated
from anytraverse.training.things import ENOUGH, LEAST, ThingOutputs, noticed, pasted, recall, seen
from tests.anytraverse.training.made_outputs import by_colour, made

LARGE = 0.25, 0.65
"""A tile's side over the ROI's width, and its threshold."""
SMALL = 0.08, 0.9


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer things, so that the tests are fast."""
    monkeypatch.setattr("anytraverse.training.things.THINGS", 24)


def test_things_stand_on_the_ground_that_would_be_driven_and_repeat_by_seed(tiny_folder: Path) -> None:
    folder = read_folder(tiny_folder)
    region = Settings().region.bounds
    things = list(pasted(folder, 1))
    assert len(things) > 20
    for (image, where), frame in zip(things, folder.frames, strict=False):
        changed = (image != frame.image).any(axis=2)
        assert changed[where].mean() > 0.9
        assert where[Settings().region.mask(*where.shape)].mean() >= LEAST
        foot = int(np.flatnonzero(where.any(axis=1))[-1])
        assert foot >= (region.top - 0.1) * len(where)  # a round thing ends above its foot
    again, other = list(pasted(folder, 1)), list(pasted(folder, 2))
    assert all((a[0] == b[0]).all() for a, b in zip(things, again, strict=True))
    assert any((a[0] != b[0]).any() for a, b in zip(things, other, strict=False))


def test_photographs_of_things_are_half_of_them(tiny_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("anytraverse.training.things.LEAST", 0.0)
    folder = read_folder(tiny_folder).of([0])
    vivid = np.full((20, 20, 4), 255, np.uint8)
    plain_ones, photographs = list(pasted(folder, 1)), list(pasted(folder, 1, [vivid]))
    same = [(a[0] == b[0]).all() for a, b in zip(plain_ones, photographs, strict=False)]
    assert all(same[: len(folder)])
    assert not any(same[len(folder) : 2 * len(folder)])


def test_where_nothing_is_drivable_nothing_is_pasted() -> None:
    sky = np.full((64, 96), CLASSES.index("sky"), np.uint8)
    folder = Folder((Labelled(0, np.zeros((64, 96, 3), np.uint8), sky),))
    assert list(pasted(folder, 0)) == []
    assert np.isnan(recall([], plain()))


def scene_with(side: int) -> ThingOutputs:
    """Surely trail, with a square of surely unknown in the middle."""
    logits = np.full((len(CLASSES), 48, 64), -9.0, np.float32)
    logits[0] = 9.0
    where = np.zeros((48, 64), np.bool_)
    where[36 - side : 36, 32 : 32 + side] = True
    logits[:, where] = -9.0
    logits[-1, where] = 9.0
    return ThingOutputs(made(logits), where, 4 / 3)


@pytest.mark.parametrize(("side", "large", "small"), [(1, False, False), (2, False, True), (8, True, True)])
def test_a_thing_is_noticed_when_a_tile_on_it_is_over_the_threshold(
    side: int, large: bool, small: bool
) -> None:
    calibration = replace(plain(), limits=np.array([0.1, 1e6], np.float32))
    thing = scene_with(side)
    for (share, tile), expected in ((LARGE, large), (SMALL, small)):
        assert noticed(thing, replace(calibration, tile=tile), share) == expected


def test_a_thing_that_is_explained_away_is_not_noticed() -> None:
    assert recall([scene_with(8)], plain()) == 0.0


@settings(max_examples=20)
@given(
    factor=st.floats(0.1, 1.0), limit=st.floats(0.05, 0.9), level=st.floats(-3.0, 6.0), size=st.integers(1, 9)
)
def test_lower_limits_never_notice_less(factor: float, limit: float, level: float, size: int) -> None:
    thing = scene_with(size)
    thing.outputs.logits[-1, thing.where] = level
    higher = replace(plain(), limits=np.array([limit, 1.0], np.float32))
    lower = replace(higher, limits=higher.limits * np.float32(factor))
    assert recall([thing], lower) >= recall([thing], higher)


def test_a_fit_keeps_what_was_noticed_where_ground_looks_strange(
    tiny_folder: Path,
) -> None:
    frames = []
    rng = np.random.default_rng(5)
    for frame in read_folder(tiny_folder).frames[:10]:
        image = frame.image.copy()
        top, left = int(rng.integers(40, 56)), int(rng.integers(0, 80))
        image[top : top + 8, left : left + 16] = (230, 30, 200)
        frames.append(Labelled(frame.number, image, frame.labels))
    folder = Folder(tuple(frames))
    assert all(np.isin(frame.labels[40:], DRIVABLE).all() for frame in frames)
    start = replace(plain(), limits=np.array([0.05, 1e6], np.float32))
    kept = recalibrated(by_colour, folder, start)
    others = seen(by_colour, folder, 4)
    assert recall(others, kept) > ENOUGH - 0.1
