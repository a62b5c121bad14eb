"""Converts frames to pixel values as transformers' image processors do where torchvision is installed.

Their resize is torch's own for uint8 images, with antialiasing: within a grey level of Pillow's, and faster.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import torch

MODES = {2: "bilinear", 3: "bicubic"}
"""Pillow's numbers of resampling filters, as preprocessor_config.json has them."""


@dataclass(frozen=True)
class Pixels:
    """Resizes, crops and normalises frames by a preprocessor_config.json.

    size: (height, width) of the result, or the shorter edge, of which `crop` (pixels, square) is kept.
    """

    size: tuple[int, int] | int
    crop: int | None
    mode: str
    mean: tuple[float, ...]
    deviation: tuple[float, ...]

    @classmethod
    def read(cls, checkpoint: Path) -> Pixels:
        told = json.loads((checkpoint / "preprocessor_config.json").read_text())
        size = told["size"]
        if isinstance(size, dict):
            size = (size["height"], size["width"])
        return cls(
            size=size,
            crop=told["crop_size"] if told.get("do_center_crop") else None,
            mode=MODES[told["resample"]],
            mean=tuple(told["image_mean"]),
            deviation=tuple(told["image_std"]),
        )

    def of(self, frame: NDArray[np.uint8]) -> torch.Tensor:
        """Returns the pixel values (1, 3, h, w) float32 of an RGB frame (height, width, 3) uint8."""
        import torch

        image = torch.from_numpy(frame).permute(2, 0, 1).contiguous()[None]
        image = torch.nn.functional.interpolate(
            image, size=self._target(*frame.shape[:2]), mode=self.mode, align_corners=False, antialias=True
        )
        if self.crop is not None:
            top, left = ((edge - self.crop) // 2 for edge in image.shape[2:])
            image = image[:, :, top : top + self.crop, left : left + self.crop]
        mean = 255 * torch.tensor(self.mean).view(-1, 1, 1)
        deviation = 255 * torch.tensor(self.deviation).view(-1, 1, 1)
        return image.to(torch.float32).sub_(mean).div_(deviation)

    def _target(self, height: int, width: int) -> tuple[int, int]:
        if not isinstance(self.size, int):
            return self.size
        shorter = min(height, width)
        return int(self.size * height / shorter), int(self.size * width / shorter)
