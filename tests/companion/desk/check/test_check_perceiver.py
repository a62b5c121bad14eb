"""`companion check` says whether it is measured how often foreign places match remembered ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from anytraverse.perception import DefaultThresholds
from companion.config import Config
from companion.desk.check.camera import check_perceiver
from companion.desk.check.rover import CheckedRover
from companion.vision.warm_up import judging_settings
from tests.anytraverse.conftest import Painted

UNMEASURED = "how often a foreign place matches one of many remembered ones is not measured for it"
TABLE = ((1, 0.9), (256, 0.97))


@pytest.mark.parametrize(
    ("told", "said"), [({}, True), ({"match_measured": False}, True), ({"match_measured": True}, False)]
)
def test_a_running_companion_tells_it(tmp_path: Path, told: dict[str, object], said: bool) -> None:
    running = {"perceiver": {"model": "m", "step_ms": 20.0, **told}, "latency_ms": 30.0}
    (finding,) = check_perceiver(CheckedRover(Config(), "", tmp_path, running))
    assert (UNMEASURED in finding.text) == said


@pytest.mark.parametrize("scene", [None, 0.99])
def test_a_configured_scene_threshold_leaves_the_perceivers_measured_numbers(scene: float | None) -> None:
    perceiver = Painted()
    perceiver.defaults = DefaultThresholds(roi=0.3, scene=0.85, match=TABLE)
    config = Config()
    config = replace(config, thresholds=replace(config.thresholds, scene=scene))
    limits = judging_settings(config, perceiver).thresholds
    assert limits.match == TABLE
    assert limits.least_match(256) == (scene or 0.97)
