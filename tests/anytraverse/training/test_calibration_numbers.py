"""Calibration numbers from made-up outputs, and what they do to attention, scenes and taps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.errors import ExampleError, PerceiverError
from anytraverse.frame import Image
from anytraverse.perception.builtin.attention import distance, posteriors, strangeness
from anytraverse.perception.builtin.calibration import Calibration, Floats
from anytraverse.perception.builtin.network import Outputs, network_size
from anytraverse.perception.builtin.scene import SAME_PLACE, scene_vector
from anytraverse.perception.builtin.taps import learn_tap, likeness, whitened
from anytraverse.regions import Box
from anytraverse.training.calibration import (
    fitted_distances,
    plain,
    tap_background,
)
from anytraverse.training.classes import CLASSES, UNKNOWN
from anytraverse.training.folders import Folder, Labelled
from anytraverse.training.scenes import cosines, fitted_scene, scene_auroc
from anytraverse.training.scores import auroc
from anytraverse.training.widths import FEATURES, MIDDLE, SCALES
from tests.anytraverse.training.made_outputs import made

GRASS, TREE = CLASSES.index("grass"), CLASSES.index("high vegetation")
TAPS = len(plain().tap_mean)


def test_what_is_at_half_of_both_limits_or_at_one_of_them_is_half_strange() -> None:
    calibration = replace(plain(), limits=np.array([0.2, 3.0], np.float32))
    thing = np.array([[0.0, 0.2, 0.4, 0.0, 0.9]], np.float32)
    far = np.array([[0.0, 3.0, 0.0, 6.0, 9.0]], np.float32)
    assert strangeness(thing, far, calibration)[0] == pytest.approx([0, 0.5, 0.5, 0.5, 1], abs=0.01)


@settings(max_examples=40)
@given(seed=st.integers(0, 10_000), limits=st.tuples(st.floats(0.01, 1), st.floats(0.1, 9)))
def test_posteriors_are_probabilities_of_which_strangeness_leaves_the_rest_to_the_names(
    seed: int, limits: tuple[float, float]
) -> None:
    rng = np.random.default_rng(seed)
    seen = made(
        rng.normal(0, 4, (len(CLASSES), 8, 8)).astype(np.float32),
        eighth=rng.normal(0, 3, (SCALES[8], 4, 4)).astype(np.float32),
    )
    calibration = replace(plain(), limits=np.array(limits, np.float32))
    found = posteriors(seen, calibration)
    assert found.min() >= 0
    assert found.sum(axis=0) == pytest.approx(np.ones((8, 8)), abs=1e-4)
    named = np.exp(seen.logits[:UNKNOWN] - seen.logits.max(axis=0))
    surely = found[:UNKNOWN] > 1e-3
    ratio = found[:UNKNOWN] / np.maximum(1 - found[UNKNOWN], 1e-6)
    assert ratio[surely] == pytest.approx((named / named.sum(axis=0))[surely], abs=1e-2)


def test_the_distance_is_to_the_nearest_class_in_units_of_its_spread() -> None:
    rng = np.random.default_rng(6)
    middles = {GRASS: 3.0, TREE: -3.0}

    def network(image: Image) -> Outputs:
        labels = image[::8, ::8, 0]
        centre = np.zeros(labels.shape)
        for name, middle in middles.items():
            centre[labels == name] = middle
        eighth = 2 * (centre + rng.normal(0, 0.5, (SCALES[8], *labels.shape)))
        sixteenth = rng.normal(0, 1, (SCALES[16], *(max(1, side // 2) for side in labels.shape)))
        rows, columns = (2 * side for side in labels.shape)
        logits = np.zeros((len(CLASSES), rows, columns), np.float32)
        return made(logits, eighth=eighth.astype(np.float32), sixteenth=sixteenth.astype(np.float32))

    def frame(number: int, name: int) -> Labelled:
        labels = np.full((256, 256), name, np.uint8)
        return Labelled(number, labels[..., None].repeat(3, axis=2), labels)

    folder = Folder((frame(0, GRASS), frame(1, TREE), frame(2, GRASS), frame(3, TREE)))
    plainly = replace(plain(), limits=np.array([1, 1], np.float32))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("anytraverse.training.calibration.cast", lambda image, _: image)
        fitted = fitted_distances(network, folder, plainly, 0)
    assert fitted.distance_centres.shape == (2, MIDDLE)
    known = float(np.median(distance(network(folder.frames[0].image), fitted)))
    assert known == pytest.approx(1.0, abs=0.25)
    middles[0] = 30.0
    strange = distance(network(np.zeros((256, 256, 3), np.uint8)), fitted)
    assert float(np.median(strange)) > 3


def test_ranks_count_ties_as_half() -> None:
    assert auroc(np.array([0.1, 0.9, 0.5, 0.5], np.float32), np.array([False, True, True, False])) == 0.875
    assert np.isnan(auroc(np.ones(3, np.float32), np.ones(3, bool)))


def test_common_cameras_are_hardly_stretched() -> None:
    for width, height in ((640, 480), (640, 340), (1280, 720), (1920, 1200), (688, 550), (2026, 620)):
        wide, high = network_size(width, height)
        assert wide % 32 == 0
        assert high % 32 == 0
        assert abs((width / height) / (wide / high) - 1) < 0.115
    assert network_size(10, 1000) == (256, 256)


def frames(count: int, rng: np.random.Generator) -> Folder:
    """Places of one colour each, in blocks of their own."""
    made = []
    for number in range(count):
        colour = rng.uniform(40, 160, (2, 1, 3)).repeat(20, axis=0)
        image = np.broadcast_to(colour, (40, 64, 3)) + rng.normal(0, 3, (40, 64, 3))
        made.append(Labelled(100 * number, image.clip(0, 255).astype(np.uint8), np.zeros((40, 64), np.uint8)))
    return Folder(tuple(made))


def painted(image: Image) -> Outputs:
    """A network whose features are cosines of the colours."""
    rng = np.random.default_rng(9)

    def waves(channels: int, step: int) -> Floats:
        small = image[::step, ::step].astype(np.float32)
        turns = rng.normal(0, 0.02, (channels, 3)).astype(np.float32)
        return np.asarray(np.cos(np.einsum("fc,hwc->fhw", turns, small)), dtype=np.float32)

    logits = np.zeros((len(CLASSES), *image[::4, ::4].shape[:2]), np.float32)
    return made(logits, waves(FEATURES, 4), waves(SCALES[8], 8), waves(SCALES[16], 16))


def test_scenes_pass_at_the_papers_threshold() -> None:
    rng = np.random.default_rng(2)
    calibration = fitted_scene(painted, frames(60, rng), Folder(()), frames(30, rng), plain())
    same, other = cosines(painted, frames(30, rng), Folder(()), calibration, rng)
    assert scene_auroc(same, other) > 0.9
    first, second = (painted(frame.image) for frame in frames(2, rng).frames)
    a, b = scene_vector(first, calibration), scene_vector(second, calibration)
    assert np.linalg.norm(a) == pytest.approx(1, abs=1e-5)
    plainly = replace(calibration, scene_threshold=SAME_PLACE)
    cosine = float(scene_vector(first, plainly) @ scene_vector(second, plainly))
    assert (a @ b >= SAME_PLACE) == (cosine >= calibration.scene_threshold)


def test_a_tap_finds_its_thing_and_not_the_background() -> None:
    rng = np.random.default_rng(3)
    calibration = plain()
    thing = rng.normal(0, 3, TAPS)
    views = [rng.normal(0, 1, (20, 30, TAPS)).astype(np.float32) for _ in range(6)]
    for cells in views:
        cells[8:14, 10:16] += thing
    example = learn_tap(views, Box(10 / 30, 8 / 20, 16 / 30, 14 / 20), calibration)
    found = likeness(whitened(views[0], calibration), example)
    assert found[9:13, 11:15].min() > 0.5
    assert np.median(found) < 0.05
    with pytest.raises(ExampleError, match="too small"):
        learn_tap(views, Box(0.5, 0.5, 0.51, 0.51), calibration)


def test_the_background_of_taps_is_whitened() -> None:
    mean, whitening = tap_background(painted, frames(12, np.random.default_rng(4)))
    assert mean.shape == (TAPS,)
    assert whitening.shape == (TAPS, TAPS)
    assert np.isfinite(whitening).all()


def test_a_calibration_survives_its_file_and_a_torn_one_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "builtin.npz"
    replace(plain(), limits=np.array([0.25, 2.0], np.float32), slope=4.5).save(path)
    read = Calibration.load(path)
    assert read.limits.tolist() == [0.25, 2.0]
    assert read.slope == 4.5
    assert read.classes == CLASSES
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(PerceiverError, match=r"builtin\.npz cannot be read .*install it again"):
        Calibration.load(path)
    replace(plain(), slope=float("nan")).save(path)
    with pytest.raises(PerceiverError, match=r"builtin\.npz is not finite: fit it again"):
        Calibration.load(path)


def test_a_calibration_of_an_older_version_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "mine.npz"
    np.savez(path, classes=np.array(CLASSES), bias=np.zeros(len(CLASSES)), gamma=9.8)
    with pytest.raises(PerceiverError, match=r"mine\.npz has no .*an older version wrote it, fit it again"):
        Calibration.load(path)
