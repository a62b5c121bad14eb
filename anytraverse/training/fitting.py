"""Trains the network. Seeded: the same frames, options and versions give the same weights."""

from __future__ import annotations

import time
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from anytraverse.training.augment import changed
from anytraverse.training.classes import CLASSES, DRIVABLE, UNKNOWN, UNLABELLED
from anytraverse.training.folders import Folder, Labelled
from anytraverse.training.net import GroundNet

STRIDE = 4
SIZES = ((256, 128), (256, 144), (256, 160), (256, 192))
"""Widths and heights of the training views, with the aspects of common cameras."""
_SIZE_ODDS = (0.35, 0.3, 0.15, 0.2)
_UNKNOWN_SHARE = 0.03  # rough share of pixels covered by pasted things, which no label shows beforehand


@dataclass(frozen=True)
class Options:
    """Holds the options of a training.

    steps: number of batches. batch: views in each. rate: the highest learning rate. wide: factor on the
    network's width. made_share: share of views from rendered frames, where there are any. drivable: weight of
    the loss for "drivable or not" beside that for all classes. decay: of the average over weights.
    threads: cores.
    """

    seed: int = 0
    steps: int = 2600
    batch: int = 16
    rate: float = 4e-3
    wide: float = 1.25
    made_share: float = 0.3
    drivable: float = 1.0
    decay: float = 0.998
    threads: int = 1


Progress = Callable[[int, int, float, float], None]
"""Called now and then with: steps done, steps in all, mean loss lately, seconds left."""


def train(real: Folder, made: Folder, options: Options, progress: Progress | None = None) -> GroundNet:
    """Train on filmed and, for a share of the views, on rendered frames; return the average over weights."""
    torch.set_num_threads(options.threads)
    torch.manual_seed(options.seed)
    torch.use_deterministic_algorithms(mode=True)
    rng = np.random.default_rng([options.seed, 4])
    net = GroundNet(wide=options.wide).to(memory_format=torch.channels_last)
    average = deepcopy(net).eval()
    optimizer = torch.optim.AdamW(_groups(net), lr=options.rate)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, options.rate, total_steps=options.steps, pct_start=min(0.15, 300 / options.steps)
    )
    weights = class_weights(real)
    begin, lately = time.monotonic(), 0.0
    for step in range(options.steps):
        frames, labels = batch(real, made, options, rng)
        net.train()
        loss = loss_of(net(frames)[0], labels, weights, options.drivable)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(net.parameters(), 5.0)
        optimizer.step()
        schedule.step()
        _update_average(average, net, min(options.decay, (step + 1) / (step + 10)))
        lately += 0.02 * (float(loss.detach()) - lately) if step else float(loss.detach())
        if progress and ((step + 1) % 50 == 0 or step + 1 == options.steps):
            spent = time.monotonic() - begin
            progress(step + 1, options.steps, lately, spent / (step + 1) * (options.steps - step - 1))
    finished: GroundNet = average.to(memory_format=torch.contiguous_format)
    return finished


def batch(real: Folder, made: Folder, options: Options, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """Draw augmented views (n, 3, h, w), float 0 to 255, and their classes (n, h/4, w/4) at the logits."""
    size = SIZES[int(rng.choice(len(SIZES), p=_SIZE_ODDS))]
    views = []
    for _ in range(options.batch):
        frame = _random_frame(made if len(made) and rng.random() < options.made_share else real, rng)
        views.append(changed(frame.image, frame.labels, size, rng))
    frames = torch.from_numpy(np.stack([view for view, _ in views])).permute(0, 3, 1, 2)
    labels = np.stack([names[STRIDE // 2 :: STRIDE, STRIDE // 2 :: STRIDE] for _, names in views])
    return frames.float().contiguous(memory_format=torch.channels_last), torch.from_numpy(
        labels.astype(np.int64)
    )


def loss_of(logits: Tensor, labels: Tensor, weights: Tensor, drivable: float) -> Tensor:
    """Calculate the weighted cross-entropy of the classes, plus that of drivable against the rest."""
    classes = nn.functional.cross_entropy(logits, labels, weights, ignore_index=UNLABELLED)
    logs = torch.log_softmax(logits, dim=1)
    ground = torch.tensor([index in DRIVABLE for index in range(logits.shape[1])])
    share = torch.stack([logs[:, ~ground].logsumexp(dim=1), logs[:, ground].logsumexp(dim=1)], dim=1)
    asked = torch.where(labels == UNLABELLED, UNLABELLED, ground[labels.clamp(max=len(ground) - 1)].long())
    return classes + drivable * nn.functional.nll_loss(share, asked, ignore_index=UNLABELLED)


def class_weights(folder: Folder) -> Tensor:
    """Calculate 1 / sqrt(frequency) of each class, at most four times the least, of mean 1 over pixels."""
    counts: NDArray[np.float64] = np.zeros(len(CLASSES))
    for frame in folder.frames:
        counts += np.bincount(frame.labels[::4, ::4].ravel(), minlength=256)[: len(CLASSES)]
    counts[UNKNOWN] += _UNKNOWN_SHARE * counts.sum()
    shares = np.maximum(counts / counts.sum(), 1e-6)
    weights = 1 / np.sqrt(shares)
    weights = np.minimum(weights, 4 * weights.min())
    return torch.from_numpy(weights / (weights * shares).sum()).float()


def _random_frame(folder: Folder, rng: np.random.Generator) -> Labelled:
    return folder.frames[int(rng.integers(len(folder)))]


def _groups(net: nn.Module) -> list[dict[str, object]]:
    """Group the parameters so that weight decay applies to convolutions only."""
    heavy = [p for p in net.parameters() if p.requires_grad and p.ndim > 1]
    light = [p for p in net.parameters() if p.requires_grad and p.ndim <= 1]
    return [{"params": heavy, "weight_decay": 0.01}, {"params": light, "weight_decay": 0.0}]


def _update_average(average: nn.Module, net: nn.Module, decay: float) -> None:
    with torch.no_grad():
        for mean, new in zip(average.state_dict().values(), net.state_dict().values(), strict=True):
            if mean.is_floating_point():
                mean.lerp_(new, 1 - decay)
            else:
                mean.copy_(new)
