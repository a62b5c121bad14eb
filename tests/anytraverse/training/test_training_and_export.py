"""A training of twenty steps learns and repeats; what it exports is the same network everywhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from anytraverse.frame import Image
from anytraverse.perception.builtin.network import Floats, network_input, network_size
from anytraverse.training.folders import Folder, read_folder

pytestmark = pytest.mark.needs_export


def trained(folder: Folder, seed: int, steps: int) -> tuple[list[float], dict[str, np.ndarray]]:
    """Losses as they were told, and the weights."""
    from anytraverse.training.fitting import Options, batch, class_weights, loss_of, train

    losses: list[float] = []
    options = Options(seed=seed, steps=steps, batch=4, wide=0.5)
    net = train(folder, Folder(()), options, lambda _d, _n, loss, _s: losses.append(loss))
    frames, labels = batch(folder, Folder(()), options, np.random.default_rng(3))
    losses.append(float(loss_of(net(frames)[0], labels, class_weights(folder), 0.5).detach()))
    return losses, {name: value.numpy() for name, value in net.state_dict().items()}


def test_twenty_steps_lower_the_loss(tiny_folder: Path) -> None:
    from anytraverse.training.fitting import Options, batch, class_weights, loss_of
    from anytraverse.training.net import GroundNet

    folder = read_folder(tiny_folder)
    losses, _ = trained(folder, 1, 20)
    frames, labels = batch(folder, Folder(()), Options(batch=4), np.random.default_rng(3))
    untrained = loss_of(GroundNet(wide=0.5).eval()(frames)[0], labels, class_weights(folder), 0.5)
    assert losses[-1] < 0.8 * float(untrained.detach())


def test_a_training_repeats_by_seed(tiny_folder: Path) -> None:
    folder = read_folder(tiny_folder)
    losses, weights = trained(folder, 1, 4)
    again, same = trained(folder, 1, 4)
    _, other = trained(folder, 2, 4)
    assert losses == again
    assert all((weights[name] == same[name]).all() for name in weights)
    assert any((weights[name] != other[name]).any() for name in weights)


@pytest.mark.parametrize("shape", [(480, 640), (340, 640), (720, 1280), (620, 2026)])
def test_the_export_is_the_network_in_every_runtime(tmp_path: Path, shape: tuple[int, int]) -> None:
    import cv2
    import onnxruntime
    import torch

    from anytraverse.training.export import as_network, export
    from anytraverse.training.net import GroundNet

    torch.manual_seed(0)
    net = GroundNet(wide=0.5).eval()
    path = tmp_path / "net.onnx"
    export(net, path)
    image: Image = np.random.default_rng(0).integers(0, 256, (*shape, 3), dtype=np.uint8)
    frame = network_input(image)
    wide, high = network_size(shape[1], shape[0])
    logits, features = as_network(net)(image)
    assert logits.shape == (8, high // 4, wide // 4)
    assert features.shape == (32, high // 4, wide // 4)
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    other: list[Floats] = session.run(["logits", "features"], {"frame": frame})
    assert np.abs(other[0][0] - logits).max() < 1e-4
    assert np.abs(other[1][0] - features).max() < 1e-4
    classic = cv2.dnn.readNetFromONNX(str(path), getattr(cv2.dnn, "ENGINE_CLASSIC", 1))
    classic.setInput(frame)
    third = classic.forward(["logits", "features"])
    assert np.abs(third[0][0] - logits).max() < 1e-4
    assert np.abs(third[1][0] - features).max() < 1e-4


def test_exposure_alone_changes_next_to_nothing() -> None:
    import torch

    from anytraverse.training.net import GroundNet

    torch.manual_seed(0)
    net = GroundNet(wide=0.5).eval()
    frame = torch.rand(1, 3, 64, 64) * 200 + 20
    difference = (net(frame)[0] - net(0.5 * frame)[0]).abs().max()
    assert float(difference.detach()) < 0.05 * float(net(frame)[0].abs().max().detach())
