"""Small networks that tell colours apart, and bundles of them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from anytraverse.cli import main
from anytraverse.frame import Image
from anytraverse.perception.classes.perceiver import Classes
from anytraverse.perception.runtime import Runtime

NAMES = """# the ground, by its colour
grass, lawn, green grass
dirt, trail
water
- void  # neither
"""
SCORES = np.array([[-6, 12, -6], [12, -6, -6], [-6, -6, 12], [0, 0, 0]], dtype=np.float32)
"""Of green, red, blue, and grey, for pixels of 0 to 1."""
BIAS = np.array([0, 0, 0, 2], dtype=np.float32)
COLOURS = {
    "grass": (20, 240, 20),
    "dirt": (240, 20, 20),
    "water": (20, 20, 240),
    "grey": (128, 128, 128),
}


def paint(*columns: str, size: tuple[int, int] = (64, 48)) -> Image:
    """Upright stripes of `COLOURS`, of one width."""
    stripes = np.array([COLOURS[name] for name in columns], dtype=np.uint8)
    places = np.arange(size[0]) * len(columns) // size[0]
    return np.broadcast_to(stripes[places], (size[1], size[0], 3)).copy()


class Graph:
    """Nodes in a row."""

    def __init__(self, first: str) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.arrays: dict[str, NDArray[np.float32]] = {}
        self.last = first

    def then(self, operator: str, *arrays: str, out: str = "", **given: Any) -> None:
        """Go on from here with an operator."""
        self.nodes.append(
            helper.make_node(operator, [self.last, *arrays], [out or f"v{len(self.nodes)}"], **given)
        )
        self.last = self.nodes[-1].output[0]


def colour_network(
    *,
    scores: NDArray[np.float32] = SCORES,
    shape: Sequence[int | str] = (1, 3, 24, 32),
    dtype: int = TensorProto.FLOAT,
    then: str = "Identity",
    features: float | None = None,
) -> onnx.ModelProto:
    """Scores of colours as 1x1 convolutions over the three colours, wherever `shape` has them.

    then: an operator on the scores. features: give the picture as features, multiplied by this.
    """
    count = len(scores)
    graph = Graph("picture")
    graph.arrays["weights"] = scores.reshape(count, 3, 1, 1)
    graph.arrays["bias"] = BIAS[:count]
    if dtype != TensorProto.FLOAT:
        graph.arrays["scale"] = np.array(1 / 255, dtype=np.float32)
        graph.then("Cast", to=TensorProto.FLOAT)
        graph.then("Mul", "scale")
    if shape[-1] == 3:
        graph.then("Transpose", perm=[0, 3, 1, 2])
    outputs = [helper.make_tensor_value_info("scores", 1 if then != "ArgMax" else 7, None)]
    if features is not None:
        graph.arrays["features_are"] = np.array(features, dtype=np.float32)
        graph.nodes.append(helper.make_node("Mul", [graph.last, "features_are"], ["features"]))
        outputs.append(helper.make_tensor_value_info("features", TensorProto.FLOAT, None))
    graph.then("Conv", "weights", "bias")
    axis: dict[str, Any] = {"axis": 1} if then in ("Softmax", "ArgMax") else {}
    graph.then(then, **axis)
    if shape[-1] == 3:
        graph.then("Transpose", perm=[0, 2, 3, 1])
    graph.then("Identity", out="scores")
    made = helper.make_graph(
        graph.nodes,
        "colours",
        [helper.make_tensor_value_info("picture", dtype, list(shape))],
        outputs,
        [numpy_helper.from_array(array, name) for name, array in graph.arrays.items()],
    )
    return helper.make_model(made, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)


@pytest.fixture
def network(tmp_path: Path) -> Callable[..., Path]:
    """Writes a network as `colour_network` makes it, and gives its file."""

    def write(**wishes: Any) -> Path:
        path = tmp_path / "colours.onnx"
        onnx.save(colour_network(**wishes), str(path))
        return path

    return write


@pytest.fixture
def bundle(tmp_path: Path, network: Callable[..., Path]) -> Callable[..., Path]:
    """Makes a bundle of a network by the command line, and gives its folder."""

    def make(*options: str, names: str = NAMES, **wishes: Any) -> Path:
        (tmp_path / "names.txt").write_text(names)
        files = [str(network(**wishes)), str(tmp_path / "bundle"), "--names", str(tmp_path / "names.txt")]
        given = options if wishes.get("dtype") == TensorProto.UINT8 else ("--mean", "0,0,0", *options)
        assert main(["bundle", "classes", *files, *given]) == 0
        return tmp_path / "bundle"

    return make


@pytest.fixture
def eyes(bundle: Callable[..., Path]) -> Callable[..., Classes]:
    """The perceiver of such a bundle, at one thread."""
    return lambda *options, **wishes: Classes(str(bundle(*options, **wishes)), Runtime(threads=1))


@pytest.fixture
def painted() -> Callable[..., Image]:
    """Pictures of upright stripes."""
    return paint


def reseal_bundle(folder: Path, change: Callable[[dict[str, Any]], object] = dict) -> None:
    """Change a bundle's manifest, and let it know its files as they are now."""
    path = folder / "manifest.json"
    values = json.loads(path.read_text())
    change(values)
    for name, entry in values["files"].items():
        data = (folder / name).read_bytes()
        entry |= {"size": len(data), "sha256": hashlib.sha256(data).hexdigest()}
    path.write_text(json.dumps(values))


@pytest.fixture
def reseal() -> Callable[..., None]:
    """See `reseal_bundle`."""
    return reseal_bundle


@pytest.fixture
def spoilt(bundle: Callable[..., Path]) -> Callable[..., Classes]:
    """The perceiver of a bundle that the command line would not make: its network is not as promised."""

    def make(activation: str = "softmax", **wishes: Any) -> Classes:
        folder = bundle(features=1.0 if "features" in wishes else None)
        (folder / "network.onnx").write_bytes(colour_network(**wishes).SerializeToString())
        reseal_bundle(folder, lambda values: values["details"].update(activation=activation))
        return Classes(str(folder), Runtime(threads=1))

    return make
