"""A bundle beside transformers' own model of the same checkpoint."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anytraverse.export import export_bundle
from anytraverse.frame import Image
from anytraverse.perception import Prompt
from anytraverse.perception.clipseg.perceiver import ClipSeg
from anytraverse.perception.clipseg.prompts import Prompts
from anytraverse.perception.runtime import Runtime
from tests.anytraverse.clipseg.pictures import picture

Array = NDArray[np.float32]


class Parity:
    """A checkpoint of pictures of size x size, exported: `ours` runs the bundle, `theirs` is transformers."""

    def __init__(self, checkpoint: Path, bundle: Path, size: int, **options: Any) -> None:
        self.checkpoint, self.bundle, self.size = checkpoint, bundle, size
        manifest = export_bundle(str(checkpoint), bundle, size=size, **options)
        runtime = Runtime(threads=1)
        self.ours = ClipSeg(str(bundle), runtime)
        pieces = [
            bundle / file for part, file in manifest.variants["fp32"].items() if part.startswith("text-")
        ]
        self.prompts = Prompts(pieces, bundle / "tokenizer.json", bundle / "tokens.npy", runtime)
        self.theirs = Theirs(checkpoint)

    def identical(self, seed: int) -> Image:
        """A picture that needs no resize, so that both see the same pixels."""
        return picture(self.size, self.size, seed)

    def maps(self, frame: Image, words: Sequence[str]) -> tuple[Array, Array]:
        """Our probabilities and theirs, (k, h, w)."""
        ours = self.ours.attend(self.ours.encode(frame), [Prompt(word) for word in words])
        return ours, self.theirs.probabilities(self.theirs.pixels(frame), words)


def mask_iou(ours: Array, theirs: Array) -> float:
    """The worst IoU of maps (k, h, w), both cut at the median of theirs."""
    level = np.median(theirs, axis=(1, 2), keepdims=True)
    first, second = ours > level, theirs > level
    return float(((first & second).sum(axis=(1, 2)) / (first | second).sum(axis=(1, 2))).min())


def cosine(first: Array, second: Array) -> float:
    return float(first @ second / (np.linalg.norm(first) * np.linalg.norm(second)))


class Theirs:
    """transformers' CLIPSegForImageSegmentation and tokenizer, of a checkpoint's folder."""

    def __init__(self, folder: Path) -> None:
        import transformers

        self._model: Any = transformers.CLIPSegForImageSegmentation.from_pretrained(folder).eval()
        self._tokenizer: Any = transformers.CLIPTokenizerFast.from_pretrained(folder)
        self._folder = folder

    def tokens(self, words: Sequence[str]) -> list[list[int]]:
        """Ids without padding."""
        ids: list[list[int]] = self._tokenizer(list(words))["input_ids"]
        return ids

    def conditions(self, words: Sequence[str]) -> Array:
        """(k, joint)."""
        given = self._tokenizer(
            list(words), padding=True, truncation=True, max_length=77, return_tensors="pt"
        )
        made = self._model.get_conditional_embeddings(
            batch_size=len(words), input_ids=given.input_ids, attention_mask=given.attention_mask
        )
        return as_array(made)

    def probabilities(self, pixels: Any, words: Sequence[str]) -> Array:
        """Of the whole model, every prompt with a picture of its own: (k, h, w)."""
        given = self._tokenizer(list(words), padding=True, return_tensors="pt")
        return self._sigmoid(pixel_values=pixels.expand(len(words), -1, -1, -1), **given)

    def probabilities_of(self, pixels: Any, condition: Array) -> Array:
        """Of one condition, (joint,): (1, h, w)."""
        import torch

        given = torch.from_numpy(condition)[None]
        return self._sigmoid(pixel_values=pixels, conditional_embeddings=given)

    def image_embedding(self, pixels: Any) -> Array:
        """(joint,), also the condition that a picture is."""
        made = self._model.get_conditional_embeddings(batch_size=1, conditional_pixel_values=pixels)
        return as_array(made).reshape(-1)

    def pixels(self, frame: Image) -> Any:
        """What its own image processor makes of a frame, with Pillow."""
        return processed(self._folder, "vit", "ViTImageProcessor", frame)

    def _sigmoid(self, **given: Any) -> Array:
        import torch

        with torch.no_grad():
            made = as_array(torch.sigmoid(self._model(**given).logits))
        return made.reshape(-1, *made.shape[-2:])


def scene_embedding(folder: Path, frame: Image) -> Array:
    """(joint,), by CLIPVisionModelWithProjection and its own image processor."""
    import torch
    from transformers import CLIPVisionModelWithProjection

    model: Any = CLIPVisionModelWithProjection.from_pretrained(folder).eval()
    with torch.no_grad():
        made = model(processed(folder, "clip", "CLIPImageProcessor", frame)).image_embeds
    return as_array(made).reshape(-1)


def processed(folder: Path, model: str, name: str, frame: Image) -> Any:
    """Pixel values, (1, 3, h, w), by an image processor of transformers, the one with Pillow."""
    from PIL.Image import fromarray

    try:
        module = importlib.import_module(f"transformers.models.{model}.image_processing_pil_{model}")
        kind = getattr(module, f"{name}Pil")
    except ImportError:  # before transformers 5 there was no other
        kind = getattr(importlib.import_module("transformers"), name)
    return kind.from_pretrained(folder)(images=fromarray(frame), return_tensors="pt")["pixel_values"]


def as_array(tensor: Any) -> Array:
    made: Array = tensor.detach().numpy()
    return made
