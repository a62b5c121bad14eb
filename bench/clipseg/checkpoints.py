"""Makes checkpoints with random weights and the true architectures: training does not change a step's cost.

Run: python -m bench.clipseg.checkpoints FOLDER [--tiny] [--seed N]
"""

from __future__ import annotations

import argparse
import json
import shutil
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bench.clipseg.vocabulary import FULL_SIZE, write_tokenizer

FORMAT = 1
"""Raise it when this file makes other checkpoints: those of another format are then made again."""

SPREAD = 2.0
"""Standard deviation of a map's logits on noise, so that no mask is all one or all the other."""

CLIPSEG_IMAGES = {
    "do_normalize": True,
    "do_rescale": True,
    "do_resize": True,
    "feature_extractor_type": "ViTImageProcessor",
    "image_mean": [0.485, 0.456, 0.406],
    "image_std": [0.229, 0.224, 0.225],
    "processor_class": "CLIPSegProcessor",
    "resample": 2,
    "rescale_factor": 1 / 255,
}
CLIP_IMAGES = {
    "do_center_crop": True,
    "do_normalize": True,
    "do_resize": True,
    "feature_extractor_type": "CLIPFeatureExtractor",
    "image_mean": [0.48145466, 0.4578275, 0.40821073],
    "image_std": [0.26862954, 0.26130258, 0.27577711],
    "resample": 3,
}
OLD_IDS = {"bos_token_id": 0, "eos_token_id": 2}
"""As the published configs have them; the text tower then pools at the highest token id."""


@dataclass(frozen=True)
class _Architecture:
    """What differs between the published models and their tiny likenesses. Sizes in pixels."""

    clipseg_image: int
    clipseg: dict[str, Any]
    clip_image: int
    clip: dict[str, Any]
    vocabulary: int


PUBLISHED = _Architecture(
    clipseg_image=352,
    clipseg={
        "reduce_dim": 64,
        "use_complex_transposed_convolution": True,
        "text_config": OLD_IDS,
        "vision_config": {"patch_size": 16, "image_size": 224},
    },
    clip_image=224,
    clip={"text_config": OLD_IDS, "vision_config": {"patch_size": 32, "image_size": 224}},
    vocabulary=FULL_SIZE,
)
"""CLIPSeg rd64-refined, whose 14 x 14 position table is interpolated to 22 x 22, and CLIP ViT-B/32."""

_SMALL = {"hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 4, "num_attention_heads": 2}
_SMALL_TEXT = {**_SMALL, **OLD_IDS, "vocab_size": 1024, "num_hidden_layers": 2}
TINY = _Architecture(
    clipseg_image=96,
    clipseg={
        "reduce_dim": 16,
        "use_complex_transposed_convolution": True,
        "projection_dim": 24,
        "extract_layers": [0, 1, 2],
        "decoder_num_attention_heads": 2,
        "decoder_intermediate_size": 32,
        "text_config": _SMALL_TEXT,
        "vision_config": {**_SMALL, "patch_size": 16, "image_size": 64},
    },
    clip_image=64,
    clip={
        "projection_dim": 24,
        "text_config": {**_SMALL_TEXT, "projection_dim": 24},
        "vision_config": {**_SMALL, "patch_size": 16, "image_size": 64, "projection_dim": 24},
    },
    vocabulary=1024,
)


@dataclass(frozen=True)
class Checkpoints:
    """Two folders in the layout of a download from the hub."""

    clipseg: Path
    clip: Path


def make_checkpoints(folder: Path, architecture: _Architecture = PUBLISHED, seed: int = 0) -> Checkpoints:
    """Makes the checkpoints of this architecture and seed under `folder` once, about 1.2 GB unless tiny."""
    made = Checkpoints(folder / "clipseg", folder / "clip")
    stamp = json.dumps({"format": FORMAT, "seed": seed, **asdict(architecture)}, sort_keys=True)
    finished = folder / "made.json"
    if finished.is_file() and finished.read_text() == stamp:
        return made
    finished.unlink(missing_ok=True)
    for old in (made.clipseg, made.clip):
        shutil.rmtree(old, ignore_errors=True)
    _write_clipseg(made.clipseg, architecture, seed)
    _write_clip(made.clip, architecture, seed)
    finished.write_text(stamp)
    return made


def _write_clipseg(folder: Path, architecture: _Architecture, seed: int) -> None:
    import torch
    from transformers import CLIPSegConfig, CLIPSegForImageSegmentation

    quieten_transformers()
    torch.manual_seed(seed)
    model = CLIPSegForImageSegmentation(CLIPSegConfig(**architecture.clipseg)).eval()
    side = architecture.clipseg_image
    _spread_logits(model, side)
    model.save_pretrained(folder)
    write_tokenizer(folder, architecture.vocabulary)
    images = {**CLIPSEG_IMAGES, "size": {"height": side, "width": side}}
    (folder / "preprocessor_config.json").write_text(json.dumps(images, indent=2))


def _spread_logits(model: Any, side: int) -> None:
    """Scales and shifts the last convolution: fresh weights give maps of 0.5 and nothing else."""
    import torch

    with torch.no_grad():
        pixels = torch.randn(1, 3, side, side)
        prompt = torch.randn(1, model.config.projection_dim)
        logits = model(pixel_values=pixels, conditional_embeddings=prompt).logits
        convolutions = model.decoder.transposed_convolution
        last = convolutions[-1] if isinstance(convolutions, torch.nn.Sequential) else convolutions
        gain = SPREAD / float(logits.std())
        last.weight *= gain
        last.bias.copy_(gain * (last.bias - logits.median()))


def _write_clip(folder: Path, architecture: _Architecture, seed: int) -> None:
    import torch
    from transformers import CLIPConfig, CLIPModel

    quieten_transformers()
    torch.manual_seed(seed + 1)
    CLIPModel(CLIPConfig(**architecture.clip)).eval().save_pretrained(folder)
    write_tokenizer(folder, architecture.vocabulary)
    images = {**CLIP_IMAGES, "size": architecture.clip_image, "crop_size": architecture.clip_image}
    (folder / "preprocessor_config.json").write_text(json.dumps(images, indent=2))


def quieten_transformers() -> None:
    """Switches off transformers' progress bars and its report of unused weights."""
    from transformers.utils import logging

    logging.disable_progress_bar()
    logging.set_verbosity_error()


def main() -> None:
    parser = argparse.ArgumentParser(description="Make checkpoints with random weights.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--tiny", action="store_true", help="likenesses of a few thousand weights, for tests")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    made = make_checkpoints(given.folder, TINY if given.tiny else PUBLISHED, given.seed)
    print(made.clipseg, made.clip)


if __name__ == "__main__":
    main()
