"""What is compared on held-out drives, and when a fit is worse."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anytraverse.training.calibration import plain
from anytraverse.training.folders import read_folder
from anytraverse.training.held_out import FORGETS, LOSES, DriveScores, HeldOutComparison, compare
from anytraverse.training.scores import Score
from tests.anytraverse.training.made_outputs import by_colour, sky_everywhere


def comparison(
    new: float, old: float, again: float | None, things: float = 0.9, noticed: float = 0.8
) -> HeldOutComparison:
    drive = DriveScores(None, 10, Score(new, new, 0.01), Score(old, old, 0.02))
    return HeldOutComparison((replace(drive, block=2),), drive, again, things, 0.9, 400, noticed, 0.8, 0.8)


def test_a_fit_must_be_as_good_as_the_old_network_with_the_same_advantage() -> None:
    assert comparison(0.8, 0.8, 0.8).refusal() is None
    assert comparison(0.8, 0.7, None).refusal() is None
    assert comparison(0.799, 0.8, None).refusal() == "drivable IoU 0.799, before 0.800"
    assert comparison(0.8, 0.7, 0.82).refusal() == "drivable IoU 0.800, before 0.820"


def test_a_fit_that_forgets_what_has_no_name_is_refused() -> None:
    assert comparison(0.9, 0.8, 0.8, things=0.9 - FORGETS + 1e-6).refusal() is None
    refusal = comparison(0.9, 0.8, 0.8, things=0.8).refusal()
    assert refusal == "AUROC of unknown things 0.800, before 0.900"


def test_a_fit_by_which_a_rover_would_notice_fewer_things_is_refused_however_good_its_ground_is() -> None:
    assert comparison(0.9, 0.8, 0.8, noticed=0.8 - LOSES + 1e-6).refusal() is None
    refusal = comparison(0.95, 0.8, 0.8, things=0.99, noticed=0.7).refusal()
    assert refusal == "a rover would notice 0.700 of 400 pasted things, before 0.800"
    assert "of 400 pasted" in (comparison(0.95, 0.8, 0.8, noticed=math.nan).refusal() or "")


def test_calibrating_is_advised_only_where_it_helps_and_loses_no_things() -> None:
    helps = comparison(0.8, 0.7, 0.82)
    assert helps.calibrating_helps
    assert not replace(helps, noticed_recalibrated=0.7).calibrating_helps
    assert not comparison(0.8, 0.7, 0.69).calibrating_helps
    assert not comparison(0.8, 0.7, None).calibrating_helps


def test_each_drive_has_its_own_line_and_all_are_pooled(
    tiny_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("anytraverse.training.things.THINGS", 24)
    folder = read_folder(tiny_folder).of([1, 2])
    found = compare((by_colour, plain()), (sky_everywhere, plain()), folder, chosen_here=True)
    assert [(drive.name, drive.images) for drive in (*found.drives, found.all)] == [
        ("0100-0199", 6),
        ("0200-0299", 6),
        ("all", 12),
    ]
    assert min(drive.fitted.iou for drive in found.drives) > 0.85
    assert found.all.fitted.iou == pytest.approx(np.mean([d.fitted.iou for d in found.drives]), abs=0.02)
    assert found.all.replaced.iou == 0
    assert found.recalibrated is not None
    assert len(found.table()) == 7
    assert found.figures()["drives"][1]["images"] == 6
    assert found.figures()["things_pasted"] == found.pasted > 20
    assert found.noticed_before == 0
    again = compare((by_colour, plain()), (sky_everywhere, plain()), folder, chosen_here=False)
    assert again.recalibrated is again.noticed_recalibrated is None
    assert again.noticed == found.noticed
