"""Runs this project's step: a bundle in ONNX Runtime, pooled at the model's own size.

Run: python -m bench.clipseg.ours CHECKPOINT CLIP OUT SCENE PRECISION... exports the bundle OUT.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anytraverse.assessment import Finding
from anytraverse.bundle.records import CheckRuntime
from anytraverse.judging import Settings, make_maps, roi_figures
from anytraverse.perception import Prompt
from anytraverse.perception.clipseg.perceiver import ClipSeg
from anytraverse.regions import Box
from bench.clipseg.contestants import Figures
from bench.clipseg.parts import Parts

REGION = Box(0.333, 0.6, 0.667, 0.95)
"""The authors'."""


class Ours:
    """Runs the perceiver `clipseg` and judges its maps; it makes the scene's embedding on every frame."""

    def __init__(self, bundle: str, precision: str, threads: int) -> None:
        self.parts = Parts()
        self._perceiver = ClipSeg(bundle, CheckRuntime(threads=threads, precision=precision))
        inside: Any = self._perceiver
        inside._resize = self.parts.timed("resize", inside._resize)
        self._scene = "tail" if self._perceiver.manifest.scene_image is None else "scene"
        self._settings = Settings(region=REGION)
        self._prompts: list[Prompt] = []
        self._weights: list[float] = []

    def set_prompts(self, words: Sequence[str], weights: Sequence[float]) -> None:
        self._prompts, self._weights = [Prompt(word) for word in words], list(weights)

    def figures(self, frame: NDArray[np.uint8]) -> Figures:
        height, width = frame.shape[:2]
        with self.parts.time("tower"):
            features = self._perceiver.encode(frame)
        with self.parts.time(self._scene):
            embedding = self._perceiver.embed(features)
        with self.parts.time("decoder"):
            attention = self._perceiver.attend(features, self._prompts)
        with self.parts.time("pooling"):
            maps = make_maps(attention, self._weights, self._settings)
            roi = maps if isinstance(maps, Finding) else roi_figures(maps, width / height, self._settings)
        if isinstance(roi, Finding):
            raise RuntimeError(f"the maps cannot be judged: {roi}")
        return Figures(roi.traversability, roi.uncertainty, tuple(embedding.tolist()))


def main() -> None:
    from anytraverse.export import export_bundle
    from bench.clipseg.checkpoints import quieten_transformers

    quieten_transformers()
    parser = argparse.ArgumentParser(description="Export the bundle that the benchmark runs.")
    parser.add_argument("checkpoint")
    parser.add_argument("clip")
    parser.add_argument("out", type=Path)
    parser.add_argument("scene", choices=["shared", "clip-b32"])
    parser.add_argument("precisions", nargs="+", choices=["fp32", "int8"])
    given = parser.parse_args()
    images = Path(given.checkpoint) / "preprocessor_config.json"
    export_bundle(
        given.checkpoint,
        given.out,
        size=json.loads(images.read_text())["size"]["height"],
        precisions=given.precisions,
        scene=given.scene,
        clip=given.clip if given.scene == "clip-b32" else None,
        say=print,
    )


if __name__ == "__main__":
    main()
