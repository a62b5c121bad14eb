"""Rescales weights at export so that int8 loses less precision. Exact in real numbers.

CLIP's activations have a few channels far larger than the rest, and int8 has one scale for all of them. As in
SmoothQuant (Xiao et al., ICML 2023, arXiv 2211.10438), the scale is moved from a channel into the weights
that read it. The range of a channel is estimated from its layer norm, so that no pictures are needed.
"""

from __future__ import annotations

import numpy as np

from anytraverse.export.architecture import Weights

_SPREADS = 3.0  # the range of a normalised value, in standard deviations
_LEAST = 1e-5


def smoothed(weights: Weights, encoder: str, layers: int) -> Weights:
    """Return the weights with the channels of `encoder`'s norms rescaled, and the products that read them.

    encoder: name of a pre-norm transformer, e.g. "clip.vision_model.encoder".
    """
    changed = dict(weights)
    for index in range(layers):
        layer = f"{encoder}.layers.{index}"
        _rescale(changed, f"{layer}.layer_norm1", [f"{layer}.self_attn.{part}_proj" for part in "qkv"])
        _rescale(changed, f"{layer}.layer_norm2", [f"{layer}.mlp.fc1"])
    return changed


def _rescale(weights: dict[str, np.ndarray], norm: str, readers: list[str]) -> None:
    scale, shift = weights[f"{norm}.weight"], weights[f"{norm}.bias"]
    reach = _SPREADS * np.abs(scale) + np.abs(shift)
    largest = np.max([np.abs(weights[f"{name}.weight"]).max(axis=0) for name in readers], axis=0)
    factor = np.sqrt(np.maximum(reach, _LEAST) / np.maximum(largest, _LEAST))
    factor = (factor / np.exp(np.log(factor).mean())).astype(np.float32)
    weights[f"{norm}.weight"], weights[f"{norm}.bias"] = scale / factor, shift / factor
    for name in readers:
        weights[f"{name}.weight"] = weights[f"{name}.weight"] * factor
