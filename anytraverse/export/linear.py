"""Writes the products x W + b, which take nearly all the time, in the precisions of a bundle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from anytraverse.export.graph import FAST, Graph

Array = NDArray[np.float32]
Linear = Callable[[Graph, str, Array, Array | None], str]
"""(graph, x, weight (inputs, outputs), bias (outputs) or None) -> the product, float32."""


def fp32(graph: Graph, x: str, weight: Array | str, bias: Array | None) -> str:
    """Write the product in the checkpoint's precision."""
    return graph.op("Gemm", x, weight, *(() if bias is None else (bias,)))


def int8(graph: Graph, x: str, weight: Array, bias: Array | None) -> str:
    """Write the product with 8-bit weights, one scale for each output; x is quantised at run time, one scale.

    x is unsigned and the weights are signed: x86 has instructions for this combination.
    """
    rounded, scale = _rounded(weight)
    zero = np.zeros(weight.shape[1], dtype=np.int8)
    given = () if bias is None else (bias,)
    return graph.op("DynamicQuantizeMatMul", x, rounded, scale, zero, *given, domain=FAST)


def stored_int8(graph: Graph, x: str, weight: Array, bias: Array | None) -> str:
    """Write the product with weights that are stored in 8 bits, one scale for each output.

    They are unpacked at each run: a quarter of the memory. For few tokens it is no slower, since reading the
    weights takes most of the time. ONNX Runtime may fuse both nodes, and then rounds x, too (1.31 does).
    """
    rounded, scale = _rounded(weight)
    return fp32(graph, x, graph.op("DequantizeLinear", rounded, scale, axis=1), bias)


def _rounded(weight: Array) -> tuple[NDArray[np.int8], Array]:
    """Return the weights in 8 bits, and the scale of each output."""
    scale = np.maximum(np.abs(weight).max(axis=0), np.finfo(np.float32).tiny) / 127
    return np.clip(np.rint(weight / scale), -127, 127).astype(np.int8), scale.astype(np.float32)


LINEAR: dict[str, Linear] = {"fp32": fp32, "int8": int8}
"""Precision -> the function that writes its products."""
