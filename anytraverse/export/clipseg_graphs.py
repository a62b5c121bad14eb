"""Writes CLIPSeg (Lüddecke and Ecker, CVPR 2022) as graphs, each of which runs only when it is needed.

    image    frame (h, w, 3) uint8 -> activations (steps, tokens, reduced), deep (tokens, width)
    tail     deep -> embedding (joint,), not of unit norm
    decoder  activations, conditions (k, joint) -> attention (k, h, w) in [0, 1], and magnitude (k,), the sum
             of |logit|: finite where all of them are
    text     tokens (n, width), the rows of the token table -> condition (joint,), read at the last token;
             in pieces, so that a new word never needs the whole text tower in memory beside the image tower

All rewrites are exact: normalisation is folded into the patches' weights, positions are interpolated at
export, what does not depend on the prompt is moved out of the decoder, and the last layer computes one token.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from anytraverse.export.architecture import Architecture, Vision, Weights
from anytraverse.export.graph import Graph
from anytraverse.export.layers import Layers
from anytraverse.export.linear import Linear, fp32
from anytraverse.export.positions import fit_positions
from anytraverse.export.text_graphs import text_pieces

Array = NDArray[np.float32]

_VISION = "clip.vision_model"
_TEXT = "clip.text_model"
_FIRST = np.array([0], dtype=np.int64)


def image_graph(arch: Architecture, weights: Weights, size: int, linear: Linear) -> Graph:
    """Write the image tower up to the last layer that the decoder reads, and the decoder's first products."""
    graph = Graph("image")
    tokens = (size // arch.vision.patch) ** 2 + 1
    layers = Layers(graph, weights, linear, tokens)
    plain = Layers(graph, weights, fp32, tokens)
    x = embed_patches(plain, arch.vision, size, _VISION)
    reduced: dict[int, str] = {}
    depth = len(arch.decoder.extract)
    for index in range(arch.used_layers):
        x = layers.pre_norm(x, f"{_VISION}.encoder.layers.{index}", arch.vision.tower)
        if index in arch.decoder.extract:
            step = depth - 1 - arch.decoder.extract.index(index)
            reduced[step] = graph.op("Unsqueeze", plain.linear(x, f"decoder.reduces.{step}"), _FIRST)
    joined = graph.op("Concat", *(reduced[step] for step in range(depth)), axis=0)
    graph.output("activations", joined, np.float32, (depth, tokens, arch.decoder.tower.width))
    graph.output("deep", x, np.float32, (tokens, arch.vision.tower.width))
    return graph


def tail_graph(arch: Architecture, weights: Weights, size: int, linear: Linear) -> Graph:
    """Write the rest of the image tower: the picture's embedding in the space that it shares with words."""
    graph = Graph("tail")
    tokens = (size // arch.vision.patch) ** 2 + 1
    layers = Layers(graph, weights, linear, tokens)
    x = graph.input("deep", np.float32, (tokens, arch.vision.tower.width))
    finish_tower(layers, arch.vision, x, arch.used_layers, _VISION, "clip.visual_projection", arch.joint)
    return graph


def scene_graph(vision: Vision, weights: Weights, size: int, linear: Linear) -> Graph:
    """Write a whole CLIP image encoder as one graph: frame (size, size, 3) uint8 -> embedding (joint,)."""
    graph = Graph("scene")
    layers = Layers(graph, weights, linear, (size // vision.patch) ** 2 + 1)
    x = embed_patches(Layers(graph, weights, fp32, layers.tokens), vision, size, "vision_model")
    last = vision.tower.layers - 1
    for index in range(last):
        x = layers.pre_norm(x, f"vision_model.encoder.layers.{index}", vision.tower)
    joint = len(weights["visual_projection.weight"])
    finish_tower(layers, vision, x, last, "vision_model", "visual_projection", joint)
    return graph


def text_graphs(arch: Architecture, weights: Weights, linear: Linear) -> list[Graph]:
    """Write the text tower for one prompt. No padding: under a causal mask it would change nothing."""

    def finish(layers: Layers, x: str) -> str:
        last = layers.graph.op("Gather", x, np.array([-1], dtype=np.int64), axis=0)
        last = layers.norm(last, f"{_TEXT}.final_layer_norm", arch.text.tower.eps)
        return Layers(layers.graph, weights, fp32, None).linear(last, "clip.text_projection")

    return text_pieces(arch.text.tower, weights, linear, _TEXT, arch.joint, finish, causal=True)


def embed_patches(layers: Layers, vision: Vision, size: int, name: str) -> str:
    """Write the embedding of a uint8 frame: class token and patches with positions, after the first norm."""
    graph, weights = layers.graph, layers.weights
    positions = fit_positions(weights[f"{name}.embeddings.position_embedding.weight"], size // vision.patch)
    kernel = weights[f"{name}.embeddings.patch_embedding.weight"]
    embedded = embed_pixels(graph, vision, size, kernel, positions[1:])
    first = (weights[f"{name}.embeddings.class_embedding"] + positions[0]).astype(np.float32)
    x = graph.op("Concat", first[None], embedded, axis=0)
    return layers.norm(x, f"{name}.pre_layrnorm", vision.tower.eps)


def embed_pixels(graph: Graph, vision: Vision, size: int, kernel: Array, shifts: Array) -> str:
    """Write the input, a uint8 frame (size, size, 3), and the products of its patches: (patches, width).

    kernel: (width, 3, patch, patch), for normalised pixels. shifts: what is added, (patches, width).
    """
    side, patch, width = size // vision.patch, vision.patch, vision.tower.width
    frame = graph.input("frame", np.uint8, (size, size, 3))
    tiles = graph.op("Transpose", graph.reshape(frame, side, patch, side, patch, 3), perm=[0, 2, 1, 3, 4])
    pixels = graph.op("Cast", graph.reshape(tiles, side * side, patch * patch * 3), to=1)
    exact = kernel.transpose(2, 3, 1, 0).astype(np.float64)
    mean, std = (np.array(values).reshape(3, 1) for values in (vision.mean, vision.std))
    scaled = (exact / (255 * std)).reshape(-1, width).astype(np.float32)
    shift = -(exact * (mean / std)).sum(axis=(0, 1, 2))
    return graph.op("Add", graph.op("MatMul", pixels, scaled), (shifts + shift).astype(np.float32))


def finish_tower(
    layers: Layers, vision: Vision, x: str, done: int, name: str, projection: str, joint: int
) -> None:
    """Write the layers from `done` on, the last for the class token alone, and the projection to `joint`."""
    graph = layers.graph
    last = vision.tower.layers - 1
    for index in range(done, last):
        x = layers.pre_norm(x, f"{name}.encoder.layers.{index}", vision.tower)
    if done <= last:
        x = layers.first_pre_norm(x, f"{name}.encoder.layers.{last}", vision.tower)
    else:
        x = graph.op("Gather", x, _FIRST, axis=0)
    x = layers.norm(x, f"{name}.post_layernorm", vision.tower.eps)
    embedding = Layers(graph, layers.weights, fp32, layers.tokens).linear(x, projection)
    graph.output("embedding", graph.reshape(embedding, joint), np.float32, (joint,))
