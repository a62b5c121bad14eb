"""Trains the network. Seeded: the same frames, options and versions give the same weights."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from anytraverse.training.augment import changed
from anytraverse.training.classes import CLASSES, DRIVABLE, UNKNOWN, UNLABELLED
from anytraverse.training.cutouts import Cutout
from anytraverse.training.folders import Folder, Labelled
from anytraverse.training.net import GroundNet

STRIDE = 4
SIZES = ((256, 128), (256, 160), (256, 192))
"""Widths and heights of the training views, with the aspects of common cameras."""
_SIZE_ODDS = (0.4, 0.3, 0.3)
_UNKNOWN_SHARE = 0.03  # rough share of pixels covered by pasted things, which no label shows beforehand


@dataclass(frozen=True)
class FitOptions:
    """Holds the options of a training.

    steps: number of batches. batch: views in each. rate: the highest learning rate. made_share: share of
    views from rendered frames, where there are any. drivable: weight of the loss for "drivable or not" beside
    that for all classes. decay: of the average over weights. pull: weight of the squared distance from the
    weights at the start (Li et al., L2-SP, 2018). threads: cores.
    """

    seed: int = 0
    steps: int = 1300
    batch: int = 16
    rate: float = 4e-3
    made_share: float = 0.3
    drivable: float = 1.0
    decay: float = 0.996
    pull: float = 0.0
    threads: int = 1


REFIT = FitOptions(steps=150, rate=1e-3, decay=0.98, pull=1e-3)
"""Options that suit a trained network."""


@dataclass(frozen=True, eq=False)
class Material:
    """Holds what a network is trained on: filmed and rendered frames, and photographs of things to paste.

    kept_cutouts: photographs that are not for training: things in them must be noticed by what was trained.
    """

    real: Folder
    made: Folder = field(default_factory=lambda: Folder(()))
    cutouts: tuple[Cutout, ...] = ()
    kept_cutouts: tuple[Cutout, ...] = ()


Progress = Callable[[int, int, float, float], None]
"""Called now and then with: steps done, steps in all, mean loss lately, seconds left."""


def train(
    net: GroundNet, material: Material, options: FitOptions, progress: Progress | None = None
) -> GroundNet:
    """Train the decoder of `net`, which is changed, and return it with the average over its weights.

    The backbone is not trained. Without steps the network is returned as it is.
    """
    torch.set_num_threads(options.threads)
    net.eval()
    if not options.steps:
        return net
    torch.manual_seed(options.seed)
    torch.use_deterministic_algorithms(mode=True)
    rng = np.random.default_rng([options.seed, 4])
    net = net.to(memory_format=torch.channels_last)
    learnt = list(net.decoder.parameters())
    home = [p.detach().clone() for p in learnt]
    average = AveragedModel(net.decoder, multi_avg_fn=get_ema_multi_avg_fn(options.decay), use_buffers=True)
    optimizer = torch.optim.AdamW(_groups(net.decoder), lr=options.rate)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, options.rate, total_steps=options.steps, pct_start=min(0.15, 300 / options.steps)
    )
    weights = class_weights(material.real)
    begin, lately = time.monotonic(), 0.0
    for step in range(options.steps):
        frames, labels = batch(material, options, rng)
        net.train()
        loss = loss_of(net(frames)[0], labels, weights, options.drivable)
        if options.pull:
            moved = sum(((p - h) ** 2).sum() for p, h in zip(learnt, home, strict=True))
            loss = loss + options.pull * moved
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(learnt, 5.0)
        optimizer.step()
        schedule.step()
        average.update_parameters(net.decoder)
        lately += 0.02 * (float(loss.detach()) - lately) if step else float(loss.detach())
        if progress and ((step + 1) % 50 == 0 or step + 1 == options.steps):
            spent = time.monotonic() - begin
            progress(step + 1, options.steps, lately, spent / (step + 1) * (options.steps - step - 1))
    net.decoder = average.module
    net.eval()
    finished: GroundNet = net.to(memory_format=torch.contiguous_format)
    return finished


def batch(material: Material, options: FitOptions, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """Draw augmented views (n, 3, h, w), float 0 to 255, and their classes (n, h/4, w/4) at the logits."""
    size = SIZES[int(rng.choice(len(SIZES), p=_SIZE_ODDS))]
    views = []
    for _ in range(options.batch):
        rendered = len(material.made) and rng.random() < options.made_share
        frame = _random_frame(material.made if rendered else material.real, rng)
        views.append(changed(frame.image, frame.labels, size, rng, material.cutouts))
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
