"""Reads checkpoints of SigLIP 2 and TIPSv2 with transformers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from anytraverse.errors import BundleError
from anytraverse.export.architecture import DenseArchitecture, Tower, Vision, three
from anytraverse.export.checkpoint import (
    describe,
    load_weights,
    read_configs,
    read_json,
    resize_filter,
    stated_in,
)
from anytraverse.export.dense_making import DenseCheckpoint
from anytraverse.export.hub import CONFIGS, find_checkpoint
from anytraverse.export.tokens import dense_tokenizer

Arrays = dict[str, np.ndarray]

MODELS = {
    "siglip": ("SiglipConfig", "SiglipModel", "google/siglip2-base-patch16-256"),
    "tipsv2": ("Tipsv2Config", "Tipsv2Model", "google/tipsv2-b14"),
}
"""Family -> transformers' config and model, and a checkpoint of the hub."""

_SCALED = ((1, "attention.o_proj", "self_attn.out_proj"), (2, "mlp.fc2", "mlp.fc2"))
"""The scales in a layer of TIPSv2, and the products that they follow: (number, its name, our name)."""


def load_dense(checkpoint: str, family: str, texts: Sequence[str]) -> DenseCheckpoint:
    """Load a checkpoint of a dense model: a folder, or an id of the hub.

    texts: for which the tokenizer must agree with the checkpoint's own. Raises BundleError without a network,
    for a missing or damaged file, and for another model.
    """
    import transformers

    config_name, model_name, like = MODELS[family]
    if not hasattr(transformers, model_name):
        raise BundleError(
            f"transformers {transformers.__version__} does not know {model_name}: "
            "pip install --upgrade transformers"
        )
    folder, revision = find_checkpoint(checkpoint, words=True)
    stated = read_json(folder / CONFIGS[0])
    if "vision_config" not in stated or "text_config" not in stated:
        raise BundleError(
            f"{folder} is not in the format of transformers, it has no vision_config and text_config: "
            f"give a newer revision, such as {like} on the hub"
        )
    config, preprocessor = read_configs(folder, getattr(transformers, config_name), like)
    with stated_in(folder):
        vision, text = config["vision_config"], config["text_config"]
        for name in ("image_size", "patch_size"):
            if type(vision[name]) is not int:
                raise BundleError(f"{folder}: {name} is {vision[name]}: only square pictures can be exported")
        normalised = family == "siglip"
        pixels = resize_filter(preprocessor, folder, 3 if normalised else 2, normalised=normalised)
        arch = _architecture(family, vision, text, preprocessor, folder)
    weights = load_weights(getattr(transformers, model_name), folder)
    with stated_in(folder):
        named, tokens = (_siglip if family == "siglip" else _tipsv2)(weights, arch, text)
    return DenseCheckpoint(
        arch,
        named,
        tokens,
        dense_tokenizer(folder, family, arch.context, texts),
        vision["image_size"],
        pixels,
        describe(checkpoint, folder, revision),
    )


def _architecture(
    family: str,
    vision: Mapping[str, Any],
    text: Mapping[str, Any],
    preprocessor: Mapping[str, Any],
    folder: Path,
) -> DenseArchitecture:
    width = vision["hidden_size"]
    if family == "siglip":
        if not vision["vision_use_head"] or text["projection_size"] != width:
            raise BundleError(f"{folder} has no pooling head into the space of its texts: give another one")
        inner, before = vision["intermediate_size"], 0
        mean = three(preprocessor.get("image_mean", [0.5] * 3))
        std = three(preprocessor.get("image_std", [0.5] * 3), above=0.0)
    else:
        if vision["use_swiglu_ffn"] or text["hidden_size"] != width:
            raise BundleError(f"{folder} is a larger TIPSv2 than can be exported: give one like tipsv2-b14")
        inner, before = int(width * vision["mlp_ratio"]), 1 + vision["num_register_tokens"]
        mean, std = three([0.0] * 3), three([1.0] * 3)
    seen = Vision(_tower(vision, inner), vision["patch_size"], mean, std)
    words, context = _tower(text, text["intermediate_size"]), text["max_position_embeddings"]
    return DenseArchitecture(family, seen, before, words, context, width)


def _tower(stated: Mapping[str, Any], inner: int) -> Tower:
    return Tower(
        stated["num_hidden_layers"],
        stated["hidden_size"],
        stated["num_attention_heads"],
        inner,
        stated["hidden_act"],
        stated["layer_norm_eps"],
    )


def _siglip(
    weights: Mapping[str, np.ndarray], _arch: DenseArchitecture, _text: Mapping[str, Any]
) -> tuple[Arrays, np.ndarray]:
    """Return the weights by the names that `dense_graphs` reads, and the table of tokens."""
    named = _renamed(
        weights,
        {
            "vision_model.encoder.": "vision.encoder.",
            "vision_model.post_layernorm.": "vision.post_layernorm.",
            "vision_model.embeddings.patch_embedding.": "vision.patch.",
            "vision_model.head.": "head.",
            "text_model.encoder.": "text.encoder.",
            "text_model.final_layer_norm.": "text.final_layer_norm.",
            "text_model.head.": "text.head.",
        },
    )
    named["vision.positions"] = weights["vision_model.embeddings.position_embedding.weight"]
    named["head.probe"] = named["head.probe"].reshape(1, -1)
    for kind in ("weight", "bias"):
        joined = named.pop(f"head.attention.in_proj_{kind}")
        for part, piece in zip("qkv", np.split(joined, 3), strict=True):
            named[f"head.attention.{part}_proj.{kind}"] = piece
    place = "text.embeddings.position_embedding.weight"
    named[place] = weights["text_model.embeddings.position_embedding.weight"]
    return named, weights["text_model.embeddings.token_embedding.weight"]


def _tipsv2(
    weights: Mapping[str, np.ndarray], arch: DenseArchitecture, text: Mapping[str, Any]
) -> tuple[Arrays, np.ndarray]:
    """Return the same for TIPSv2. The scale of each layer's output becomes part of its last product."""
    named = _renamed(
        weights,
        {
            "vision_model.layernorm.": "vision.post_layernorm.",
            "vision_model.embeddings.patch_embeddings.projection.": "vision.patch.",
            "text_model.encoder.": "text.encoder.",
            "text_model.final_layer_norm.": "text.final_layer_norm.",
        },
    )
    width = arch.vision.tower.width
    for index in range(arch.vision.tower.layers):
        old, new = f"vision_model.encoder.layer.{index}", f"vision.encoder.layers.{index}"
        for kind in ("weight", "bias"):
            for number in (1, 2):
                named[f"{new}.layer_norm{number}.{kind}"] = weights[f"{old}.norm{number}.{kind}"]
            for part in "qkv":  # a checkpoint may have no biases here
                given = weights.get(f"{old}.attention.{part}_proj.{kind}", np.zeros(width, dtype=np.float32))
                named[f"{new}.self_attn.{part}_proj.{kind}"] = given
            named[f"{new}.mlp.fc1.{kind}"] = weights[f"{old}.mlp.fc1.{kind}"]
            for number, source, target in _SCALED:
                scale = weights[f"{old}.layer_scale{number}.lambda1"]
                value = weights[f"{old}.{source}.{kind}"]
                named[f"{new}.{target}.{kind}"] = (value.T * scale).T
    positions = weights["vision_model.embeddings.position_embeddings"][0]
    first = weights["vision_model.embeddings.cls_token"][0] + positions[:1]
    named["vision.before"] = np.concatenate([first, weights["vision_model.embeddings.register_tokens"][0]])
    named["vision.positions"] = positions[1:]
    named["text.embeddings.position_embedding.weight"] = _sinusoids(arch.context, arch.text.width)
    depth = math.sqrt(arch.text.width) if text["scale_sqrt_depth"] else 1.0
    return named, weights["text_model.embeddings.token_embedding.weight"] * np.float32(depth)


def _renamed(weights: Mapping[str, np.ndarray], prefixes: Mapping[str, str]) -> Arrays:
    return {
        new + name.removeprefix(old): value
        for name, value in weights.items()
        for old, new in prefixes.items()
        if name.startswith(old)
    }


def _sinusoids(count: int, width: int) -> np.ndarray:
    """Make the positions of a text, (count, width): sines, then cosines, and a 0 where width is odd."""
    half = width // 2
    rates = np.exp(np.arange(half) * -(math.log(10000) / (half - 1)))
    angles = np.arange(count)[:, None] * rates
    table = np.concatenate([np.sin(angles), np.cos(angles), np.zeros((count, width % 2))], axis=1)
    return table.astype(np.float32)
