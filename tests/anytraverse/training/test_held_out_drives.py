"""What is compared on held-out drives, and when a fit is worse."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anytraverse.frame import Image
from anytraverse.training.calibration import plain
from anytraverse.training.classes import CLASSES
from anytraverse.training.folders import read_folder
from anytraverse.training.held_out import FORGETS, Comparison, Drive, compare
from anytraverse.training.scores import Floats, Score


def comparison(new: float, old: float, again: float | None, things: float = 0.9) -> Comparison:
    drive = Drive(None, 10, Score(new, new, 0.01), Score(old, old, 0.02))
    return Comparison((replace(drive, block=2),), drive, again, things, 0.9)


def test_a_fit_must_be_as_good_as_the_old_network_with_the_same_advantage() -> None:
    assert comparison(0.8, 0.8, 0.8).refusal() is None
    assert comparison(0.8, 0.7, None).refusal() is None
    assert comparison(0.799, 0.8, None).refusal() == "drivable IoU 0.799, before 0.800"
    assert comparison(0.8, 0.7, 0.82).refusal() == "drivable IoU 0.800, before 0.820"


def test_a_fit_that_forgets_what_has_no_name_is_refused() -> None:
    assert comparison(0.9, 0.8, 0.8, things=0.9 - FORGETS + 1e-6).refusal() is None
    refusal = comparison(0.9, 0.8, 0.8, things=0.8).refusal()
    assert refusal == "AUROC of unknown things 0.800, before 0.900"


def by_colour(image: Image) -> tuple[Floats, Floats]:
    """Logits of the tiny scene's colours: sky is blue, grass is green, the rest is trail."""
    small = image[::4, ::4].astype(np.float32)
    logits = np.full((len(CLASSES), *small.shape[:2]), -9.0, np.float32)
    blue, green = small[..., 2] > 170, (small[..., 1] > small[..., 0] + 30) & (small[..., 2] < 170)
    for name, found in (("sky", blue), ("grass", green), ("smooth trail", ~(blue | green))):
        logits[CLASSES.index(name)][found] = 9.0
    return logits, np.zeros((32, *small.shape[:2]), np.float32)


def nothing(image: Image) -> tuple[Floats, Floats]:
    """Sky everywhere."""
    logits, features = by_colour(image)
    logits[:] = 0
    logits[CLASSES.index("sky")] = 9
    return logits, features


def test_each_drive_has_its_own_line_and_all_are_pooled(tiny_folder: Path) -> None:
    folder = read_folder(tiny_folder).of([1, 2])
    found = compare((by_colour, plain()), (nothing, plain()), folder, chosen_here=True)
    assert [(drive.name, drive.images) for drive in (*found.drives, found.all)] == [
        ("0100-0199", 6),
        ("0200-0299", 6),
        ("all", 12),
    ]
    assert min(drive.fitted.iou for drive in found.drives) > 0.85
    assert found.all.fitted.iou == pytest.approx(np.mean([d.fitted.iou for d in found.drives]), abs=0.02)
    assert found.all.replaced.iou == 0
    assert found.recalibrated is not None
    assert len(found.table()) == 6
    assert found.figures()["drives"][1]["images"] == 6
    assert compare((by_colour, plain()), (nothing, plain()), folder, chosen_here=False).recalibrated is None
