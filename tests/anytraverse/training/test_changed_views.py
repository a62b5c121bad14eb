"""Augmentation: labels follow the picture, and pasted things are labelled unknown."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from anytraverse.training.augment import changed, moved, relit
from anytraverse.training.beds import paste_puddle, paste_stones, strew
from anytraverse.training.classes import CLASSES, UNKNOWN, UNLABELLED
from anytraverse.training.unknowns import move_patches, paste_unknowns

Painter = Callable[[np.ndarray, np.ndarray, np.random.Generator], None]


def blocks() -> tuple[np.ndarray, np.ndarray]:
    """A picture whose grey level is its label, times 40."""
    labels = np.repeat(np.repeat(np.arange(6, dtype=np.uint8).reshape(2, 3), 50, axis=0), 50, axis=1)
    return np.repeat(labels[..., None] * 40, 3, axis=2), labels


@pytest.mark.parametrize("seed", range(12))
def test_labels_stay_with_what_they_name(seed: int) -> None:
    image, labels = blocks()
    picture, names = moved(image, labels, (128, 80), np.random.default_rng(seed))
    assert picture.shape == (80, 128, 3)
    assert names.shape == (80, 128)
    inside = names != UNLABELLED
    assert inside.mean() > 0.6
    agree = np.abs(picture[inside][:, 0].astype(int) - 40 * names[inside].astype(int)) <= 20
    assert agree.mean() > 0.97  # all but the seams between labels


def test_another_light_moves_nothing() -> None:
    image, _ = blocks()
    edges = np.abs(np.diff(image[..., 0].astype(int), axis=1)).max(axis=0) > 20
    lit = [relit(image, np.random.default_rng(seed)) for seed in range(60)]
    mean = np.mean([one.astype(float).mean(axis=2) for one in lit], axis=0)
    found = np.abs(np.diff(mean, axis=1)).max(axis=0)
    assert found[edges].min() > 2 * np.median(found[~edges])


def test_pasted_things_are_unknown_and_leave_the_rest_alone() -> None:
    image, labels = blocks()
    pasted = 0
    for seed in range(20):
        picture, names = paste_unknowns(image, labels, np.random.default_rng(seed))
        thing = names == UNKNOWN
        pasted += int(thing.any())
        kept = ~thing & (names != UNLABELLED)
        assert (names[kept] == labels[kept]).all()
        assert picture.shape == image.shape
    assert pasted >= 18


def test_some_things_cross_the_whole_view() -> None:
    image, labels = blocks()
    crossing = 0
    for seed in range(60):
        thing = paste_unknowns(image, labels, np.random.default_rng(seed))[1] == UNKNOWN
        crossing += int((thing.any(axis=0).all()) and thing.mean() < 0.5)
    assert 6 <= crossing <= 40


def test_moved_patches_keep_their_labels() -> None:
    image, labels = blocks()
    moved_some = 0
    for seed in range(20):
        picture, names = move_patches(image, labels, np.random.default_rng(seed))
        moved_some += int((names != labels).any())
        agree = np.abs(picture[..., 0].astype(int) - 40 * names.astype(int)) <= 20
        assert agree.mean() > 0.97
    assert moved_some > 5


def trail() -> tuple[np.ndarray, np.ndarray]:
    """Grey trail below plants, and sky at the top."""
    labels = np.full((120, 160), CLASSES.index("smooth trail"), dtype=np.uint8)
    labels[:50], labels[:20] = CLASSES.index("low vegetation"), CLASSES.index("sky")
    grey = np.array([120, 0, 0, 60, 0, 230], dtype=np.uint8)[labels]
    return np.repeat(grey[..., None], 3, axis=2), labels


@pytest.mark.parametrize(("paint", "name"), [(paste_stones, "unknown"), (paste_puddle, "water")])
def test_a_painted_bed_changes_the_picture_where_it_changes_the_labels(paint: Painter, name: str) -> None:
    found = 0
    for seed in range(20):
        (picture, names), (before, labels) = trail(), trail()
        paint(picture, names, np.random.default_rng(seed))
        other = names != labels
        assert set(names[other]) <= {CLASSES.index(name)}
        painted = (picture != before).any(axis=2)
        assert not painted[:15].any()  # nothing lies in the sky
        found += int(other.any())
        assert not other.any() or painted[other].mean() > 0.5
    assert found >= 10


def test_what_is_strewn_on_the_trail_leaves_it_drivable() -> None:
    changed_some, kept = 0, {CLASSES.index("smooth trail"), CLASSES.index("grass")}
    for seed in range(20):
        (picture, names), (before, labels) = trail(), trail()
        strew(picture, names, np.random.default_rng(seed))
        assert set(names[labels == CLASSES.index("smooth trail")]) <= kept
        assert (names[labels == CLASSES.index("sky")] == CLASSES.index("sky")).all()
        changed_some += int((picture != before)[labels == 0].any())
    assert changed_some >= 15


def test_views_repeat_by_seed() -> None:
    image, labels = blocks()
    first = changed(image, labels, (64, 48), np.random.default_rng(5))
    again = changed(image, labels, (64, 48), np.random.default_rng(5))
    other = changed(image, labels, (64, 48), np.random.default_rng(6))
    assert (first[0] == again[0]).all()
    assert (first[1] == again[1]).all()
    assert (first[0] != other[0]).any()
