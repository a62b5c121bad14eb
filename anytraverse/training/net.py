"""Defines the built-in perceiver's network: from a frame to logits and features at a quarter of its size.

A frozen ImageNet backbone, and a small decoder in the shape of a U (Ronneberger et al., 2015) of depthwise
separable convolutions (Howard et al., MobileNets, 2017) with a global context (Liu et al., ParseNet, 2015).
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from anytraverse.training.backbone import Backbone
from anytraverse.training.classes import CLASSES
from anytraverse.training.widths import FEATURES, SCALES

WIDE = 48
"""Channels within the decoder."""


class Separable(nn.Module):  # type: ignore[misc]
    """Applies a depthwise 3x3 and a pointwise convolution, with a residual if the shape does not change."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.residual = inputs == outputs
        self.body = nn.Sequential(
            nn.Conv2d(inputs, inputs, 3, padding=1, groups=inputs, bias=False),
            nn.BatchNorm2d(inputs),
            nn.ReLU(),
            nn.Conv2d(inputs, outputs, 1, bias=False),
            nn.BatchNorm2d(outputs),
        )

    def forward(self, x: Tensor) -> Tensor:
        """Apply it; the result has the same height and width."""
        y = self.body(x)
        return torch.relu(x + y if self.residual else y)


class Pointwise(nn.Sequential):  # type: ignore[misc]
    """Applies a 1x1 convolution with normalisation."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__(nn.Conv2d(inputs, outputs, 1, bias=False), nn.BatchNorm2d(outputs))


class _Decoder(nn.Module):  # type: ignore[misc]
    """Maps the backbone's features to logits (n, C, h/4, w/4) and features (n, 32, h/4, w/4)."""

    def __init__(self, classes: int = len(CLASSES)) -> None:
        super().__init__()
        bottom = SCALES[32]
        self.context = nn.Sequential(nn.Conv2d(bottom, WIDE, 1), nn.ReLU(), nn.Conv2d(WIDE, WIDE, 1))
        self.from_scale = nn.ModuleList(Pointwise(channels, WIDE) for channels in SCALES.values())
        self.mix_sixteenth = Separable(WIDE, WIDE)
        self.mix_eighth = Separable(WIDE, WIDE)
        self.mix_quarter = nn.Sequential(Separable(WIDE, WIDE), Separable(WIDE, FEATURES))
        self.forget = nn.Dropout2d(0.1)
        self.head = nn.Conv2d(FEATURES, classes, 1)

    def forward(self, scales: tuple[Tensor, ...]) -> tuple[Tensor, Tensor]:
        """Return logits and features."""
        context = self.context(nn.functional.adaptive_avg_pool2d(scales[3], 1))
        quarter, eighth, sixteenth, bottom = (
            part(scale) for part, scale in zip(self.from_scale, scales, strict=True)
        )
        joined = self.mix_sixteenth(torch.relu(_upsampled(bottom + context) + sixteenth))
        joined = self.mix_eighth(torch.relu(_upsampled(joined) + eighth))
        features = self.mix_quarter(torch.relu(_upsampled(joined) + quarter))
        return self.head(self.forget(features)), features


class GroundNet(nn.Module):  # type: ignore[misc]
    """Maps frames (n, 3, h, w) to logits (n, C, h/4, w/4), features (n, 32, h/4, w/4) and two middle scales.

    Frames are RGB, 0 to 255, with sides that are multiples of 32. The middle scales are the backbone's
    features at strides 8, (n, 40, h/8, w/8), and 16, (n, 112, h/16, w/16). The backbone is never trained:
    its normalisation and weights stay as they are.
    """

    def __init__(self, classes: int = len(CLASSES)) -> None:
        super().__init__()
        self.backbone = Backbone().requires_grad_(requires_grad=False)
        self.decoder = _Decoder(classes)

    def train(self, mode: bool = True) -> GroundNet:
        """Set the training mode of the decoder; the backbone stays in evaluation mode."""
        super().train(mode)
        self.backbone.eval()
        return self

    def forward(self, frames: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return logits, features, and the backbone's features at strides 8 and 16."""
        with torch.no_grad():
            scales = self.backbone(frames)
        logits, features = self.decoder(scales)
        return logits, features, scales[1], scales[2]


def _upsampled(x: Tensor) -> Tensor:
    return nn.functional.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)
