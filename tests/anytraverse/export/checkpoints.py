"""Checkpoints of random weights, small unless told otherwise, as transformers saves them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bench.clipseg.checkpoints import CLIP_IMAGES, CLIPSEG_IMAGES, TINY, quieten_transformers
from bench.clipseg.vocabulary import write_tokenizer


def write_clipseg(
    folder: Path,
    changes: Mapping[str, Any],
    size: int = 96,
    seed: int = 0,
    images: Mapping[str, Any] | None = None,
    base: Mapping[str, Any] = TINY.clipseg,
) -> Path:
    """A CLIPSeg checkpoint for pictures of size x size: the config `base` with changes; `images`: changes of
    preprocessor_config.json."""
    from transformers import CLIPSegConfig, CLIPSegForImageSegmentation

    config = merged(base, changes)
    quieten_transformers()
    model = CLIPSegForImageSegmentation(CLIPSegConfig(**config)).eval()
    redraw(model, seed)
    spread_logits(model, size)
    model.save_pretrained(folder)
    write_tokenizer(folder, model.config.text_config.vocab_size)
    sides = {"size": {"height": size, "width": size}}
    write_json(folder / "preprocessor_config.json", {**CLIPSEG_IMAGES, **sides, **(images or {})})
    return folder


def write_clip(
    folder: Path, changes: Mapping[str, Any], seed: int = 0, base: Mapping[str, Any] = TINY.clip
) -> Path:
    """A CLIP checkpoint, the config `base` with changes, without the tokenizer that nothing needs."""
    from transformers import CLIPConfig, CLIPModel

    quieten_transformers()
    model = CLIPModel(CLIPConfig(**merged(base, changes))).eval()
    redraw(model, seed)
    model.save_pretrained(folder)
    side = model.config.vision_config.image_size
    write_json(folder / "preprocessor_config.json", {**CLIP_IMAGES, "size": side, "crop_size": side})
    return folder


def merged(config: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    inner = {
        key: merged(config.get(key, {}), value) for key, value in changes.items() if isinstance(value, dict)
    }
    return {**config, **changes, **inner}


def write_json(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content), encoding="utf-8")


def redraw(model: Any, seed: int) -> None:
    """Weights that show every mistake: fresh ones have no biases, norms that do nothing, and no contrast."""
    import torch

    random = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for name, weight in model.named_parameters():
            drawn = torch.randn(weight.shape, generator=random)
            if weight.ndim > 1:
                scale = 3.0 if "film" in name else 1.0  # so that words differ
                weight.copy_(scale * drawn * weight[0].numel() ** -0.5)
            else:
                weight.copy_(0.1 * drawn + float("norm" in name and name.endswith("weight")))


def spread_logits(model: Any, size: int) -> None:
    """Scales the last convolution: logits of a standard deviation of 2, half of them above 0."""
    import torch

    random = torch.Generator().manual_seed(1)
    pixels = torch.randn(1, 3, size, size, generator=random)
    prompt = torch.randn(1, model.config.projection_dim, generator=random)
    with torch.no_grad():
        logits = model(pixel_values=pixels, conditional_embeddings=prompt).logits
        made = model.decoder.transposed_convolution
        last = made[-1] if isinstance(made, torch.nn.Sequential) else made
        gain = 2.0 / float(logits.std())
        last.weight *= gain
        last.bias.copy_(gain * (last.bias - logits.median()))
