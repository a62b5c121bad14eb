"""Computes the networks' floating-point work from their architecture: the matrix products.

Run: python -m bench.clipseg.work prints the work of a frame with the scene and four words, by model and size.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from anytraverse.export.architecture import DenseArchitecture

_VISION = {
    "hidden_size": 768,
    "intermediate_size": 3072,
    "num_hidden_layers": 12,
    "patch_size": 32,
    "image_size": 224,
}
_CLIPSEG = {
    "projection_dim": 512,
    "extract_layers": [3, 6, 9],
    "reduce_dim": 64,
    "decoder_intermediate_size": 2048,
    "use_complex_transposed_convolution": False,
}
"""What a config.json leaves out because it is transformers' default."""


@dataclass(frozen=True)
class Transformer:
    """A vision transformer on square images: sizes in pixels, widths in numbers."""

    width: int
    hidden: int
    layers: int
    patch: int
    image: int
    projection: int

    @property
    def tokens(self) -> int:
        return (self.image // self.patch) ** 2 + 1

    def layer(self) -> float:
        return _layer(self.tokens, self.width, self.hidden)

    def tower(self, layers: int) -> float:
        """Counts the patches and the first `layers` layers."""
        return 2.0 * (self.tokens - 1) * 3 * self.patch**2 * self.width + layers * self.layer()

    def tail(self, layers: int) -> float:
        """Counts the embedding from the first `layers`' output; the last layer for the class token alone."""
        if layers >= self.layers:
            return 2.0 * self.width * self.projection
        keys = 2.0 * self.tokens * 2 * self.width**2
        one = 2.0 * (2 * self.width**2 + 2 * self.tokens * self.width + 2 * self.width * self.hidden)
        return (self.layers - layers - 1) * self.layer() + keys + one + 2.0 * self.width * self.projection


@dataclass(frozen=True)
class ClipSegWork:
    """The work of CLIPSeg's parts in floating-point operations."""

    vision: Transformer
    needed: int
    """Layers of the tower that the decoder reads."""
    reduced: int
    hidden: int
    taps: int
    complex_convolution: bool

    def tower_needed(self) -> float:
        return self.vision.tower(self.needed)

    def tower_whole(self) -> float:
        return self.vision.tower(self.vision.layers)

    def tail(self) -> float:
        return self.vision.tail(self.needed)

    def reduce(self) -> float:
        """Counts projecting the tower's activations to the decoder's width: once a frame, or a prompt."""
        return self.taps * 2.0 * self.vision.tokens * self.vision.width * self.reduced

    def decoder(self) -> float:
        """Counts what each prompt costs after that."""
        tokens = self.vision.tokens
        return self.taps * _layer(tokens, self.reduced, self.hidden) + self._convolutions(tokens - 1)

    def _convolutions(self, cells: int) -> float:
        if not self.complex_convolution:
            return 2.0 * cells * self.reduced * self.vision.patch**2
        kernel = (self.vision.patch // 4) ** 2
        first = cells * 9 * self.reduced**2
        second = cells * kernel * self.reduced * (self.reduced // 2)
        third = cells * kernel * kernel * (self.reduced // 2)
        return 2.0 * (first + second + third)


def _layer(tokens: int, width: int, hidden: int) -> float:
    """Counts one transformer layer: four projections, attention, two linear maps of the MLP."""
    return 2.0 * tokens * (4 * width**2 + 2 * tokens * width + 2 * width * hidden)


def read_clipseg(checkpoint: Path, size: int | None = None) -> ClipSegWork:
    """Computes CLIPSeg's work at an image size in pixels, by default the checkpoint's preprocessor's."""
    config = json.loads((checkpoint / "config.json").read_text())
    images = json.loads((checkpoint / "preprocessor_config.json").read_text())
    return clipseg_work(config, size or images["size"]["height"])


def clipseg_work(given: dict[str, Any], size: int) -> ClipSegWork:
    """Computes the work of the CLIPSeg of a config.json at an image size in pixels."""
    config: dict[str, Any] = _CLIPSEG | given
    return ClipSegWork(
        vision=_vision(config, size),
        needed=max(config["extract_layers"]) + 1,
        reduced=config["reduce_dim"],
        hidden=config["decoder_intermediate_size"],
        taps=len(config["extract_layers"]),
        complex_convolution=config["use_complex_transposed_convolution"],
    )


def read_clip(checkpoint: Path) -> Transformer:
    """Computes the work of CLIP's vision tower at its own image size."""
    config = {"projection_dim": 512} | json.loads((checkpoint / "config.json").read_text())
    return _vision(config, None)


def dense_image(family: str, size: int, tiny: bool = False) -> float:
    """Computes the work of a dense model's image pass: the tower, and SigLIP's head for each patch."""
    arch = _dense(family, tiny)
    tower, patch = arch.vision.tower, arch.vision.patch
    count, width = (size // patch) ** 2, tower.width
    work = 2.0 * count * 3 * patch**2 * width
    work += tower.layers * _layer(arch.before + count, width, tower.inner)
    if family != "siglip":
        return work
    keys_and_values = 2.0 * count * 2 * width**2 + 2.0 * count * 2 * width
    return work + keys_and_values + 2.0 * (count + 1) * (width**2 + 2 * width * tower.inner)


def dense_scores(family: str, size: int, tiny: bool = False) -> float:
    """Computes the work of one word's map."""
    arch = _dense(family, tiny)
    return 2.0 * (size // arch.vision.patch) ** 2 * arch.joint


def _dense(family: str, tiny: bool) -> DenseArchitecture:
    from anytraverse.export.random_weights import DENSE, TINY_DENSE

    return (TINY_DENSE if tiny else DENSE)[family]


def _vision(config: dict[str, Any], image: int | None) -> Transformer:
    vision = _VISION | (config.get("vision_config") or {})
    return Transformer(
        width=vision["hidden_size"],
        hidden=vision["intermediate_size"],
        layers=vision["num_hidden_layers"],
        patch=vision["patch_size"],
        image=image or vision["image_size"],
        projection=config["projection_dim"],
    )


def main() -> None:
    from bench.clipseg.checkpoints import PUBLISHED

    for size in (352, 288, 224):
        net = clipseg_work(PUBLISHED.clipseg, size)
        work = net.tower_needed() + net.reduce() + net.tail() + 4 * net.decoder()
        print(f"clipseg {size}: {work / 1e9:.1f} GFLOP")
    for family, sizes in (("siglip", (224, 256, 384)), ("tipsv2", (252, 448))):
        for size in sizes:
            work = dense_image(family, size) + 4 * dense_scores(family, size)
            print(f"{family} {size}: {work / 1e9:.1f} GFLOP")


if __name__ == "__main__":
    main()
