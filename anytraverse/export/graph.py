"""Writes ONNX graphs node by node, so that exactly these nodes run on the rover."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

Array = NDArray[Any]

FAST = "com.microsoft"
"""The domain of ONNX Runtime's own fused operators."""

_OPSET = 18
_IR = 8
_EXTERNAL_FROM = 1024  # tensors of at least so many bytes go to a file of their own, which is memory-mapped


class Graph:
    """Builds a graph. Values are referred to by their names; weights are added where they are used."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._nodes: list[onnx.NodeProto] = []
        self._weights: list[onnx.TensorProto] = []
        self._inputs: list[onnx.ValueInfoProto] = []
        self._outputs: list[onnx.ValueInfoProto] = []
        self._count = 0

    def input(self, name: str, dtype: Any, shape: Sequence[int | str]) -> str:
        """Add an input and return its name; a string in `shape` is a size that may differ from run to run."""
        self._inputs.append(_value(name, dtype, shape))
        return name

    def output(self, name: str, value: str, dtype: Any, shape: Sequence[int | str]) -> None:
        """Make `value` an output called `name`."""
        self._nodes.append(helper.make_node("Identity", [value], [name]))
        self._outputs.append(_value(name, dtype, shape))

    def constant(self, array: Array) -> str:
        """Add a weight or another constant tensor, and return its name."""
        self._count += 1
        name = f"w{self._count}"
        self._weights.append(numpy_helper.from_array(np.asarray(array, order="C"), name))
        return name

    def op(self, kind: str, *inputs: str | Array, domain: str = "", **attributes: Any) -> str:
        """Add a node with one output, and return its name. Arrays among the inputs become constants."""
        return self.split_op(kind, *inputs, outputs=1, domain=domain, **attributes)[0]

    def split_op(
        self, kind: str, *inputs: str | Array, outputs: int, domain: str = "", **attributes: Any
    ) -> list[str]:
        """Add a node with several outputs, and return their names."""
        names = [one if isinstance(one, str) else self.constant(one) for one in inputs]
        self._count += 1
        made = [f"{kind.lower()}{self._count}_{index}" for index in range(outputs)]
        self._nodes.append(helper.make_node(kind, names, made, domain=domain, **attributes))
        return made

    def reshape(self, value: str, *shape: int) -> str:
        """Reshape `value`; 0 keeps a size, -1 is calculated."""
        return self.op("Reshape", value, np.array(shape, dtype=np.int64))

    def save(self, path: Path) -> list[Path]:
        """Write the graph, and its weights to a file beside it. Returns the files written."""
        graph = helper.make_graph(self._nodes, self._name, self._inputs, self._outputs, self._weights)
        opsets = [helper.make_opsetid("", _OPSET), helper.make_opsetid(FAST, 1)]
        model = helper.make_model(graph, opset_imports=opsets, ir_version=_IR, producer_name="anytraverse")
        weights = path.with_suffix(".weights")
        onnx.save_model(
            model,
            str(path),
            save_as_external_data=True,
            location=weights.name,
            size_threshold=_EXTERNAL_FROM,
        )
        onnx.checker.check_model(str(path))
        if not weights.exists():
            return [path]
        weights.chmod(path.stat().st_mode)  # onnx writes it private, but the daemon runs as another user
        return [path, weights]


def _value(name: str, dtype: Any, shape: Sequence[int | str]) -> onnx.ValueInfoProto:
    kind = TensorProto.DataType.Value(_KINDS[np.dtype(dtype).name])
    return helper.make_tensor_value_info(name, kind, list(shape))


_KINDS = {"float32": "FLOAT", "uint8": "UINT8", "int64": "INT64", "int32": "INT32"}
