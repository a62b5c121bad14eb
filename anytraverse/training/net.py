"""Defines the built-in perceiver's network: from a frame to logits and features at a quarter of its size.

A U-net of depthwise separable convolutions (Howard et al., MobileNets, 2017) with dilations at its bottom
(Yu and Koltun, 2016) and a global context (Liu et al., ParseNet, 2015).
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from anytraverse.training.classes import CLASSES

STEM, QUARTER, EIGHTH, SIXTEENTH = 16, 32, 64, 96
FEATURES = 32
"""Channels of the last layer before the class logits."""
_DARK = 0.05  # share of the frame's mean added to its light: keeps the log of black finite and limits noise


class Separable(nn.Module):  # type: ignore[misc]
    """Applies a depthwise 3x3 and a pointwise convolution, with a residual if the shape does not change."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1, dilation: int = 1) -> None:
        super().__init__()
        self.residual = stride == 1 and inputs == outputs
        self.body = nn.Sequential(
            nn.Conv2d(inputs, inputs, 3, stride, dilation, dilation, groups=inputs, bias=False),
            nn.BatchNorm2d(inputs),
            nn.ReLU(),
            nn.Conv2d(inputs, outputs, 1, bias=False),
            nn.BatchNorm2d(outputs),
        )

    def forward(self, x: Tensor) -> Tensor:
        """Apply it; the result has the same height and width, or half of them with stride 2."""
        y = self.body(x)
        return torch.relu(x + y if self.residual else y)


class Pointwise(nn.Sequential):  # type: ignore[misc]
    """Applies a 1x1 convolution with normalisation."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__(nn.Conv2d(inputs, outputs, 1, bias=False), nn.BatchNorm2d(outputs))


class GroundNet(nn.Module):  # type: ignore[misc]
    """Maps frames (n, 3, h, w) to logits (n, C, h/4, w/4) and features (n, 32, h/4, w/4).

    Frames are RGB, 0 to 255, with sides that are multiples of 16. The first layers get the logarithm of light
    over the frame's mean: the exposure cancels out, and the white balance becomes an offset.
    """

    def __init__(self, classes: int = len(CLASSES), wide: float = 1.0) -> None:
        super().__init__()
        stem, quarter, eighth, bottom = (round(wide * n) for n in (STEM, QUARTER, EIGHTH, SIXTEENTH))
        self.luminance = nn.Conv2d(3, 1, 1, bias=False).requires_grad_(requires_grad=False)
        nn.init.constant_(self.luminance.weight, 1 / 3)
        self.stem = nn.Sequential(nn.Conv2d(3, stem, 3, 2, 1, bias=False), nn.BatchNorm2d(stem), nn.ReLU())
        self.quarter = nn.Sequential(Separable(stem, quarter, 2), Separable(quarter, quarter))
        self.eighth = nn.Sequential(
            Separable(quarter, eighth, 2), *(Separable(eighth, eighth) for _ in range(2))
        )
        self.bottom = nn.Sequential(
            Separable(eighth, bottom, 2), *(Separable(bottom, bottom, dilation=d) for d in (1, 2, 4, 1))
        )
        self.context = nn.Sequential(nn.Conv2d(bottom, bottom, 1), nn.ReLU(), nn.Conv2d(bottom, FEATURES, 1))
        self.from_bottom = Pointwise(bottom, FEATURES)
        self.from_eighth = Pointwise(eighth, FEATURES)
        self.from_quarter = Pointwise(quarter, FEATURES)
        self.mix_eighth = Separable(FEATURES, FEATURES)
        self.mix_quarter = nn.Sequential(Separable(FEATURES, FEATURES), Separable(FEATURES, FEATURES))
        self.forget = nn.Dropout2d(0.1)
        self.head = nn.Conv2d(FEATURES, classes, 1)

    def forward(self, frames: Tensor) -> tuple[Tensor, Tensor]:
        """Return logits and features."""
        light = frames / (self.luminance(_global_mean(frames)) + 1.0)
        quarter = self.quarter(self.stem(torch.log(light + _DARK)))
        eighth = self.eighth(quarter)
        bottom = self.bottom(eighth)
        context = self.context(_global_mean(bottom))
        joined = self.mix_eighth(
            torch.relu(_upsampled(self.from_bottom(bottom) + context) + self.from_eighth(eighth))
        )
        features = self.mix_quarter(torch.relu(_upsampled(joined) + self.from_quarter(quarter)))
        return self.head(self.forget(features)), features


def _global_mean(x: Tensor) -> Tensor:
    """Average each channel over the frame, (n, c, 1, 1), by pooling: OpenCV cannot read a mean over axes."""
    return nn.functional.adaptive_avg_pool2d(x, 1)


def _upsampled(x: Tensor) -> Tensor:
    return nn.functional.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)


def parameters(net: nn.Module) -> int:
    """Count the network's parameters."""
    return sum(p.numel() for p in net.parameters())
