"""Tiny dense models of random weights, and pictures to calibrate them on."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import pytest

from anytraverse.bundle.calibrating import calibrate
from anytraverse.bundle.pictures import frames_of
from anytraverse.bundle.records import CheckRuntime
from anytraverse.export.dense_making import make_dense_bundle
from anytraverse.export.random_weights import TINY_DENSE, random_dense
from anytraverse.perception.dense.perceiver import Dense
from anytraverse.perception.runtime import Runtime
from tests.anytraverse.clipseg.pictures import picture

ONE = Runtime(threads=1)
CHECKING = CheckRuntime(threads=1, precision="fp32")


@pytest.fixture(scope="session", params=["siglip", "tipsv2"])
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bundle for 64 x 64 pixels with an int8 variant, not calibrated."""
    folder: Path = tmp_path_factory.mktemp("dense") / "made"
    checkpoint = random_dense(request.param, TINY_DENSE[request.param], 64)
    make_dense_bundle(folder, checkpoint, precisions=("fp32", "int8"), name="tiny")
    return folder


@pytest.fixture(scope="session")
def terrain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """24 pictures."""
    folder = tmp_path_factory.mktemp("terrain")
    for seed in range(24):
        cv2.imwrite(str(folder / f"{seed:02}.png"), picture(96, 72, seed)[..., ::-1])
    return folder


@pytest.fixture
def bundle(made: Path, tmp_path: Path) -> Path:
    """A copy, not calibrated."""
    return Path(shutil.copytree(made, tmp_path / "bundle"))


@pytest.fixture(scope="session")
def calibrated(made: Path, terrain: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibrated copy."""
    folder = Path(shutil.copytree(made, tmp_path_factory.mktemp("dense") / "calibrated"))
    calibrate(folder, Dense(str(folder), CHECKING), frames_of(terrain, print), ["grass"], print)
    return folder


@pytest.fixture
def eyes(calibrated: Path) -> Dense:
    """Made anew, so that it has heard no word."""
    return Dense(str(calibrated), ONE)
