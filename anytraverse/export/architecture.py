"""Describes the sizes of a network, as its checkpoint states them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Weights = Mapping[str, NDArray[np.float32]]
"""Name -> array, named as transformers names the parameters of CLIPSegForImageSegmentation."""


@dataclass(frozen=True)
class Tower:
    """Describes a transformer encoder. width: hidden size; inner: size between the two layers of its MLP.

    act: activation of the MLP, "quick_gelu", "gelu", "gelu_pytorch_tanh" or "relu". eps: of its layer norms.
    """

    layers: int
    width: int
    heads: int
    inner: int
    act: str = "quick_gelu"
    eps: float = 1e-5


@dataclass(frozen=True)
class Vision:
    """Describes an image encoder: a tower over patches of patch x patch pixels.

    mean, std: of RGB in [0, 1].
    """

    tower: Tower
    patch: int
    mean: tuple[float, float, float]
    std: tuple[float, float, float]


@dataclass(frozen=True)
class Text:
    """Describes a text encoder of at most `context` tokens; it is read at the token `end`."""

    tower: Tower
    context: int
    start: int
    end: int


@dataclass(frozen=True)
class DenseArchitecture:
    """Describes a model whose patches and texts share a space of `joint` values: SigLIP 2 or TIPSv2.

    family: "siglip": a pooling head makes features of patches, and a text is read at its last token.
    "tipsv2": the tower's output are the features, its first token is the scene, and a text's tokens are
    averaged. before: tokens before the patches. context: the most tokens of a text.
    """

    family: str
    vision: Vision
    before: int
    text: Tower
    context: int
    joint: int


@dataclass(frozen=True)
class Decoder:
    """Describes CLIPSeg's decoder (Lüddecke and Ecker, CVPR 2022).

    extract: the layers of the image tower that it reads, counted from 0. conditional: the step at which the
    prompt is applied. transposed: True: three convolutions make the mask; False: one.
    """

    tower: Tower
    extract: tuple[int, ...]
    conditional: int
    transposed: bool


@dataclass(frozen=True)
class Architecture:
    """Describes a whole CLIPSeg. joint: size of the embedding space that words and pictures share."""

    vision: Vision
    text: Text
    decoder: Decoder
    joint: int

    @property
    def used_layers(self) -> int:
        """The number of image tower layers that the decoder needs; the others only make the embedding."""
        return max(self.decoder.extract) + 1


def architecture(config: Mapping[str, Any], preprocessor: Mapping[str, Any]) -> Architecture:
    """Read the architecture from a checkpoint's config and preprocessor_config. Raises KeyError."""
    vision, text = config["vision_config"], config["text_config"]
    reduced = Tower(
        layers=len(config["extract_layers"]),
        width=config["reduce_dim"],
        heads=config["decoder_num_attention_heads"],
        inner=config["decoder_intermediate_size"],
        act="relu",
        eps=vision["layer_norm_eps"],
    )
    return Architecture(
        Vision(
            _tower(vision),
            vision["patch_size"],
            three(preprocessor["image_mean"]),
            three(preprocessor["image_std"], above=0.0),
        ),
        Text(_tower(text), text["max_position_embeddings"], text["bos_token_id"], text["eos_token_id"]),
        Decoder(
            reduced,
            tuple(config["extract_layers"]),
            config["conditional_layer"],
            config["use_complex_transposed_convolution"],
        ),
        config["projection_dim"],
    )


def vision_architecture(config: Mapping[str, Any], preprocessor: Mapping[str, Any]) -> Vision:
    """Read a CLIP image encoder's architecture; config: the `vision_config` of its checkpoint."""
    mean, std = three(preprocessor["image_mean"]), three(preprocessor["image_std"], above=0.0)
    return Vision(_tower(config), config["patch_size"], mean, std)


def _tower(config: Mapping[str, Any]) -> Tower:
    return Tower(
        config["num_hidden_layers"],
        config["hidden_size"],
        config["num_attention_heads"],
        config["intermediate_size"],
        config["hidden_act"],
        config["layer_norm_eps"],
    )


def three(values: Any, above: float = -math.inf) -> tuple[float, float, float]:
    """Read three finite numbers, each greater than `above`. Raises ValueError and TypeError."""
    red, green, blue = map(float, values)
    if not all(math.isfinite(value) and value > above for value in (red, green, blue)):
        raise ValueError(f"{[red, green, blue]}, expected three finite numbers above {above}")
    return red, green, blue
