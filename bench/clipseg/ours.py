"""Runs this project's step: a bundle in ONNX Runtime, pooled at the model's own size."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anytraverse.assessment import Finding
from anytraverse.bundle.manifest import read_manifest
from anytraverse.bundle.records import CheckRuntime
from anytraverse.findings import make_maps, roi_figures
from anytraverse.judging import Settings
from anytraverse.perception import Prompt, make_perceiver
from anytraverse.regions import Box
from bench.clipseg.contestants import StepFigures
from bench.clipseg.parts import Parts

REGION = Box(0.333, 0.6, 0.667, 0.95)
"""The authors'."""


class Ours:
    """Runs the bundle's perceiver and judges its maps; it makes the scene's embedding on every frame.

    A dense bundle runs as a check runs it, without a calibration, which would be two numbers in its sigmoid.
    """

    def __init__(self, bundle: str, precision: str, threads: int) -> None:
        self.parts = Parts()
        manifest = read_manifest(Path(bundle))
        runtime = CheckRuntime(threads=threads, precision=precision)
        self._perceiver = make_perceiver(f"{manifest.kind}:{bundle}", runtime)
        inside: Any = self._perceiver
        inside._resize = self.parts.timed("resize", inside._resize)
        self._scene = "tail" if manifest.scene == "shared" else "scene"
        self._maps = "decoder" if manifest.kind == "clipseg" else "scores"
        self._settings = Settings(region=REGION)
        self._prompts: list[Prompt] = []
        self._weights: list[float] = []

    def set_prompts(self, words: Sequence[str], weights: Sequence[float]) -> None:
        self._prompts, self._weights = [Prompt(word) for word in words], list(weights)

    def figures(self, frame: NDArray[np.uint8]) -> StepFigures:
        height, width = frame.shape[:2]
        with self.parts.time("tower"):
            features = self._perceiver.encode(frame)
        with self.parts.time(self._scene):
            embedding = self._perceiver.embed(features)
        with self.parts.time(self._maps):
            attention = self._perceiver.attend(features, self._prompts)
        with self.parts.time("pooling"):
            maps = make_maps(attention, self._weights, self._settings)
            roi = maps if isinstance(maps, Finding) else roi_figures(maps, width / height, self._settings)
        if isinstance(roi, Finding):
            raise RuntimeError(f"the maps cannot be judged: {roi}")
        return StepFigures(roi.traversability, roi.uncertainty, tuple(embedding.tolist()))
