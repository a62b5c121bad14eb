"""A network read back from its file is the same network, and trains on from there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from anytraverse.errors import TrainingError
from anytraverse.perception.builtin.perceiver import SHIPPED
from anytraverse.training.folders import Folder, read_folder

pytestmark = pytest.mark.needs_export


def test_a_network_read_back_gives_the_outputs_of_its_file() -> None:
    from anytraverse.training.export import as_network
    from anytraverse.training.fit import stored
    from anytraverse.training.refitting import read_back

    image = np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    pairs = zip(stored(SHIPPED)[0](image), as_network(read_back(SHIPPED))(image), strict=True)
    assert all(np.abs(file - net).max() < 1e-3 for file, net in pairs)


def test_a_refitted_network_survives_its_file_too(tmp_path: Path, tiny_folder: Path) -> None:
    import torch

    from anytraverse.training.export import as_network, export
    from anytraverse.training.fitting import Options
    from anytraverse.training.refitting import read_back, refit

    image = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    before = as_network(read_back(SHIPPED))(image)[0]
    options = Options(steps=2, batch=2, rate=1e-3)
    net, again = (refit(read_back(SHIPPED), read_folder(tiny_folder), Folder(()), options) for _ in range(2))
    pairs = zip(net.state_dict().values(), again.state_dict().values(), strict=True)
    assert all(torch.equal(one, other) for one, other in pairs)
    logits = as_network(net)(image)[0]
    assert np.abs(logits - before).max() > 1e-2
    export(net, tmp_path / "net.onnx")
    assert np.abs(as_network(read_back(tmp_path / "net.onnx"))(image)[0] - logits).max() < 1e-3


def test_a_network_of_another_make_is_refused(tmp_path: Path) -> None:
    import onnx

    from anytraverse.training.refitting import read_back

    model = onnx.load(SHIPPED)
    del model.graph.node[-1]
    model.graph.initializer.pop()
    onnx.save(model, tmp_path / "net.onnx")
    with pytest.raises(TrainingError, match="no network of this program's training"):
        read_back(tmp_path / "net.onnx")
