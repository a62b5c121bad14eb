"""Makes bundles of networks for rovers, on a workstation with torch (extra `export`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from anytraverse.bundle.manifest import Manifest

DEFAULT_CLIP = "openai/clip-vit-base-patch32"
RANDOM = "random"
"""Given in place of a checkpoint: use random weights of the published size."""


def export_bundle(
    checkpoint: str,
    out: Path,
    *,
    size: int = 352,
    precisions: Sequence[str] = ("fp32",),
    scene: str = "shared",
    clip: str | None = None,
    name: str | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Manifest:
    """Make the bundle `out` from a CLIPSeg checkpoint: a folder, an id of the Hugging Face hub, or `RANDOM`.

    size: pixels of the square input. scene: "shared", from CLIPSeg's own image tower, or "clip-b32", the
    paper's, from the checkpoint `clip`. say: receives a line for each step. Raises BundleError.
    """
    from anytraverse.errors import BundleError

    try:
        from anytraverse.bundle.writing import check_place
        from anytraverse.export.making import check_precisions, make_bundle

        if checkpoint == RANDOM:
            from anytraverse.export.random_weights import random_clipseg, random_scene
        else:
            import torch  # noqa: F401
            import transformers  # noqa: F401

            from anytraverse.export.checkpoint import load_clipseg, load_scene
    except ImportError as error:
        raise BundleError(
            f"making a bundle needs {error.name}: on a workstation, "
            'pip install "anytraverse-companion[export]"'
        ) from error
    if scene not in ("shared", "clip-b32"):
        raise BundleError(f'no scene embedding is called "{scene}": choose shared or clip-b32')
    if clip is not None and scene != "clip-b32":
        raise BundleError("--clip is the encoder of --scene clip-b32: give both, or neither")
    check_precisions(precisions)
    check_place(out, "clipseg")
    own = None
    if checkpoint == RANDOM:
        say("drawing random weights: the maps will mean nothing")
        loaded = random_clipseg()
        own = random_scene() if scene == "clip-b32" else None
    else:
        say(f"reading {checkpoint}")
        loaded = load_clipseg(checkpoint)
        if scene == "clip-b32":
            say(f"reading {clip or DEFAULT_CLIP}")
            own = load_scene(clip or DEFAULT_CLIP)
    called = name or Path(checkpoint).name or "clipseg"
    return make_bundle(out, loaded, size=size, precisions=precisions, scene=own, name=called, say=say)
