"""Writes CLIPSeg's decoder as a graph: k prompts in one batch, on one frame's activations."""

from __future__ import annotations

import numpy as np

from anytraverse.export.architecture import Architecture, Weights
from anytraverse.export.graph import Graph
from anytraverse.export.layers import Layers
from anytraverse.export.linear import Linear, fp32

_MASK = "decoder.transposed_convolution"


def decoder_graph(arch: Architecture, weights: Weights, size: int, linear: Linear) -> Graph:
    """Write the decoder.

    activations (steps, tokens, reduced), conditions (k, joint) -> attention (k, h, w), magnitude (k,).
    """
    graph = Graph("decoder")
    side = size // arch.vision.patch
    tokens, width = side * side + 1, arch.decoder.tower.width
    layers = Layers(graph, weights, linear, tokens)
    plain = Layers(graph, weights, fp32, tokens)
    depth = len(arch.decoder.extract)
    activations = graph.input("activations", np.float32, (depth, tokens, width))
    conditions = graph.input("conditions", np.float32, ("k", arch.joint))
    x = ""
    batched = False
    for step in range(depth):
        given = graph.op("Gather", activations, np.array(step, dtype=np.int64), axis=0)
        if not x:
            x = given
        elif batched:
            shaped = graph.op("Add", graph.reshape(x, -1, tokens, width), given)
            x = graph.reshape(shaped, -1, width)
        else:
            x = graph.op("Add", x, given)
        if step == arch.decoder.conditional:
            x = _modulate(plain, x, conditions, width)
            batched = True
        x = layers.post_norm(x, f"decoder.layers.{step}", arch.decoder.tower)
    x = graph.reshape(x, -1, tokens, width)
    x = graph.op("Slice", x, *(np.array([value], dtype=np.int64) for value in (1, tokens, 1)))
    logits, edge = _mask(plain, arch, x, side)
    graph.output("attention", graph.op("Sigmoid", logits), np.float32, ("k", edge, edge))
    graph.output("magnitude", _magnitude(graph, logits), np.float32, ("k",))
    return graph


def _modulate(layers: Layers, x: str, conditions: str, width: int) -> str:
    """Apply the prompts (FiLM): x * mul + add for each; (tokens, width) -> (k * tokens, width)."""
    graph = layers.graph
    mul, add = (
        graph.reshape(layers.linear(conditions, f"decoder.film_{part}"), -1, 1, width)
        for part in ("mul", "add")
    )
    return graph.reshape(graph.op("Add", graph.op("Mul", x, mul), add), -1, width)


def _mask(layers: Layers, arch: Architecture, x: str, side: int) -> tuple[str, int]:
    """Turn tokens (k, side * side, width) into logits (k, edge, edge).

    A transposed convolution whose stride is its kernel size is a matrix product for each cell; the results
    are then arranged in the image.
    """
    graph, weights = layers.graph, layers.weights
    width, patch = arch.decoder.tower.width, arch.vision.patch
    if not arch.decoder.transposed:
        kernel = weights[f"{_MASK}.weight"]
        return _lay_out(graph, _spread(graph, x, kernel, weights[f"{_MASK}.bias"]), side, (patch,))
    cells = graph.op("Transpose", graph.reshape(x, -1, side, side, width), perm=[0, 3, 1, 2])
    kernel, bias = weights[f"{_MASK}.0.weight"], weights[f"{_MASK}.0.bias"]
    cells = graph.op("Relu", graph.op("Conv", cells, kernel, bias, pads=[1, 1, 1, 1]))
    cells = graph.op("Transpose", cells, perm=[0, 2, 3, 1])
    for part in (2, 4):
        kernel, bias = weights[f"{_MASK}.{part}.weight"], weights[f"{_MASK}.{part}.bias"]
        cells = graph.reshape(cells, -1, kernel.shape[0])
        cells = _spread(graph, cells, kernel, bias)
        if part == 2:
            cells = graph.op("Relu", cells)
    return _lay_out(graph, cells, side, (patch // 4, patch // 4))


def _spread(graph: Graph, cells: str, kernel: np.ndarray, bias: np.ndarray) -> str:
    """Multiply each cell (inputs,) out to its square of (size, size, outputs)."""
    inputs, outputs, size, _ = kernel.shape
    weight = kernel.transpose(0, 2, 3, 1).reshape(inputs, size * size * outputs)
    return fp32(graph, graph.reshape(cells, -1, inputs), weight, np.tile(bias, size * size))


def _lay_out(graph: Graph, cells: str, side: int, sizes: tuple[int, ...]) -> tuple[str, int]:
    """Arrange nested squares as one image, (k, edge, edge)."""
    edge = side * int(np.prod(sizes))
    pairs = [size for size in sizes for _ in range(2)]
    nested = graph.reshape(cells, -1, side, side, *pairs)
    rows = [1, *range(3, 3 + len(pairs), 2)]
    columns = [2, *range(4, 4 + len(pairs), 2)]
    return graph.reshape(graph.op("Transpose", nested, perm=[0, *rows, *columns]), -1, edge, edge), edge


def _magnitude(graph: Graph, logits: str) -> str:
    """Sum |logit| of each prompt: a sigmoid would hide an infinity, and a maximum a NaN."""
    return graph.op("ReduceL1", logits, np.array([1, 2], dtype=np.int64), keepdims=0)
