"""Small bundles, and a perceiver that runs them without any network."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from anytraverse.bundle.manifest import Manifest, read_manifest
from anytraverse.bundle.records import choose_precision
from anytraverse.bundle.writing import BundleWriter
from anytraverse.errors import PerceiverError
from anytraverse.frame import Image
from anytraverse.perception import KINDS, DefaultThresholds, Example, Prompt
from anytraverse.perception.resizing import Fit
from anytraverse.perception.runtime import Runtime
from anytraverse.regions import Box

WORDS = ("red", "green", "blue")
MakeBundle = Callable[..., Path]


def write_bundle(out: Path, **details: Any) -> Manifest:
    """A bundle of kind "sham" with two variants; `details` say what its int8 does."""
    with BundleWriter(out) as writer:
        (writer.folder / "image.onnx").write_bytes(b"weights" * 100)
        (writer.folder / "image.int8.onnx").write_bytes(b"rounded" * 30)
        (writer.folder / "text").mkdir()
        (writer.folder / "text" / "tokens.json").write_text("{}")
        return writer.finish(
            kind="sham",
            name="a sham",
            model_id="sham-1",
            image=Fit(64, 64),
            scene="shared",
            thresholds=DefaultThresholds(roi=0.3, scene=0.9),
            variants={
                "fp32": {"image": "image.onnx", "tokenizer": "text/tokens.json"},
                "int8": {"image": "image.int8.onnx"},
            },
            details=details,
            source={"weights": "none", "licence": "none"},
        )


@pytest.fixture
def make_bundle(tmp_path: Path) -> MakeBundle:
    """Writes a bundle in a folder of its own, and answers the folder."""

    def make(name: str = "bundle", **details: Any) -> Path:
        write_bundle(tmp_path / name, **details)
        return tmp_path / name

    return make


class Clock:
    """Time that passes only where somebody works."""

    def __init__(self) -> None:
        self.now = 0.0

    def process_time(self) -> float:
        """Seconds of CPU, which nobody else uses."""
        return self.now

    def perf_counter(self) -> float:
        """Seconds."""
        return self.now


class Sham:
    """Sees how red, green and blue a picture is. A frame costs it 0.1 s, in int8 0.1 s / `gain`.

    Its int8 sees everything `shift` pixels to the right, turns the scene's embedding by `turn` radians, gives
    NaN with `nan`, fails on a frame with `fails` and when made with `loads` False.
    """

    clock = Clock()
    vocabulary: tuple[str, ...] | None = WORDS
    model_id = "sham-1"
    defaults = DefaultThresholds(roi=0.3, scene=0.9)

    def __init__(self, argument: str, runtime: Runtime) -> None:
        folder = Path(argument)
        manifest = read_manifest(folder, "sham")
        self.precision, self.why = choose_precision(folder, manifest, runtime)
        self.flaws: dict[str, Any] = dict(manifest.details) if self.precision == "int8" else {}
        if self.flaws.get("loads") is False:
            raise PerceiverError("ONNX Runtime cannot load image.int8.onnx")

    def meaning(self, word: str) -> str:
        """The word itself."""
        return word

    def encode(self, image: Image) -> Image:
        """The picture itself."""
        self.clock.now += 0.1 / self.flaws.get("gain", 1.0)
        if self.flaws.get("fails"):
            raise PerceiverError("the network failed")
        return image

    def attend(self, features: Image, prompts: Sequence[Prompt]) -> NDArray[np.float32]:
        """The channels."""
        indices = [WORDS.index(prompt.word) for prompt in prompts]
        maps = np.moveaxis(features, 2, 0)[indices].astype(np.float32) / np.float32(255)
        maps = np.roll(maps, self.flaws.get("shift", 0), axis=2)
        return maps * np.float32(np.nan) if self.flaws.get("nan") else maps

    def embed(self, features: Image) -> NDArray[np.float32]:  # noqa: ARG002
        """Where it looks."""
        turn = self.flaws.get("turn", 0.0)
        return np.array([np.cos(turn), np.sin(turn)], dtype=np.float32)

    def example(self, features: Image, box: Box) -> Example:
        """Never needed."""
        raise NotImplementedError


@pytest.fixture
def sham(monkeypatch: pytest.MonkeyPatch) -> type[Sham]:
    """The kind "sham", and a clock that only its work moves."""
    monkeypatch.setitem(sys.modules, "sham_eyes", SimpleNamespace(Sham=Sham))
    monkeypatch.setitem(KINDS, "sham", ("sham_eyes", "Sham"))
    monkeypatch.setattr("anytraverse.bundle.checking.time", Sham.clock)
    monkeypatch.setattr("anytraverse.bundle.timing.time", Sham.clock)
    return Sham


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    """Twelve pictures: each colour fills a part of its own, a little larger from one to the next."""
    folder = tmp_path / "frames"
    folder.mkdir()
    for number in range(12):
        picture = np.zeros((64, 64, 3), dtype=np.uint8)
        picture[:, : 20 + number, 0] = 255
        picture[: 20 + number, :, 1] = 255
        picture[40 - number :, 10:, 2] = 255
        cv2.imwrite(str(folder / f"{number:02}.png"), picture[..., ::-1])
    return folder
