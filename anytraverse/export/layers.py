"""Writes the layers of CLIP's and similar transformers in the form that ONNX Runtime runs fastest.

Activations are (batch * tokens, width) except in attention itself. Queries, keys and values come from one
product; attention and quick GELU are ONNX Runtime's fused operators.
"""

from __future__ import annotations

import numpy as np

from anytraverse.errors import BundleError
from anytraverse.export.architecture import Tower, Weights
from anytraverse.export.graph import FAST, Graph
from anytraverse.export.linear import Linear

_FIRST = np.array([0], dtype=np.int64)
_SLICES = 4
"""Of the decoder's hidden values: two prompts' 2048 for each of 485 tokens are 8 MB, a quarter is 2 MB."""


class Layers:
    """Writes layers into a graph from the weights of a checkpoint. Methods return the name of their output.

    linear: writes the products x W + b, in the chosen precision.
    tokens: the number of tokens of one picture; None for one text of any length.
    """

    def __init__(self, graph: Graph, weights: Weights, linear: Linear, tokens: int | None) -> None:
        self.graph = graph
        self.weights = weights
        self.tokens = tokens
        self._linear = linear

    def linear(self, x: str, name: str) -> str:
        """Write the product with the weights called `name`, and their bias, if any."""
        weight = self.weights[f"{name}.weight"]
        return self._linear(self.graph, x, weight.T, self.weights.get(f"{name}.bias"))

    def norm(self, x: str, name: str, eps: float) -> str:
        """Write a layer normalisation."""
        scale, shift = self.weights[f"{name}.weight"], self.weights[f"{name}.bias"]
        return self.graph.op("LayerNormalization", x, scale, shift, axis=-1, epsilon=eps)

    def act(self, x: str, kind: str) -> str:
        """Write an activation by its name in the checkpoint. Raises BundleError for an unknown one."""
        if kind == "quick_gelu":
            return self.graph.op("QuickGelu", x, domain=FAST, alpha=1.702)
        if kind == "gelu":
            return self.graph.op("Gelu", x, domain=FAST)
        if kind == "relu":
            return self.graph.op("Relu", x)
        if kind == "gelu_pytorch_tanh":
            return self.graph.op("FastGelu", x, domain=FAST)
        raise BundleError(
            f'the activation "{kind}" cannot be exported, only quick_gelu, gelu, gelu_pytorch_tanh and relu'
        )

    def mlp(self, x: str, name: str, act: str, slices: int = 1) -> str:
        """Write two products with an activation between them.

        slices: in how many parts the hidden values are computed, one after the other; each is then small
        enough to stay in the core's cache from its first product to its second.
        """
        first, shift = self.weights[f"{name}.fc1.weight"], self.weights[f"{name}.fc1.bias"]
        second, last = self.weights[f"{name}.fc2.weight"], self.weights[f"{name}.fc2.bias"]
        total = ""
        for part in np.array_split(np.arange(len(first)), slices):
            hidden = self.act(self._linear(self.graph, x, first[part].T, shift[part]), act)
            made = self._linear(self.graph, hidden, second[:, part].T, None if total else last)
            total = self.graph.op("Add", total, made) if total else made
        return total

    def attention(self, x: str, name: str, heads: int, *, causal: bool = False) -> str:
        """Write the self-attention of all tokens."""
        graph = self.graph
        weight, bias = self._stacked(name, ("q_proj", "k_proj", "v_proj"))
        joined = self._linear(graph, x, weight, bias)
        width = weight.shape[0]
        parts = graph.split_op("Split", joined, np.array([width] * 3, dtype=np.int64), outputs=3, axis=1)
        return self.linear(self._attend(parts, width, heads, causal=causal), f"{name}.out_proj")

    def first_attention(self, first: str, x: str, name: str, heads: int) -> str:
        """Write the attention of the first token to all: `first` is (1, width), `x` (tokens, width)."""
        graph = self.graph
        weight, bias = self._stacked(name, ("k_proj", "v_proj"))
        joined = self._linear(graph, x, weight, bias)
        width = weight.shape[0]
        keys, values = graph.split_op(
            "Split", joined, np.array([width] * 2, dtype=np.int64), outputs=2, axis=1
        )
        query = graph.reshape(self.linear(first, f"{name}.q_proj"), 1, 1, width)
        batched = [graph.reshape(part, 1, -1, width) for part in (keys, values)]
        attended = graph.op("MultiHeadAttention", query, *batched, domain=FAST, num_heads=heads)
        return self.linear(graph.reshape(attended, 1, width), f"{name}.out_proj")

    def pre_norm(self, x: str, name: str, tower: Tower, *, causal: bool = False) -> str:
        """Write a layer of CLIP's encoders: norm, attention, add; norm, MLP, add."""
        normed = self.norm(x, f"{name}.layer_norm1", tower.eps)
        x = self.graph.op("Add", x, self.attention(normed, f"{name}.self_attn", tower.heads, causal=causal))
        return self._pre_norm_mlp(x, name, tower)

    def first_pre_norm(self, x: str, name: str, tower: Tower) -> str:
        """Write the same for the first token alone, (1, width): nothing else of the last layer is read."""
        graph = self.graph
        normed = self.norm(x, f"{name}.layer_norm1", tower.eps)
        first = graph.op("Gather", x, _FIRST, axis=0)
        normed_first = graph.op("Gather", normed, _FIRST, axis=0)
        first = graph.op(
            "Add", first, self.first_attention(normed_first, normed, f"{name}.self_attn", tower.heads)
        )
        return self._pre_norm_mlp(first, name, tower)

    def post_norm(self, x: str, name: str, tower: Tower) -> str:
        """Write a layer of CLIPSeg's decoder: attention, add, norm; MLP, add, norm."""
        x = self.graph.op("Add", x, self.attention(x, f"{name}.self_attn", tower.heads))
        x = self.norm(x, f"{name}.layer_norm1", tower.eps)
        x = self.graph.op("Add", x, self.mlp(x, f"{name}.mlp", tower.act, _SLICES))
        return self.norm(x, f"{name}.layer_norm2", tower.eps)

    def _pre_norm_mlp(self, x: str, name: str, tower: Tower) -> str:
        normed = self.norm(x, f"{name}.layer_norm2", tower.eps)
        return self.graph.op("Add", x, self.mlp(normed, f"{name}.mlp", tower.act))

    def _stacked(self, name: str, parts: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
        weight = np.concatenate([self.weights[f"{name}.{part}.weight"] for part in parts]).T
        return weight, np.concatenate([self.weights[f"{name}.{part}.bias"] for part in parts])

    def _attend(self, parts: list[str], width: int, heads: int, *, causal: bool = False) -> str:
        """Write the attention of queries, keys and values; the operator needs the batch as an axis."""
        batch = (1, -1) if self.tokens is None else (-1, self.tokens)
        batched = [self.graph.reshape(part, *batch, width) for part in parts]
        attended = self.graph.op(
            "MultiHeadAttention", *batched, domain=FAST, num_heads=heads, unidirectional=int(causal)
        )
        return self.graph.reshape(attended, -1, width)
