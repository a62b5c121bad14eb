"""The whitening of the surroundings: drives of one region are familiar, those of another are not."""

from __future__ import annotations

import numpy as np
import pytest

from anytraverse.frame import Image
from anytraverse.history import Entry, History
from anytraverse.perception.builtin.calibration import Calibration
from anytraverse.perception.builtin.network import Outputs
from anytraverse.perception.builtin.scene import surroundings_summary, surroundings_vector
from anytraverse.preferences import Preferences
from anytraverse.training.calibration import plain
from anytraverse.training.classes import CLASSES
from anytraverse.training.folders import BLOCK, Folder, Labelled
from anytraverse.training.scenes import FAMILIAR, fitted_surroundings
from anytraverse.training.widths import SCALES
from tests.anytraverse.training.made_outputs import made

_LABELS = np.zeros((8, 8), np.uint8)
_WIDE, _NARROW = 3.0, 0.1
"""How much a drive's frames vary in the first half of the channels, and in the rest."""


def network(image: Image) -> Outputs:
    """A frame is a seed, and the region that it is of: regions differ a little in what hardly varies."""
    seed, region = int(image[0, 0, 0]) + 256 * int(image[0, 0, 1]), int(image[0, 0, 2])
    rng = np.random.default_rng(seed)
    spread = np.where(np.arange(SCALES[8]) < SCALES[8] // 2, _WIDE, _NARROW)
    middle = rng.normal(0, spread) + np.where(spread == _NARROW, 0.3 * region, 0.0)
    eighth = np.broadcast_to(middle[:, None, None], (SCALES[8], 6, 4)).astype(np.float32)
    return made(np.zeros((len(CLASSES), 8, 8), np.float32), eighth=eighth)


def drives(count: int, region: int, frames: int = 40, first: int = 0) -> Folder:
    """Drives of one region."""
    found = []
    for drive in range(count):
        for frame in range(frames):
            number = (first + drive) * BLOCK + frame
            image = np.array([number % 256, number // 256, region], np.uint8)
            found.append(Labelled(number, np.broadcast_to(image, (8, 8, 3)), _LABELS))
    return Folder(tuple(found))


def strange(folder: Folder, known: Folder, calibration: Calibration) -> list[float]:
    """How strange frames are to a rover that knows others."""
    scenes = [
        Entry(np.ones(1, np.float32), Preferences(), n, n, surroundings=vector(frame, calibration))
        for n, frame in enumerate(known.frames)
    ]
    history = History(scenes)
    found = [history.strangeness(vector(frame, calibration), Preferences()) for frame in folder.frames]
    return [one for one in found if one is not None]


def vector(frame: Labelled, calibration: Calibration) -> np.ndarray[tuple[int], np.dtype[np.float32]]:
    return surroundings_vector(network(frame.image), calibration)


def test_a_new_drive_of_the_region_is_familiar_and_another_region_is_not() -> None:
    home = drives(6, 0)
    calibration = fitted_surroundings(network, home, plain())
    known = Folder(home.frames[::20])
    new = strange(drives(3, 0, first=20), known, calibration)
    assert np.mean([one < 1 for one in new]) == pytest.approx(FAMILIAR, abs=0.1)
    assert min(strange(drives(1, 1, first=30), known, calibration)) > 1


def test_a_rover_of_another_region_knows_its_own_drives_by_the_same_numbers() -> None:
    calibration = fitted_surroundings(network, drives(6, 0), plain())
    away = drives(3, 1, first=20)
    known = Folder(away.frames[::20])
    assert np.mean([one < 1 for one in strange(drives(2, 1, first=40), known, calibration)]) > 0.7
    assert min(strange(drives(1, 0, first=50), known, calibration)) > 1


@pytest.mark.parametrize("frames", [1, 2, 5])
def test_a_single_short_drive_gives_finite_numbers(frames: int) -> None:
    calibration = fitted_surroundings(network, drives(1, 0, frames), plain())
    assert np.isfinite(calibration.surroundings_whitening).all()
    assert np.isfinite(calibration.surroundings_mean).all()


def test_the_summary_tells_top_middle_and_bottom_apart() -> None:
    eighth = np.zeros((SCALES[8], 7, 4), np.float32)
    eighth[0, -2:] = 1.0
    summary = surroundings_summary(made(np.zeros((len(CLASSES), 8, 8), np.float32), eighth=eighth))
    assert summary.shape == (3 * SCALES[8],)
    assert summary[2 * SCALES[8]] == 1.0
    assert summary.sum() == 1.0
