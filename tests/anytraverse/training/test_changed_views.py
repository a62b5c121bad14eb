"""Augmentation: labels follow the picture, and pasted things are labelled unknown."""

from __future__ import annotations

import numpy as np
import pytest

from anytraverse.training.augment import changed, moved, relit
from anytraverse.training.classes import UNKNOWN, UNLABELLED
from anytraverse.training.unknowns import move_patches, paste_unknowns


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


def test_moved_patches_keep_their_labels() -> None:
    image, labels = blocks()
    moved_some = 0
    for seed in range(20):
        picture, names = move_patches(image, labels, np.random.default_rng(seed))
        moved_some += int((names != labels).any())
        agree = np.abs(picture[..., 0].astype(int) - 40 * names.astype(int)) <= 20
        assert agree.mean() > 0.97
    assert moved_some > 5


def test_views_repeat_by_seed() -> None:
    image, labels = blocks()
    first = changed(image, labels, (64, 48), np.random.default_rng(5))
    again = changed(image, labels, (64, 48), np.random.default_rng(5))
    other = changed(image, labels, (64, 48), np.random.default_rng(6))
    assert (first[0] == again[0]).all()
    assert (first[1] == again[1]).all()
    assert (first[0] != other[0]).any()
