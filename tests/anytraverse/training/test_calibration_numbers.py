"""Calibration numbers from made-up outputs, and what they do to attention, scenes and taps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anytraverse.errors import ExampleError, PerceiverError
from anytraverse.frame import Image
from anytraverse.perception.builtin.network import Calibration, Floats, attention, network_size, posteriors
from anytraverse.perception.builtin.scene import SAME_PLACE, scene_vector
from anytraverse.perception.builtin.taps import learn_tap, tap_attention
from anytraverse.regions import Box
from anytraverse.training.calibration import fitted_bias, fitted_gamma, plain, tap_background
from anytraverse.training.classes import CLASSES
from anytraverse.training.folders import Folder, Labelled, Labels
from anytraverse.training.scenes import cosines, fitted_scene, scene_auroc
from anytraverse.training.scores import auroc, score

GRASS, TREE = CLASSES.index("grass"), CLASSES.index("high vegetation")


def outputs(lean: float, rng: np.random.Generator) -> list[tuple[Floats, Labels]]:
    """Logits that know grass from trees, with grass held back by `lean`."""
    made = []
    for _ in range(30):
        labels = np.where(np.arange(24)[:, None] < 12, TREE, GRASS).astype(np.uint8).repeat(32, axis=1)
        logits = rng.normal(0, 0.7, (len(CLASSES), 24, 32)).astype(np.float32)
        logits[GRASS][labels == GRASS] += 4
        logits[TREE][labels == TREE] += 4
        logits[GRASS] -= lean
        made.append((logits, labels))
    return made


def test_a_bias_gives_back_what_the_training_held_back() -> None:
    results = outputs(1.5, np.random.default_rng(0))
    bias = fitted_bias(results, plain())
    assert bias[GRASS] > 0
    assert score(results, replace(plain(), bias=bias)).iou >= score(results, plain()).iou


def test_gamma_leaves_only_the_allowed_share_of_ground_unexplained() -> None:
    results = outputs(0.0, np.random.default_rng(1))
    for allowed in (0.02, 0.1):
        gamma = fitted_gamma(results, plain(), allowed)
        found = score(results, replace(plain(), gamma=gamma))
        assert found.unexplained == pytest.approx(allowed, abs=0.015)


def test_what_no_asked_word_means_stays_uncertain() -> None:
    logits = np.zeros((len(CLASSES), 1, 2), np.float32)
    logits[GRASS, 0, 0] = 9
    logits[-1, 0, 1] = 9
    words = np.eye(len(CLASSES), dtype=np.float32)[[GRASS, TREE]]
    probabilities = posteriors(logits, plain())
    found = attention(probabilities, words, words, gamma=5.0)
    assert found[0, 0, 0] > 0.95
    assert found[:, 0, 1].max() < 0.05
    twice = attention(probabilities, np.vstack([words, words]), np.vstack([words, words]), gamma=5.0)
    assert twice[:2] == pytest.approx(found)  # a synonym explains nothing twice
    assert attention(probabilities, words[:0], words[:0], 5.0).shape == (0, 1, 2)


def test_ground_between_two_names_is_as_known_as_the_one_asked_for_is_likely() -> None:
    grass, tree, strange = np.array([0.6, 0.4, 0.0]), np.array([0.4, 0.6, 0.0]), np.array([0.6, 0.1, 0.3])
    probabilities = np.zeros((len(CLASSES), 1, 3), np.float32)
    probabilities[[GRASS, TREE, -1], 0] = np.stack([grass, tree, strange], axis=1)
    eye = np.eye(len(CLASSES), dtype=np.float32)
    alone = attention(probabilities, eye[[GRASS]], eye[[GRASS]], 10.0, unknown=len(CLASSES) - 1)[0, 0]
    assert alone == pytest.approx([0.6, 0.4, 0.7**10 * 0.6 / 0.7], abs=1e-6)
    for words in (eye[:-1], eye):
        by_all = attention(probabilities, words, words, 10.0, unknown=len(CLASSES) - 1)
        assert by_all == pytest.approx(attention(probabilities, words, words, 10.0), abs=1e-6)


def test_ranks_count_ties_as_half() -> None:
    assert auroc(np.array([0.1, 0.9, 0.5, 0.5], np.float32), np.array([False, True, True, False])) == 0.875
    assert np.isnan(auroc(np.ones(3, np.float32), np.ones(3, bool)))


def test_common_cameras_are_hardly_stretched() -> None:
    for width, height in ((640, 480), (640, 340), (1280, 720), (1920, 1200), (688, 550), (2026, 620)):
        wide, high = network_size(width, height)
        assert wide % 16 == 0
        assert high % 16 == 0
        assert abs((wide / high) / (width / height) - 1) < 0.07
    assert network_size(10, 1000) == (256, 256)


def frames(count: int, rng: np.random.Generator) -> Folder:
    """Places of one colour each, in blocks of their own."""
    made = []
    for number in range(count):
        colour = rng.uniform(40, 160, (2, 1, 3)).repeat(20, axis=0)
        image = np.broadcast_to(colour, (40, 64, 3)) + rng.normal(0, 3, (40, 64, 3))
        made.append(Labelled(100 * number, image.clip(0, 255).astype(np.uint8), np.zeros((40, 64), np.uint8)))
    return Folder(tuple(made))


def painted(image: Image) -> tuple[Floats, Floats]:
    """A network whose 32 features are cosines of the colours."""
    small = image[::4, ::4].astype(np.float32)
    turns = np.random.default_rng(9).normal(0, 0.02, (32, 3)).astype(np.float32)
    return np.zeros((8, *small.shape[:2]), np.float32), np.cos(np.einsum("fc,hwc->fhw", turns, small))


def test_scenes_pass_at_the_papers_threshold() -> None:
    rng = np.random.default_rng(2)
    calibration = fitted_scene(painted, frames(60, rng), Folder(()), frames(30, rng), plain())
    same, other = cosines(painted, frames(30, rng), Folder(()), calibration, rng)
    assert scene_auroc(same, other) > 0.9
    first, second = (painted(frame.image)[1] for frame in frames(2, rng).frames)
    a, b = scene_vector(first, calibration), scene_vector(second, calibration)
    assert np.linalg.norm(a) == pytest.approx(1, abs=1e-5)
    plainly = replace(calibration, scene_threshold=SAME_PLACE)
    cosine = float(scene_vector(first, plainly) @ scene_vector(second, plainly))
    assert (a @ b >= SAME_PLACE) == (cosine >= calibration.scene_threshold)


def test_a_tap_finds_its_thing_and_not_the_background() -> None:
    rng = np.random.default_rng(3)
    mean, whitening = np.zeros(37, np.float32), np.eye(37, dtype=np.float32)
    calibration = replace(plain(), tap_mean=mean, tap_whitening=whitening)
    thing = rng.normal(0, 3, 37)
    views = [rng.normal(0, 1, (20, 30, 37)).astype(np.float32) for _ in range(6)]
    for cells in views:
        cells[8:14, 10:16] += thing
    example = learn_tap(views, Box(10 / 30, 8 / 20, 16 / 30, 14 / 20), calibration)
    found = tap_attention(views[0], [example], calibration)
    assert found[9:13, 11:15].min() > 0.5
    assert np.median(found) < 0.05
    with pytest.raises(ExampleError, match="too small"):
        learn_tap(views, Box(0.5, 0.5, 0.51, 0.51), calibration)


def test_the_background_of_taps_is_whitened() -> None:
    mean, whitening = tap_background(painted, frames(12, np.random.default_rng(4)))
    assert mean.shape == (37,)
    assert whitening.shape == (37, 37)
    assert np.isfinite(whitening).all()


def test_a_calibration_survives_its_file_and_a_torn_one_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "builtin.npz"
    replace(plain(), gamma=4.5).save(path)
    read = Calibration.load(path)
    assert read.gamma == 4.5
    assert read.classes == CLASSES
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(PerceiverError, match="install it again"):
        Calibration.load(path)
    replace(plain(), gamma=float("nan")).save(path)
    with pytest.raises(PerceiverError, match="not finite"):
        Calibration.load(path)
