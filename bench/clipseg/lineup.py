"""Lists the bundles that the benchmark makes, and the contestants that run them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Made:
    """A bundle. model: "clipseg" or a family of dense models. size, tiny: pixels of its square input.

    scene: of CLIPSeg, "shared" or "clip-b32"; None: the model has but one.
    """

    model: str
    size: int
    tiny: int
    scene: str | None = None


@dataclass(frozen=True)
class _Contestant:
    """bundle: a key of `BUNDLES`, "" for the reference. label: as people read it.

    like: the contestant with whose ROI means its own are compared, "" for none. same_encoder: whether it
    embeds the scene with the reference's encoder.
    """

    bundle: str
    precision: str
    label: str
    like: str = ""
    same_encoder: bool = False


REFERENCE = "reference"

BUNDLES = {
    "clipseg-352": Made("clipseg", 352, 96, "shared"),
    "clipseg-352-clip": Made("clipseg", 352, 96, "clip-b32"),
    "clipseg-288": Made("clipseg", 288, 80, "shared"),
    "clipseg-224": Made("clipseg", 224, 64, "shared"),
    "siglip2-256": Made("siglip", 256, 64),
    "tipsv2-448": Made("tipsv2", 448, 96),
}

CONTESTANTS = {
    REFERENCE: _Contestant("", "fp32", "authors' step, PyTorch"),
    "fp32": _Contestant("clipseg-352", "fp32", "fp32, shared scene", REFERENCE),
    "int8": _Contestant("clipseg-352", "int8", "int8, shared scene", REFERENCE),
    "fp32_clip_b32": _Contestant(
        "clipseg-352-clip", "fp32", "fp32, CLIP B/32 scene", REFERENCE, same_encoder=True
    ),
    "int8_clip_b32": _Contestant(
        "clipseg-352-clip", "int8", "int8, CLIP B/32 scene", REFERENCE, same_encoder=True
    ),
    "fp32_288": _Contestant("clipseg-288", "fp32", "fp32, shared scene, 288", "fp32"),
    "int8_288": _Contestant("clipseg-288", "int8", "int8, shared scene, 288", "int8"),
    "fp32_224": _Contestant("clipseg-224", "fp32", "fp32, shared scene, 224", "fp32"),
    "int8_224": _Contestant("clipseg-224", "int8", "int8, shared scene, 224", "int8"),
    "fp32_siglip2": _Contestant("siglip2-256", "fp32", "fp32, SigLIP2-B/16 at 256"),
    "int8_siglip2": _Contestant("siglip2-256", "int8", "int8, SigLIP2-B/16 at 256", "fp32_siglip2"),
    "fp32_tipsv2": _Contestant("tipsv2-448", "fp32", "fp32, TIPSv2-B/14 at 448"),
    "int8_tipsv2": _Contestant("tipsv2-448", "int8", "int8, TIPSv2-B/14 at 448", "fp32_tipsv2"),
}
"""Name in the last line -> contestant, in the order of the tables; the reference is the first."""

OURS = tuple(CONTESTANTS)[1:]


def bundle_of(models: Path, name: str) -> Path:
    """Returns the folder of one of `BUNDLES`."""
    return models / f"bundle-{name}"
