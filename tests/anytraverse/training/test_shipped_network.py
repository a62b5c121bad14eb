"""The network that ships: its size, its calibration, that it runs where it must, and that it sees."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from anytraverse.perception.builtin.calibration import Calibration
from anytraverse.perception.builtin.network import network_input, open_network
from anytraverse.perception.builtin.perceiver import SHIPPED
from anytraverse.perception.builtin.taps import COLOURS
from anytraverse.perception.runtime import Runtime
from anytraverse.training.classes import CLASSES
from anytraverse.training.widths import FEATURES, MIDDLE, SCALES

FRAMES = Path(__file__).parents[4] / "shared" / "data" / "trail"


def test_it_is_small_and_its_calibration_fits() -> None:
    calibration = Calibration.load(SHIPPED.with_suffix(".npz"))
    assert SHIPPED.stat().st_size + SHIPPED.with_suffix(".npz").stat().st_size < 8_000_000
    assert calibration.classes == CLASSES
    assert calibration.bias.shape == (len(CLASSES),)
    taps = FEATURES + SCALES[8] + COLOURS
    assert calibration.tap_whitening.shape == (taps, taps)
    assert calibration.distance_centres.shape[1] == MIDDLE
    assert len(calibration.distance_centres) >= 3
    assert calibration.scene_projection.shape == (32, 3 * SCALES[16] + 4 * FEATURES)
    assert 0 < calibration.limits[0] < 1
    assert 1 < calibration.limits[1] < 5  # the median distance of known ground is near 1
    assert 0.4 < calibration.tile < 0.9
    assert 0 < calibration.scene_threshold < 0.925
    numbers, cosines = calibration.scene_match.T
    assert (np.diff(numbers) > 0).all()
    assert (np.diff(cosines) >= 0).all()


def test_frames_of_any_height_run_and_the_output_repeats() -> None:
    run = open_network(SHIPPED, Runtime(threads=1))
    for height in (480, 340):
        image = np.random.default_rng(0).integers(0, 256, (height, 640, 3), dtype=np.uint8)
        frame = network_input(image)
        first, again = run(frame), run(frame)
        assert first.logits.shape[1:] == (frame.shape[2] // 4, frame.shape[3] // 4)
        assert all((one == other).all() for one, other in zip(first, again, strict=True))


needs_frames = pytest.mark.skipif(
    not FRAMES.is_dir(), reason="needs the labelled frames beside the checkout: ../shared/data"
)


@needs_frames
def test_it_sees_drives_that_it_was_not_trained_on() -> None:
    from anytraverse.training.folders import read_folder
    from anytraverse.training.scores import outputs, score

    run, calibration = (
        open_network(SHIPPED, Runtime(threads=1)),
        Calibration.load(SHIPPED.with_suffix(".npz")),
    )
    held_out = read_folder(FRAMES).of([2])
    found = score(outputs(lambda image: run(network_input(image)), held_out), calibration)
    assert found.iou > 0.8
    assert found.unexplained < 0.05


@needs_frames
def test_a_rover_would_notice_most_things_that_are_pasted_into_its_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from anytraverse.training.folders import read_folder
    from anytraverse.training.things import recall, seen

    monkeypatch.setattr("anytraverse.training.things.THINGS", 150)
    run = open_network(SHIPPED, Runtime(threads=1))
    calibration = Calibration.load(SHIPPED.with_suffix(".npz"))
    things = seen(lambda image: run(network_input(image)), read_folder(FRAMES).of([4]), 0)
    assert recall(things, calibration) > 0.93
