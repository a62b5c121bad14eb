"""Exports a trained network as one ONNX file for ONNX Runtime and OpenCV's dnn, for sizes in steps of 16."""

from __future__ import annotations

import os
import tempfile
import warnings
from pathlib import Path

import numpy as np
import torch

from anytraverse.errors import TrainingError
from anytraverse.frame import Image
from anytraverse.perception.builtin.network import STEP, WIDTH, network_input
from anytraverse.training.net import GroundNet
from anytraverse.training.scores import Floats, Network

INPUT, OUTPUTS = "frame", ("logits", "features")
OPSET = 13
LARGEST = 1_500_000  # bytes


def export(net: GroundNet, path: Path) -> None:
    """Write the network: `frame` (1, 3, h, w) float32 RGB 0 to 255 -> `logits` (1, C, h/4, w/4), `features`.

    Writes atomically. Raises TrainingError when the file is larger than `LARGEST`.
    """
    net.eval()
    example = torch.zeros(1, 3, 9 * STEP, WIDTH)
    sides = {INPUT: {2: "height", 3: "width"}} | {name: {2: "rows", 3: "columns"} for name in OUTPUTS}
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, suffix=".onnx")
    os.close(handle)
    made = Path(name)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # torch warns that the exporter without dynamo is deprecated
            torch.onnx.export(
                net, (example,), name, opset_version=OPSET, dynamo=False,
                input_names=[INPUT], output_names=list(OUTPUTS), dynamic_axes=sides,
            )  # fmt: skip
        if made.stat().st_size > LARGEST:
            raise TrainingError(
                f"the network is {made.stat().st_size} bytes: at most {LARGEST} ship, train a narrower one"
            )
        made.chmod(0o644)
        made.replace(path)
    finally:
        made.unlink(missing_ok=True)


def as_network(net: GroundNet) -> Network:
    """Wrap a torch network as a function of an image, for calibration and scores."""
    net.eval()

    def run(image: Image) -> tuple[Floats, Floats]:
        with torch.no_grad():
            logits, features = net(torch.from_numpy(network_input(image)))
        return np.asarray(logits[0].numpy(), np.float32), np.asarray(features[0].numpy(), np.float32)

    return run
