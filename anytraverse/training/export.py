"""Exports a trained network as one ONNX file of 8-bit weights and activations, and reads it back."""

from __future__ import annotations

import io
import logging
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import onnx
import onnxruntime
import torch
from onnx import numpy_helper
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static
from torch import Tensor, nn

from anytraverse.errors import TrainingError
from anytraverse.perception.builtin.calibration import Floats
from anytraverse.perception.builtin.network import INPUT, OUTPUTS, STEP, WIDTH, network_input
from anytraverse.training.folders import Folder
from anytraverse.training.net import GroundNet

OPSET = 13
LARGEST = 8_000_000  # bytes
_VIEWS = 48  # frames by which the ranges of activations are measured


def export(net: GroundNet, path: Path, frames: Folder) -> None:
    """Write the network, `INPUT` (1, 3, h, w) float32 RGB 0 to 255 -> `OUTPUTS`, to `path`.

    Weights are quantized per channel, activations by their ranges on some of `frames` (static quantization).
    Raises TrainingError when the file is larger than `LARGEST`.
    """
    with TemporaryDirectory() as folder:
        exact = Path(folder) / "exact.onnx"
        exact.write_bytes(_graph(net))
        _quantize(exact, path, frames)
    if path.stat().st_size > LARGEST:
        raise TrainingError(f"the network is {path.stat().st_size} bytes: at most {LARGEST} ship")


def read_back(path: Path) -> GroundNet:
    """Read the network from a file that `export` wrote, with its rounded weights. Raises TrainingError.

    The export folded each normalisation into the convolution before it. So the normalisations of this network
    scale by one and add the folded bias.
    """
    net = GroundNet()
    names = [node.name for node in onnx.load_from_string(_graph(net)).graph.node if node.op_type == "Conv"]
    try:
        stored = _convolutions(onnx.load(path).graph)
        for name, (conv, norm) in zip(names, _in_order(net), strict=True):
            _set(conv, norm, *stored[name])
    except (OSError, KeyError, ValueError, RuntimeError) as error:
        raise TrainingError(f"{path.name} is no network of this program's training") from error
    net.eval()
    return net


class _Frames(CalibrationDataReader):  # type: ignore[misc]
    """Gives the inputs by which activations are measured to the quantizer."""

    def __init__(self, inputs: Sequence[Floats]) -> None:
        self._inputs: Iterator[Floats] = iter(inputs)

    def get_next(self) -> dict[str, Floats] | None:
        """Return the next input by its name; None after the last."""
        frame = next(self._inputs, None)
        return None if frame is None else {INPUT: frame}


def _graph(net: GroundNet) -> bytes:
    """Return the network as ONNX in 32-bit floats."""
    net.eval()
    example = torch.zeros(1, 3, 5 * STEP, WIDTH)
    sides = {name: {2: f"{name}_rows", 3: f"{name}_columns"} for name in (INPUT, *OUTPUTS)}
    made = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # torch warns that the exporter without dynamo is deprecated
        torch.onnx.export(
            net, (example,), made, opset_version=OPSET, dynamo=False,
            input_names=[INPUT], output_names=list(OUTPUTS), dynamic_axes=sides,
        )  # fmt: skip
    return made.getvalue()


def _quantize(exact: Path, path: Path, frames: Folder) -> None:
    chosen = frames.frames[:: max(1, len(frames) // _VIEWS)]
    onnxruntime.set_default_logger_severity(3)
    logging.getLogger().addFilter(_quiet)
    try:
        quantize_static(
            exact,
            path,
            _Frames([network_input(frame.image) for frame in chosen]),
            quant_format=QuantFormat.QDQ,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            per_channel=True,
            reduce_range=True,  # 7 bits: sums of 8 overflow on x86 without VNNI
        )
    finally:
        logging.getLogger().removeFilter(_quiet)


def _quiet(record: logging.LogRecord) -> bool:
    """Drop the quantizer's advice to optimise the graph first, which the exporter has done."""
    return "quantiz" not in record.getMessage().lower() and "pre-process" not in record.getMessage().lower()


def _convolutions(graph: onnx.GraphProto) -> dict[str, tuple[Floats, Floats | None]]:
    """Return the weights and the bias of each convolution by its name; quantized ones as floats."""
    values = {each.name: numpy_helper.to_array(each) for each in graph.initializer}
    makers = {node.output[0]: node for node in graph.node if node.op_type == "DequantizeLinear"}

    def floats(name: str) -> Floats:
        if name in values:
            return np.asarray(values[name], dtype=np.float32)
        given, scale, zero = (values[one] for one in makers[name].input)
        shape = (-1,) + (1,) * (given.ndim - 1) if scale.ndim else ()
        centred = given.astype(np.float32) - zero.astype(np.float32).reshape(shape)
        return np.asarray(centred * scale.reshape(shape), dtype=np.float32)

    found = {}
    for node in graph.node:
        if node.op_type == "Conv":
            weight, *bias = (floats(name) for name in node.input[1:])
            found[node.name] = weight, bias[0] if bias else None
    return found


def _in_order(net: GroundNet) -> list[tuple[nn.Conv2d, nn.BatchNorm2d | None]]:
    """Return the convolutions in the order in which they run, each with the normalisation after it."""
    ran: list[nn.Module] = []
    hooks = [
        part.register_forward_hook(lambda module, _inputs, _output: ran.append(module))
        for part in net.modules()
        if isinstance(part, (nn.Conv2d, nn.BatchNorm2d))
    ]
    net.eval()
    with torch.no_grad():
        net(torch.zeros(1, 3, 2 * STEP, 2 * STEP))
    for hook in hooks:
        hook.remove()
    following = [*ran[1:], None]
    return [
        (part, after if isinstance(after, nn.BatchNorm2d) else None)
        for part, after in zip(ran, following, strict=True)
        if isinstance(part, nn.Conv2d)
    ]


def _set(conv: nn.Conv2d, norm: nn.BatchNorm2d | None, weight: Floats, bias: Floats | None) -> None:
    if tuple(conv.weight.shape) != weight.shape:
        raise ValueError("another shape")
    with torch.no_grad():
        conv.weight.copy_(torch.from_numpy(weight))
        home: Tensor | None = conv.bias if norm is None else norm.bias
        if home is not None and bias is not None:
            home.copy_(torch.from_numpy(bias))
        if norm is not None:
            norm.running_var.fill_(1 - norm.eps)  # so that 1 / sqrt(var + eps) is 1
