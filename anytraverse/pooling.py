"""Pools attention maps and weights into one traversability map and one uncertainty map.

Source: AnyTraverse, arXiv 2506.16826. Settings choose both functions by name.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Map = NDArray[np.float32]


def weighted_max(attention: Map, weights: Map) -> Map:
    """Take the w_n m_n of largest absolute value at each pixel; of equals the lowest.

    attention: (n, h, w) in [0, 1]; weights: (n,) in [-1, 1]. Returns the signed map, (h, w) in [-1, 1].
    A pixel that is not finite in one map is not finite in the result. Without words the result is 0.
    """
    if len(attention) == 0:
        return np.zeros(attention.shape[1:], dtype=np.float32)
    weighted = attention * weights[:, None, None]
    lowest, highest = weighted.min(axis=0), weighted.max(axis=0)
    # a comparison with NaN is False and would choose `highest`; with isnan the NaN cannot get lost
    signed: Map = np.where(np.isnan(lowest) | (-lowest >= highest), lowest, highest).astype(np.float32)
    return signed


def one_minus_max(attention: Map) -> Map:
    """Calculate the uncertainty, 1 - max_n m_n, (h, w) in [0, 1]. Without words it is 1."""
    if len(attention) == 0:
        return np.ones(attention.shape[1:], dtype=np.float32)
    uncertainty: Map = (1.0 - attention.max(axis=0)).astype(np.float32)
    return uncertainty


POOLINGS: dict[str, Callable[[Map, Map], Map]] = {"max": weighted_max}
UNCERTAINTIES: dict[str, Callable[[Map], Map]] = {"max": one_minus_max}
