"""A network read back from its file is the same network, and trains on from there."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest

from anytraverse.errors import TrainingError
from anytraverse.perception.builtin.network import Outputs, network_input
from anytraverse.perception.builtin.perceiver import SHIPPED
from anytraverse.training.folders import Folder, read_folder

pytestmark = pytest.mark.needs_export

IMAGE = np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8)


def in_floats(net: object, image: np.ndarray) -> Outputs:
    """The outputs of a network that runs in torch."""
    import torch

    assert callable(net)
    with torch.no_grad():
        return Outputs(*(each[0].numpy() for each in net(torch.from_numpy(network_input(image)))))


def errors(one: Outputs, other: Outputs) -> list[float]:
    """The mean absolute difference of each output, over its spread."""
    return [float(np.abs(a - b).mean() / a.std()) for a, b in zip(one, other, strict=True)]


def test_a_network_read_back_gives_the_outputs_of_its_file_but_for_rounded_activations() -> None:
    from anytraverse.training.export import read_back
    from anytraverse.training.fit import stored

    found = errors(stored(SHIPPED)[0](IMAGE), in_floats(read_back(SHIPPED), IMAGE))
    assert max(found) < 0.35
    assert max(found) > 0  # the file rounds its activations


def test_a_refit_repeats_changes_only_the_decoder_and_survives_its_file(
    tmp_path: Path, tiny_folder: Path
) -> None:
    import torch

    from anytraverse.training.export import export, read_back
    from anytraverse.training.fitting import FitOptions, Material, train

    material = Material(Folder(read_folder(tiny_folder).frames[:2]))
    options = FitOptions(steps=2, batch=2, rate=1e-3)
    before = read_back(SHIPPED)
    net, again = (train(deepcopy(before), material, options) for _ in range(2))
    pairs = zip(net.state_dict().values(), again.state_dict().values(), strict=True)
    assert all(torch.equal(one, other) for one, other in pairs)
    start = before.state_dict()
    changed = {name for name, value in net.state_dict().items() if not torch.equal(value, start[name])}
    assert changed
    assert all(name.startswith("decoder.") for name in changed)
    export(net, tmp_path / "net.onnx", material.real)
    back = in_floats(read_back(tmp_path / "net.onnx"), IMAGE)
    assert max(errors(in_floats(net, IMAGE), back)) < 0.2


def test_a_network_of_another_make_is_refused(tmp_path: Path) -> None:
    import onnx

    from anytraverse.training.export import read_back

    model = onnx.load(SHIPPED)
    del model.graph.node[-1]
    model.graph.initializer.pop()
    onnx.save(model, tmp_path / "net.onnx")
    with pytest.raises(TrainingError, match="no network of this program's training"):
        read_back(tmp_path / "net.onnx")
