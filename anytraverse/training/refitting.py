"""Continues the training of an existing network, which needs fewer frames than a training from scratch."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from anytraverse.errors import TrainingError
from anytraverse.training.fitting import Options, Progress, batch, class_weights, loss_of
from anytraverse.training.folders import Folder
from anytraverse.training.net import STEM, GroundNet

REFIT = Options(steps=150, rate=1e-3)
"""Options that suit a trained network."""
_FROZEN_PARTS = ("luminance", "stem", "quarter", "eighth", "bottom")
"""Parts that are not trained: they detect edges, colours and textures, and few frames would spoil them."""
_PULL_TO_START = 1e-3  # weight in the loss of the squared distance from the weights at the start


class Settled(GroundNet):
    """Extends the network so that its normalisation layers do not change in training."""

    def train(self, mode: bool = True) -> Settled:
        """Set the training mode, but leave all normalisation layers in evaluation mode."""
        super().train(mode)
        for part in self.modules():
            if isinstance(part, nn.BatchNorm2d):
                part.eval()
        return self


def read_back(path: Path) -> GroundNet:
    """Read the network from a file that a training wrote; it gives the same outputs. Raises TrainingError.

    The export folded each normalisation into the convolution before it. So the normalisations of this network
    scale by one and add the folded bias.
    """
    graph = onnx.load(path).graph
    values = {each.name: numpy_helper.to_array(each) for each in graph.initializer}
    stored_convs = [
        [torch.from_numpy(values[name].copy()) for name in node.input[1:]]
        for node in graph.node
        if node.op_type == "Conv" and all(name in values for name in node.input[1:])
    ]
    shape = next((conv[0].shape for conv in stored_convs if conv[0].shape[2:] == (3, 3)), (0,))
    net = Settled(wide=shape[0] / STEM)
    pairs = _in_order(net)
    try:
        for (conv, norm), (weight, *bias) in zip(pairs, stored_convs, strict=True):
            _set(conv, norm, weight, bias)
    except (ValueError, RuntimeError) as error:
        raise TrainingError(f"{path.name} is no network of this program's training") from error
    net.eval()
    return net


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
        net(torch.zeros(1, 3, 64, 64))
    for hook in hooks:
        hook.remove()
    following = [*ran[1:], None]
    return [
        (part, after if isinstance(after, nn.BatchNorm2d) else None)
        for part, after in zip(ran, following, strict=True)
        if isinstance(part, nn.Conv2d)
    ]


def _set(conv: nn.Conv2d, norm: nn.BatchNorm2d | None, weight: Tensor, bias: list[Tensor]) -> None:
    with torch.no_grad():
        if conv.weight.shape != weight.shape:
            raise ValueError("another shape")
        conv.weight.copy_(weight)
        home = conv.bias if norm is None else norm.bias
        if home is not None:
            home.copy_(bias[0])
        if norm is not None:
            norm.running_var.fill_(1 - norm.eps)  # so that 1 / sqrt(var + eps) is 1


def refit(
    start: GroundNet, real: Folder, made: Folder, options: Options, progress: Progress | None = None
) -> GroundNet:
    """Train the last parts of `start` and return the average over weights; `start` itself for no steps.

    A penalty draws the weights back to those of the start (Li et al., L2-SP, 2018). `start` is changed.
    """
    torch.set_num_threads(options.threads)
    if not options.steps:
        return start
    torch.manual_seed(options.seed)
    torch.use_deterministic_algorithms(mode=True)
    rng = np.random.default_rng([options.seed, 6])
    net = start.to(memory_format=torch.channels_last)
    for name, part in net.named_children():
        part.requires_grad_(requires_grad=name not in _FROZEN_PARTS)
    learnt = [p for p in net.parameters() if p.requires_grad]
    home = [p.detach().clone() for p in learnt]
    average = AveragedModel(net, multi_avg_fn=get_ema_multi_avg_fn(0.98))
    optimizer = torch.optim.Adam(learnt, lr=options.rate)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, options.rate, total_steps=options.steps)
    weights = class_weights(real)
    begin, lately = time.monotonic(), 0.0
    for step in range(options.steps):
        frames, labels = batch(real, made, options, rng)
        net.train()
        loss = loss_of(net(frames)[0], labels, weights, options.drivable)
        moved = sum(((p - h) ** 2).sum() for p, h in zip(learnt, home, strict=True))
        optimizer.zero_grad(set_to_none=True)
        (loss + _PULL_TO_START * moved).backward()
        nn.utils.clip_grad_norm_(learnt, 5.0)
        optimizer.step()
        schedule.step()
        average.update_parameters(net)
        lately += 0.02 * (float(loss.detach()) - lately) if step else float(loss.detach())
        if progress:
            spent = time.monotonic() - begin
            progress(step + 1, options.steps, lately, spent / (step + 1) * (options.steps - step - 1))
    finished: GroundNet = average.module.to(memory_format=torch.contiguous_format)
    finished.eval()
    return finished
