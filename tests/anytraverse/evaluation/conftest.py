"""Small labelled drives, and a perceiver that sees how bright things are."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from anytraverse.errors import UnknownWordError
from anytraverse.frame import Image
from anytraverse.perception import KINDS, DefaultThresholds, Example, Prompt
from anytraverse.perception.runtime import Runtime
from anytraverse.regions import Box

LEVELS = {"dirt": 40, "grass": 90, "bush": 140, "drum": 190}
SYNONYMS = {"soil": "dirt", "barrel": "drum"}
CLASSES = ("dirt_path", "grass", "bush", "barrel")
UNLABELLED = 255

Grid = Sequence[Sequence[int]]
MakeDrive = Callable[..., Path]


class Grey:
    """Each word is a brightness; its attention falls to 0 at 50 levels from it. One cell is 8x8 pixels."""

    model_id = "grey-1"
    vocabulary: tuple[str, ...] | None = (*LEVELS, *SYNONYMS)
    defaults = DefaultThresholds(roi=0.3, scene=0.85)
    broken = False

    def __init__(self, argument: str, runtime: Runtime) -> None:
        self.argument, self.runtime = argument, runtime

    def meaning(self, word: str) -> str:
        """The brightness by its first name."""
        word = SYNONYMS.get(word, word)
        if word not in LEVELS:
            raise UnknownWordError(word, tuple(LEVELS))
        return word

    def encode(self, image: Image) -> NDArray[np.float32]:
        """The brightness of each cell."""
        grey = image.astype(np.float32).mean(axis=2)
        height, width = grey.shape
        cells: NDArray[np.float32] = grey.reshape(height // 8, 8, width // 8, 8).mean(axis=(1, 3)).round()
        return cells

    def attend(self, features: NDArray[np.float32], prompts: Sequence[Prompt]) -> NDArray[np.float32]:
        """How near each cell is to each word."""
        levels = np.array([LEVELS[self.meaning(prompt.word)] for prompt in prompts], dtype=np.float32)
        maps = np.clip(1 - np.abs(features - levels[:, None, None]) / 50, 0, 1).astype(np.float32)
        return np.full_like(maps, np.nan) if self.broken else maps

    def embed(self, features: NDArray[np.float32]) -> NDArray[np.float32]:
        """Never needed."""
        raise NotImplementedError

    def example(self, features: NDArray[np.float32], box: Box) -> Example:
        """Never needed."""
        raise NotImplementedError


@pytest.fixture
def grey(monkeypatch: pytest.MonkeyPatch) -> type[Grey]:
    """The kind "grey"."""
    monkeypatch.setitem(sys.modules, "grey_eyes", SimpleNamespace(Grey=Grey))
    monkeypatch.setitem(KINDS, "grey", ("grey_eyes", "Grey"))
    return Grey


def blocks(cells: Grid) -> NDArray[np.uint8]:
    """A picture in which each cell is a block of 32x32 pixels."""
    return np.array(cells, dtype=np.uint8).repeat(32, axis=0).repeat(32, axis=1)


@pytest.fixture
def make_drive(tmp_path: Path) -> MakeDrive:
    """Writes a folder of number -> (brightness of each block, class id of each block)."""

    def make(
        frames: Mapping[int, tuple[Grid, Grid]], classes: Sequence[str] = CLASSES, name: str = "drive"
    ) -> Path:
        folder = tmp_path / name
        folder.mkdir()
        content: dict[str, Any] = {"ignore": UNLABELLED, "classes": list(classes)}
        (folder / "classes.json").write_text(json.dumps(content))
        for number, (light, ids) in frames.items():
            quality = [cv2.IMWRITE_JPEG_QUALITY, 100]
            assert cv2.imwrite(str(folder / f"{number:04}.jpg"), blocks(light), quality)
            assert cv2.imwrite(str(folder / f"{number:04}.png"), blocks(ids))
        return folder

    return make
