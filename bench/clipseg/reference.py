"""Computes one step of the authors' AnyTraverse 2.0.0 in PyTorch, as the reference of the benchmark.

It does what their release does: words without a template; embeddings cached by the tuple of all words; the
image encoded once, with all layers; the decoder batched over the words; the sigmoid at the model's size, then
maps resized to the frame's size and pooled there; CLIP ViT-B/32 as a separate scene encoder; float32 on the
CPU. Comparing with remembered scenes is left out: it takes microseconds in both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn.functional import interpolate, normalize
from transformers import AutoTokenizer, CLIPSegForImageSegmentation, CLIPVisionModelWithProjection

from bench.clipseg.checkpoints import quieten_transformers
from bench.clipseg.contestants import StepFigures
from bench.clipseg.parts import Parts
from bench.clipseg.pixels import Pixels

ROI_X, ROI_Y = (0.333, 0.667), (0.6, 0.95)
CACHED = 64


@dataclass(frozen=True)
class Step:
    """The result of a step.

    maps: (k, height, width); traversability, uncertainty: (height, width), all in [0, 1] at the frame's size.
    roi_traversability, roi_uncertainty: means over the ROI. embedding: (d,), unit norm.
    """

    maps: NDArray[np.float32]
    traversability: NDArray[np.float32]
    uncertainty: NDArray[np.float32]
    roi_traversability: float
    roi_uncertainty: float
    embedding: NDArray[np.float32]


class Reference:
    """The authors' step. checkpoint, clip: local folders of a CLIPSeg and of a CLIP checkpoint."""

    def __init__(self, checkpoint: Path, clip: Path, threads: int = 1) -> None:
        torch.set_num_threads(threads)
        quieten_transformers()
        self.parts = Parts()
        self._tokenizer = AutoTokenizer.from_pretrained(checkpoint)
        self._pixels = Pixels.read(checkpoint)
        self._model = CLIPSegForImageSegmentation.from_pretrained(checkpoint).float().eval()
        self._scene_pixels = Pixels.read(clip)
        self._scene = CLIPVisionModelWithProjection.from_pretrained(clip).float().eval()
        self._cache: dict[tuple[str, ...], torch.Tensor] = {}
        self._weights: dict[str, float] = {}

    def set_prompts(self, words: Sequence[str], weights: Sequence[float]) -> None:
        """Sets the prompts from the next step on, each word with its weight in [-1, 1]."""
        self._weights = dict(zip(words, weights, strict=True))

    def step(self, frame: NDArray[np.uint8]) -> Step:
        """Runs one step on an RGB frame, (height, width, 3) uint8."""
        with torch.inference_mode():
            return self._step(frame)

    def _step(self, frame: NDArray[np.uint8]) -> Step:
        with self.parts.time("scene"):
            embeds = self._scene(pixel_values=self._scene_pixels.of(frame)).image_embeds
            embedding = normalize(embeds.float(), p=2, dim=-1)
        with self.parts.time("resize"):
            pixels = self._pixels.of(frame)
        with self.parts.time("tower"):
            seen = self._model.clip.vision_model(pixels, output_hidden_states=True)
        with self.parts.time("text"):
            prompts = self._embed(tuple(self._weights))
        with self.parts.time("decoder"):
            layers = [seen.hidden_states[index + 1] for index in self._model.extract_layers]
            activations = [layer.expand(len(prompts), -1, -1) for layer in layers]
            logits = self._model.decoder(activations, prompts).logits
        with self.parts.time("maps"):
            maps = self._at_size(torch.sigmoid(logits.float()), frame.shape[0], frame.shape[1])
        with self.parts.time("pooling"):
            each = list(maps.unbind(0))
            traversability, uncertainty = self._pool_traversability(each), self._pool_uncertainty(each)
            roi = float(_roi(traversability).mean()), float(_roi(uncertainty).mean())
        return Step(maps.numpy(), traversability.numpy(), uncertainty.numpy(), *roi, embedding[0].numpy())

    def _embed(self, words: tuple[str, ...]) -> torch.Tensor:
        if words not in self._cache:
            if len(self._cache) >= CACHED:
                self._cache.clear()
            tokens = self._tokenizer(list(words), padding=True, return_tensors="pt")
            self._cache[words] = self._model.get_conditional_embeddings(
                len(words), input_ids=tokens["input_ids"], attention_mask=tokens["attention_mask"]
            )
        return self._cache[words]

    @staticmethod
    def _at_size(maps: torch.Tensor, height: int, width: int) -> torch.Tensor:
        resized: torch.Tensor = interpolate(
            maps[:, None], size=(height, width), mode="bilinear", align_corners=False
        )
        return resized[:, 0]

    def _pool_traversability(self, maps: list[torch.Tensor]) -> torch.Tensor:
        weighted = torch.stack(maps) * torch.tensor(list(self._weights.values())).view(-1, 1, 1)
        strongest = weighted.abs().argmax(dim=0, keepdim=True)
        return weighted.gather(0, strongest)[0].clip(0.0, 1.0)

    @staticmethod
    def _pool_uncertainty(maps: list[torch.Tensor]) -> torch.Tensor:
        return 1 - torch.stack(maps).max(dim=0).values


def _roi(pooled: torch.Tensor) -> torch.Tensor:
    """Returns their region of interest as pixels; both ends belong to it."""
    height, width = pooled.shape
    left, right = (int(width * bound) for bound in ROI_X)
    top, bottom = (int(height * bound) for bound in ROI_Y)
    return pooled[top : bottom + 1, left : right + 1]


def make(checkpoint: str, clip: str, threads: int) -> ReferenceContestant:
    return ReferenceContestant(Reference(Path(checkpoint), Path(clip), threads))


class ReferenceContestant:
    """Adapts the reference to the benchmark."""

    def __init__(self, reference: Reference) -> None:
        self.parts = reference.parts
        self.set_prompts = reference.set_prompts
        self._reference = reference

    def figures(self, frame: NDArray[np.uint8]) -> StepFigures:
        step = self._reference.step(frame)
        return StepFigures(step.roi_traversability, step.roi_uncertainty, tuple(step.embedding.tolist()))
