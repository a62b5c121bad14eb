"""Compares a bundle with another one on the same frames: what a smaller size loses, and what it gains."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from anytraverse.bundle.checking import BundleCheckPlan, compare, words_of
from anytraverse.bundle.comparing import LEVEL, Array, BundleComparison, TimedOutputs
from anytraverse.bundle.machine import Machine, this_machine
from anytraverse.bundle.manifest import Manifest, read_manifest, verify
from anytraverse.bundle.pictures import frames_of
from anytraverse.bundle.records import CheckRuntime
from anytraverse.errors import BundleError, PerceiverError
from anytraverse.judging import Settings
from anytraverse.perception import Perceiver, Prompt, make_perceiver
from anytraverse.perception.dense.perceiver import Dense, not_calibrated


@dataclass
class SizeComparison(BundleComparison):
    """Collects the differences of maps of two sizes. The smaller map is enlarged to the larger one's size.

    attention: word -> the mean attention in the ROI of each frame, of the reference and of the other.
    """

    attention: dict[str, list[tuple[float, float]]] = field(default_factory=dict)

    def add(self, reference: TimedOutputs, other: TimedOutputs) -> None:
        """Add the results for one frame. Embeddings are not compared: each bundle has its own."""
        self.frames += 1
        if not np.isfinite(other.maps).all():
            self.failure = "it gave numbers that are not finite"
            return
        means = zip(_roi_means(reference.maps), _roi_means(other.maps), strict=True)
        for word, pair in zip(self.words, means, strict=True):
            self.attention.setdefault(word, []).append(pair)
        height, width = np.maximum(reference.maps.shape[1:], other.maps.shape[1:])
        self.add_maps(_enlarged(reference.maps, height, width), _enlarged(other.maps, height, width))


@dataclass(frozen=True)
class Word:
    """Holds what was found of a word.

    masks: compared; iou: of them all, None without any. roi, roi_reference: mean attention in the ROI over
    all frames, of the bundle and of the reference; difference: the mean of the frames' absolute differences.
    """

    masks: int
    iou: float | None
    roi: float
    roi_reference: float
    difference: float


@dataclass(frozen=True)
class Against:
    """Holds the comparison of two bundles. milliseconds: median of a frame, of CPU as in `timing`.

    stray: the largest share of a picture that differs where the reference's mask is empty or full.
    """

    manifest: Manifest
    reference: Manifest
    machine: Machine
    precision: str
    threads: int
    frames: int
    words: dict[str, Word]
    stray: float
    milliseconds: float
    milliseconds_reference: float

    @property
    def same_weights(self) -> bool:
        """Whether both model ids end with the same digest of the weights."""
        return self.manifest.model_id.split("-")[-1] == self.reference.model_id.split("-")[-1]

    @property
    def gain(self) -> float:
        """How many times less time a frame takes than with the reference."""
        return self.milliseconds_reference / self.milliseconds


def check_against(plan: BundleCheckPlan, reference: Path, say: Callable[[str], None]) -> Against:
    """Compare the bundle of `plan` with the one in `reference`, both in the plan's precision.

    It writes nothing into either. Raises BundleError and PerceiverError when one of them is refused, fails,
    or is a dense bundle that is not calibrated; PictureError without frames.
    """
    if plan.frames is None:
        raise BundleError("two bundles are compared on your frames: give them with --frames FOLDER")
    first = next(frames_of(plan.frames, lambda _: None))  # raises when no picture can be read
    other, big = _load(plan, plan.folder, say), _load(plan, reference, say)
    words = words_of(plan, big.perceiver)
    prompts = [Prompt(word) for word in words]
    for each in (other, big):  # a word's first use runs the text tower, and does not count
        for word in words:
            each.perceiver.meaning(word)
        each.perceiver.attend(each.perceiver.encode(first), prompts)
    comparison = SizeComparison(words)
    slow, fast = compare(comparison, big.perceiver, other.perceiver, frames_of(plan.frames, say), say)
    if comparison.failure:
        raise PerceiverError(f"{plan.folder}: {comparison.failure}")
    return Against(
        manifest=other.manifest,
        reference=big.manifest,
        machine=this_machine(),
        precision=plan.precision,
        threads=CheckRuntime(threads=plan.threads).cores,
        frames=comparison.frames,
        words={word: _word(comparison, word) for word in words},
        stray=comparison.stray,
        milliseconds=fast,
        milliseconds_reference=slow,
    )


def figures(found: Against) -> dict[str, Any]:
    """Return the comparison for JSON."""
    return {
        "bundle": found.manifest.model_id,
        "against": found.reference.model_id,
        "same_weights": found.same_weights,
        "machine": found.machine.id,
        "precision": found.precision,
        "threads": found.threads,
        "frames": found.frames,
        "words": {
            word: {
                "masks": each.masks,
                "iou": None if each.iou is None else round(each.iou, 4),
                "roi": round(each.roi, 4),
                "roi_against": round(each.roi_reference, 4),
                "roi_difference": round(each.difference, 4),
            }
            for word, each in found.words.items()
        },
        "stray": round(found.stray, 4),
        "milliseconds": round(found.milliseconds, 2),
        "milliseconds_against": round(found.milliseconds_reference, 2),
        "gain": round(found.gain, 3),
    }


def text(found: Against) -> str:
    """Return the comparison as lines for a person."""
    machine = found.machine
    lines = [
        f"bundle      {_named(found.manifest)}",
        f"against     {_named(found.reference)}",
        f"machine     {machine.cpu}, threads {found.threads}, onnxruntime {machine.onnxruntime}",
        f"frames      {found.frames}, in {found.precision}; masks are cut at {LEVEL:g}",
    ]
    if not found.same_weights:
        lines.append("            NOTE: the weights differ, too: this is not what the size alone loses")
    heads = ("masks", "IoU", "ROI mean", "against", "difference")
    lines.append(f"{'':22}" + "".join(f"{head:>12}" for head in heads))
    for word, each in found.words.items():
        iou = "-" if each.iou is None else f"{each.iou:.3f}"
        means = (f"{mean:.3f}" for mean in (each.roi, each.roi_reference, each.difference))
        lines.append(f"  {word:20}" + "".join(f"{cell:>12}" for cell in (str(each.masks), iou, *means)))
    lines.append(
        f"elsewhere   {found.stray:.1%} of a picture is marked otherwise at most, where "
        f"{_named(found.reference)} marks nothing or all"
    )
    if not all(each.masks for each in found.words.values()):
        lines.append(
            "            a word without masks cannot be compared: choose words that your frames show"
        )
    lines.append(
        f"time        {found.milliseconds:.0f} ms a frame against {found.milliseconds_reference:.0f} ms, "
        f"{found.gain:.1f} times as fast, by CPU time"
    )
    return "\n".join(lines)


@dataclass(frozen=True)
class _Loaded:
    manifest: Manifest
    perceiver: Perceiver


def _load(plan: BundleCheckPlan, folder: Path, say: Callable[[str], None]) -> _Loaded:
    manifest = read_manifest(folder)
    manifest.parts(plan.precision)  # raises for a missing variant
    verify(folder, manifest, say)
    say(f"loading {folder}")
    runtime = CheckRuntime(threads=plan.threads, precision=plan.precision)
    perceiver = make_perceiver(f"{manifest.kind}:{folder}", runtime)
    if isinstance(perceiver, Dense) and perceiver.details.calibration is None:
        raise BundleError(not_calibrated(folder))
    return _Loaded(manifest, perceiver)


def _word(comparison: SizeComparison, word: str) -> Word:
    masks, iou = comparison.by_word.get(word, (0, None))
    pairs = np.array(comparison.attention[word])
    reference, other = pairs.mean(axis=0)
    difference = np.abs(pairs[:, 0] - pairs[:, 1]).mean()
    return Word(masks, iou, float(other), float(reference), float(difference))


def _roi_means(maps: Array) -> list[float]:
    """Return each map's mean over the default ROI, at the map's own size, as the engine takes it."""
    inside = Settings().region.mask(*maps.shape[1:])
    if not inside.any():
        raise PerceiverError("its maps are too small: no pixel of them lies in the ROI")
    return [float(each[inside].mean()) for each in maps]


def _enlarged(maps: Array, height: int, width: int) -> Array:
    if maps.shape[1:] == (height, width):
        return maps
    return np.stack([cv2.resize(each, (int(width), int(height))) for each in maps])


def _named(manifest: Manifest) -> str:
    return f"{manifest.name} ({manifest.kind}) at {manifest.image.width}x{manifest.image.height}"
