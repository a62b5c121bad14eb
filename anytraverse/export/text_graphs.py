"""Writes a text tower in pieces that are loaded one after the other.

So a new word never needs the whole tower in memory beside the image tower.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from anytraverse.export.architecture import Tower, Weights
from anytraverse.export.graph import Graph
from anytraverse.export.layers import Layers
from anytraverse.export.linear import Linear

TEXT_PIECES = 6
"""The most pieces; a tower of fewer layers has one piece for each layer."""

Finish = Callable[[Layers, str], str]
"""Writes what follows the last layer: (layers, x (n, width)) -> the embedding, (1, joint)."""


def text_pieces(
    tower: Tower, weights: Weights, linear: Linear, name: str, joint: int, finish: Finish, *, causal: bool
) -> list[Graph]:
    """Write the pieces of the tower called `name`: tokens (n, width) -> ... -> condition (joint,)."""
    pieces = min(TEXT_PIECES, tower.layers)
    graphs = []
    for first, end in pairwise(tower.layers * piece // pieces for piece in range(pieces + 1)):
        graph = Graph("text")
        layers = Layers(graph, weights, linear, None)
        x = graph.input("tokens", np.float32, ("n", tower.width))
        if first == 0:
            x = _add_positions(graph, x, weights[f"{name}.embeddings.position_embedding.weight"])
        for index in range(first, end):
            x = layers.pre_norm(x, f"{name}.encoder.layers.{index}", tower, causal=causal)
        if end < tower.layers:
            graph.output("further", x, np.float32, ("n", tower.width))
        else:
            graph.output("condition", graph.reshape(finish(layers, x), joint), np.float32, (joint,))
        graphs.append(graph)
    return graphs


def _add_positions(graph: Graph, x: str, table: np.ndarray) -> str:
    zero = np.array([0], dtype=np.int64)
    count = graph.op("Shape", x, start=0, end=1)
    return graph.op("Add", x, graph.op("Slice", graph.constant(table), zero, count, zero))
