"""Tiny CLIPSegs of random weights."""

from __future__ import annotations

from pathlib import Path

import pytest

from anytraverse.export.architecture import Tower, Vision
from anytraverse.export.making import make_bundle
from anytraverse.export.random_weights import TINY, random_clipseg, random_scene
from anytraverse.perception.clipseg.perceiver import ClipSeg
from anytraverse.perception.runtime import Runtime

TINY_SCENE = Vision(Tower(2, 32, 2, 64), 16, (0.5, 0.5, 0.5), (0.25, 0.25, 0.25))


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bundle for 64 x 64 pixels with an int8 variant; the scene is the tower's own."""
    folder = tmp_path_factory.mktemp("bundles") / "tiny"
    make_bundle(folder, random_clipseg(TINY), size=64, precisions=("fp32", "int8"), name="tiny")
    return folder


@pytest.fixture(scope="session")
def tiny_b32(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with an encoder for the scene alone."""
    folder = tmp_path_factory.mktemp("bundles") / "tiny-b32"
    scene = random_scene(TINY_SCENE, joint=20)
    make_bundle(folder, random_clipseg(TINY), size=64, scene=scene, name="tiny")
    return folder


@pytest.fixture
def eyes(tiny: Path) -> ClipSeg:
    """Made anew, so that it has heard no word."""
    return ClipSeg(str(tiny), Runtime(threads=1))
