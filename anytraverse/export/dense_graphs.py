"""Writes SigLIP 2 and TIPSv2 as graphs.

    image    frame (h, w, 3) uint8 -> patches (n, joint), scene (joint,), neither of unit norm
    scores   words (k, joint), directions (joint, n) -> scores (k, n): a product, on as many cores as all else
    text     tokens (n, width), the rows of the token table -> condition (joint,); in pieces

SigLIP's pooling head weighs all patches and passes their sum through an MLP. A patch's feature is what the
head makes of that patch alone. So patches lie in the space of the texts. The weights have the names that
`dense_checkpoint` gives them.
"""

from __future__ import annotations

import numpy as np

from anytraverse.export.architecture import DenseArchitecture, Weights
from anytraverse.export.clipseg_graphs import embed_pixels
from anytraverse.export.graph import FAST, Graph
from anytraverse.export.layers import Layers
from anytraverse.export.linear import Linear, fp32
from anytraverse.export.positions import fit_grid
from anytraverse.export.text_graphs import text_pieces

VISION, TEXT, HEAD = "vision", "text", "head"
_FIRST = np.array([0], dtype=np.int64)
_INTERPOLATION = {"siglip": "bicubic", "tipsv2": "antialiased"}


def image_graph(arch: DenseArchitecture, weights: Weights, size: int, linear: Linear) -> Graph:
    """Write the image tower for pictures of size x size pixels, and the head."""
    graph = Graph("image")
    vision, side = arch.vision, size // arch.vision.patch
    count = side * side
    layers = Layers(graph, weights, linear, arch.before + count)
    shifts = fit_grid(weights[f"{VISION}.positions"], side, _INTERPOLATION[arch.family])
    shifts = shifts + weights[f"{VISION}.patch.bias"]
    x = embed_pixels(graph, vision, size, weights[f"{VISION}.patch.weight"], shifts)
    if arch.before:
        x = graph.op("Concat", graph.constant(weights[f"{VISION}.before"]), x, axis=0)
    for index in range(vision.tower.layers):
        x = layers.pre_norm(x, f"{VISION}.encoder.layers.{index}", vision.tower)
    x = layers.norm(x, f"{VISION}.post_layernorm", vision.tower.eps)
    if arch.family == "siglip":
        x, before = _head(layers, arch, x, count), 1
    else:
        before = arch.before
    scene = graph.op("Gather", x, _FIRST, axis=0)
    rows = np.arange(before, before + count, dtype=np.int64)
    graph.output("patches", graph.op("Gather", x, rows, axis=0), np.float32, (count, arch.joint))
    graph.output("scene", graph.reshape(scene, arch.joint), np.float32, (arch.joint,))
    return graph


def scores_graph(arch: DenseArchitecture, size: int) -> Graph:
    """Write the product of words and patches. numpy's would start threads of its own."""
    graph = Graph("scores")
    count = (size // arch.vision.patch) ** 2
    words = graph.input("words", np.float32, ("k", arch.joint))
    directions = graph.input("directions", np.float32, (arch.joint, count))
    graph.output("scores", graph.op("MatMul", words, directions), np.float32, ("k", count))
    return graph


def text_graphs(arch: DenseArchitecture, weights: Weights) -> list[Graph]:
    """Write the text tower. It runs only for new words, so int8 would gain little."""

    def finish(layers: Layers, x: str) -> str:
        graph = layers.graph
        if arch.family == "siglip":
            x = graph.op("Gather", x, np.array([-1], dtype=np.int64), axis=0)
        x = layers.norm(x, f"{TEXT}.final_layer_norm", arch.text.eps)
        if arch.family == "siglip":
            return layers.linear(x, f"{TEXT}.head")
        return graph.op("ReduceMean", x, np.array([0], dtype=np.int64), keepdims=1)

    return text_pieces(arch.text, weights, fp32, TEXT, arch.joint, finish, causal=False)


def _head(layers: Layers, arch: DenseArchitecture, x: str, count: int) -> str:
    """Write SigLIP's head for all patches together, the first row, and for each alone: (1 + count, width)."""
    graph, weights, width = layers.graph, layers.weights, arch.vision.tower.width
    probe = weights[f"{HEAD}.probe"]
    query = probe @ weights[f"{HEAD}.attention.q_proj.weight"].T + weights[f"{HEAD}.attention.q_proj.bias"]
    keys, values = (layers.linear(x, f"{HEAD}.attention.{part}_proj") for part in "kv")
    pooled = graph.op(
        "MultiHeadAttention",
        query.reshape(1, 1, width).astype(np.float32),
        *(graph.reshape(part, 1, count, width) for part in (keys, values)),
        domain=FAST,
        num_heads=arch.vision.tower.heads,
    )
    x = graph.op("Concat", graph.reshape(pooled, 1, width), values, axis=0)
    x = layers.linear(x, f"{HEAD}.attention.out_proj")
    normed = layers.norm(x, f"{HEAD}.layernorm", arch.vision.tower.eps)
    return graph.op("Add", x, layers.mlp(normed, f"{HEAD}.mlp", arch.vision.tower.act))
