"""Writes the products x W + b, which take nearly all the time, in two precisions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from anytraverse.export.graph import FAST, Graph

Array = NDArray[np.float32]
Linear = Callable[[Graph, str, Array, Array | None], str]
"""(graph, x, weight (inputs, outputs), bias (outputs) or None) -> the product, float32."""


def fp32(graph: Graph, x: str, weight: Array, bias: Array | None) -> str:
    """Write the product in the checkpoint's precision."""
    return graph.op("Gemm", x, weight, *(() if bias is None else (bias,)))


def int8(graph: Graph, x: str, weight: Array, bias: Array | None) -> str:
    """Write the product with 8-bit weights, one scale for each output; x is quantised at run time, one scale.

    x is unsigned and the weights are signed: x86 has instructions for this combination.
    """
    scale = np.maximum(np.abs(weight).max(axis=0), np.finfo(np.float32).tiny) / 127
    rounded = np.clip(np.rint(weight / scale), -127, 127).astype(np.int8)
    zero = np.zeros(weight.shape[1], dtype=np.int8)
    given = () if bias is None else (bias,)
    return graph.op("DynamicQuantizeMatMul", x, rounded, scale.astype(np.float32), zero, *given, domain=FAST)


LINEAR: dict[str, Linear] = {"fp32": fp32, "int8": int8}
"""Precision -> the function that writes its products."""
