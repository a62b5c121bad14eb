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

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from anytraverse.export.architecture import Architecture, Vision, Weights
from anytraverse.export.graph import Graph
from anytraverse.export.layers import Layers
from anytraverse.export.linear import Linear, fp32

Array = NDArray[np.float32]

TEXT_PIECES = 6
"""The most pieces; a tower of fewer layers has one piece for each layer."""

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
    """Write the text tower for one prompt, in pieces that are loaded one after the other.

    There is no padding: under a causal mask it would change nothing.
    """
    layers = arch.text.tower.layers
    pieces = min(TEXT_PIECES, layers)
    cuts = [layers * piece // pieces for piece in range(pieces + 1)]
    return [_text_piece(arch, weights, linear, first, end) for first, end in pairwise(cuts)]


def _text_piece(arch: Architecture, weights: Weights, linear: Linear, first: int, end: int) -> Graph:
    graph = Graph("text")
    tower = arch.text.tower
    layers = Layers(graph, weights, linear, None)
    x = graph.input("tokens", np.float32, ("n", tower.width))
    if first == 0:
        count = graph.op("Shape", x, start=0, end=1)
        table = graph.constant(weights[f"{_TEXT}.embeddings.position_embedding.weight"])
        x = graph.op("Add", x, graph.op("Slice", table, _FIRST, count, _FIRST))
    for index in range(first, end):
        x = layers.pre_norm(x, f"{_TEXT}.encoder.layers.{index}", tower, causal=True)
    if end < tower.layers:
        graph.output("further", x, np.float32, ("n", tower.width))
        return graph
    last = graph.op("Gather", x, np.array([-1], dtype=np.int64), axis=0)
    last = layers.norm(last, f"{_TEXT}.final_layer_norm", tower.eps)
    projected = Layers(graph, weights, fp32, None).linear(last, "clip.text_projection")
    graph.output("condition", graph.reshape(projected, arch.joint), np.float32, (arch.joint,))
    return graph


def embed_patches(layers: Layers, vision: Vision, size: int, name: str) -> str:
    """Write the embedding of a uint8 frame: class token and patches with positions, after the first norm."""
    graph, weights = layers.graph, layers.weights
    side, patch, width = size // vision.patch, vision.patch, vision.tower.width
    frame = graph.input("frame", np.uint8, (size, size, 3))
    tiles = graph.op("Transpose", graph.reshape(frame, side, patch, side, patch, 3), perm=[0, 2, 1, 3, 4])
    pixels = graph.op("Cast", graph.reshape(tiles, side * side, patch * patch * 3), to=1)
    kernel = weights[f"{name}.embeddings.patch_embedding.weight"].transpose(2, 3, 1, 0).astype(np.float64)
    mean, std = (np.array(values).reshape(3, 1) for values in (vision.mean, vision.std))
    scaled = (kernel / (255 * std)).reshape(-1, width).astype(np.float32)
    shift = -(kernel * (mean / std)).sum(axis=(0, 1, 2))
    positions = fit_positions(weights[f"{name}.embeddings.position_embedding.weight"], side)
    embedded = graph.op("Add", graph.op("MatMul", pixels, scaled), (positions[1:] + shift).astype(np.float32))
    first = (weights[f"{name}.embeddings.class_embedding"] + positions[0]).astype(np.float32)
    x = graph.op("Concat", first[None], embedded, axis=0)
    return layers.norm(x, f"{name}.pre_layrnorm", vision.tower.eps)


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


def fit_positions(table: Array, side: int) -> Array:
    """Interpolate the position table (1 + n * n, width) for a grid of side x side: bicubic, as in CLIPSeg.

    As torch does it: a = -0.75, no antialiasing, pixel centres at half integers, edges repeated.
    """
    old = round((len(table) - 1) ** 0.5)
    if old == side:
        return table
    matrix = _cubic_matrix(old, side)
    grid = table[1:].astype(np.float64).reshape(old, old, -1)
    fitted = np.einsum("yi,xj,ijc->yxc", matrix, matrix, grid, optimize=True)
    return np.concatenate([table[:1], fitted.reshape(side * side, -1).astype(np.float32)])


def _cubic_matrix(old: int, new: int) -> NDArray[np.float64]:
    """Make the matrix (new, old) that interpolates `old` samples at the places of `new` ones."""
    matrix = np.zeros((new, old))
    for y in range(new):
        middle = (y + 0.5) * old / new - 0.5
        base = int(np.floor(middle))
        for tap in range(base - 1, base + 3):
            matrix[y, min(max(tap, 0), old - 1)] += _cubic(abs(middle - tap))
    return matrix


def _cubic(distance: float, a: float = -0.75) -> float:
    if distance <= 1:
        return ((a + 2) * distance - (a + 3)) * distance * distance + 1
    return ((a * distance - 5 * a) * distance + 8 * a) * distance - 4 * a if distance < 2 else 0.0
