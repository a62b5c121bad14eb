"""`companion look-ground --estimate`: it finds the simulated field's own mount, and says what it cannot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.ground import GroundCamera, Lens
from companion.cli import main
from companion.desk.ground.driven_pairs import DrivenMotion, straight_steps
from companion.desk.ground.mount_fit import CannotTellError, FramePair, fit_mount
from companion.sim.field.render import PinholeCamera
from companion.sim.field.things import World
from tests.companion.desk.ground.simulated import CONFIG, pairs, record

CAMERA = GroundCamera(Lens.of_view(75.0, 4 / 3), 0.5, 0.0)


@pytest.fixture(scope="module")
def driven() -> Sequence[FramePair]:
    return list(pairs(0, 0.6, 22))


@pytest.fixture
def config(tmp_path: Path) -> Path:
    (tmp_path / "companion.toml").write_text(CONFIG)
    return tmp_path / "companion.toml"


def estimate(drive: Path, config: Path, *more: str) -> int:
    """Type the command."""
    return main(["look-ground", "--estimate", str(drive), "--config", str(config), *more])


@pytest.mark.slow
def test_the_simulated_mount_is_found(driven: Sequence[FramePair]) -> None:
    fit = fit_mount(driven, CAMERA)
    assert fit.tilt[1] == pytest.approx(7.0, abs=0.15)
    assert fit.height[1] == pytest.approx(1.0, abs=0.01)
    assert fit.pairs >= 20


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 5))
def test_the_simulated_mount_is_found_on_every_trail(seed: int) -> None:
    fit = fit_mount(list(pairs(seed, 0.6, 30)), CAMERA)
    assert fit.tilt[1] == pytest.approx(7.0, abs=0.15)
    assert fit.height[1] == pytest.approx(1.0, abs=0.01)


@pytest.mark.slow
def test_a_speed_that_is_a_tenth_too_high_makes_the_height_a_tenth_too_great(
    driven: Sequence[FramePair],
) -> None:
    fit = fit_mount([replace(pair, ahead=1.1 * pair.ahead) for pair in driven], CAMERA)
    assert fit.height[1] == pytest.approx(1.1, abs=0.015)
    assert fit.tilt[1] == pytest.approx(7.0, abs=0.2)


@pytest.mark.slow
def test_pairs_of_other_places_tell_nothing(driven: Sequence[FramePair]) -> None:
    mixed = [replace(one, second=other.second) for one, other in zip(driven, driven[::-1], strict=True)]
    with pytest.raises(CannotTellError, match="no mount explains the pairs better than any other"):
        fit_mount(mixed, CAMERA)


@pytest.mark.slow
def test_a_nose_that_rises_untold_makes_the_pairs_disagree_or_no_mount_fit(
    driven: Sequence[FramePair],
) -> None:
    rising = [replace(pair, pitched=2.0 * (-1) ** number) for number, pair in enumerate(driven)]
    with pytest.raises(CannotTellError):
        fit_mount(rising, CAMERA)


@pytest.mark.slow
def test_a_recording_tells_the_mount(
    tmp_path: Path, config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record(tmp_path / "drive.mcap", 0, frames=60, speed=0.8)
    assert estimate(tmp_path / "drive.mcap", config) == 0
    told = capsys.readouterr().out
    assert "[mount]\nheight = 1.0" in told
    assert "\ntilt = 7.0  # degrees" in told


@pytest.mark.slow
def test_a_recording_without_speed_tells_nothing(
    tmp_path: Path, config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record(tmp_path / "drive.mcap", 0, frames=4, speed=None)
    assert estimate(tmp_path / "drive.mcap", config) == 1
    assert "cannot tell: it is not known how fast it was driven" in capsys.readouterr().err


def test_a_short_recording_says_how_to_drive(
    tmp_path: Path, config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record(tmp_path / "drive.mcap", 0, frames=4, speed=0.8)
    assert estimate(tmp_path / "drive.mcap", config) == 1
    told = capsys.readouterr().err
    assert "cannot tell: 2 pairs of frames can be used, and 20 are needed: drive straight on level" in told


@pytest.mark.slow
def test_pictures_without_a_speed_tell_nothing(
    tmp_path: Path, config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    image, _ = PinholeCamera(World(0)).render(World(0).trail.pose(20.0), 0.0)
    cv2.imwrite(str(folder / "1.jpg"), image)
    assert estimate(folder, config) == 1
    assert "or --speed" in capsys.readouterr().err
    assert estimate(folder, config, "--speed", "1") == 1
    assert "cannot tell: 0 pairs" in capsys.readouterr().err


def test_a_drive_that_is_not_there_ends_with_2(
    tmp_path: Path, config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert estimate(tmp_path / "none.mcap", config) == 2
    assert "none.mcap is not there" in capsys.readouterr().err


@pytest.mark.parametrize("speed", ["0", "nan", "1,5"])
def test_what_is_no_speed_ends_with_2(
    tmp_path: Path, config: Path, speed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        estimate(tmp_path, config, "--speed", speed)
    assert ended.value.code == 2
    assert f"argument --speed: {speed} is no speed in m/s: give 0.05 to 30" in capsys.readouterr().err


def reports(*, until: float, speed: float = 1.0, turning: float = 0.0) -> list[dict[str, Any]]:
    """Reports four times a second. turning: degrees a second."""
    return [
        {"position_at": at, "speed": speed, "attitude_at": at, "attitude": [0, 0, (350 + turning * at) % 360]}
        for at in np.arange(0.0, until, 0.25)
    ]


def test_the_way_is_the_speed_over_time_and_unknown_outside_the_reports() -> None:
    way = DrivenMotion(reports(until=10.0, speed=1.2)).way(np.array([1.0, 3.0, 11.0]))
    assert way[1] - way[0] == pytest.approx(2.4)
    assert math.isnan(way[2])


def test_no_pair_spans_a_gap_in_the_reports() -> None:
    told = [one for one in reports(until=20.0) if not 5.0 < one["position_at"] < 7.0]
    at = np.arange(0.5, 19.0, 0.5)
    motion = DrivenMotion(told)
    steps = straight_steps(motion.way(at), motion.attitude(at))
    assert len(steps) > 20
    assert not [step for step in steps if at[step.first] < 7.0 and at[step.second] > 5.0]


def test_a_heading_that_passes_north_is_no_turn_and_a_bend_is_left_out() -> None:
    at = np.arange(0.0, 39.0, 0.5)
    for turning, least, most in ((1.0, 70, 78), (5.0, 0, 0)):
        motion = DrivenMotion(reports(until=40.0, turning=turning))
        steps = straight_steps(motion.way(at), motion.attitude(at))
        assert least <= len(steps) <= most
        assert all(abs(step.turned) <= 2.0 for step in steps)


def test_a_standing_vehicle_makes_no_pairs() -> None:
    at = np.arange(0.0, 39.0, 0.5)
    motion = DrivenMotion(reports(until=40.0, speed=0.0))
    assert straight_steps(motion.way(at), motion.attitude(at)) == []


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=4),
    max_leaves=5,
)
NAMES = st.sampled_from(["position_at", "speed", "attitude_at", "attitude"])


@pytest.mark.slow
@given(st.lists(st.dictionaries(NAMES, ANYTHING | st.floats(0, 20), max_size=4), max_size=8))
def test_whatever_a_recording_says_of_the_vehicle_its_pairs_are_short_and_straight(
    told: list[dict[str, Any]],
) -> None:
    at = np.linspace(0.0, 20.0, 30)
    motion = DrivenMotion(told)
    for step in straight_steps(motion.way(at), motion.attitude(at)):
        assert 0.3 <= step.ahead <= 1.8
        assert abs(step.turned) <= 2.0
        assert math.isfinite(step.pitched + step.banked)
