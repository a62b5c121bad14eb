"""Makes bundles of networks for rovers, on a workstation with torch (extra `export`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from anytraverse.release import to_install

if TYPE_CHECKING:
    from anytraverse.bundle.manifest import Manifest

DEFAULT_CLIP = "openai/clip-vit-base-patch32"
RANDOM = "random"
RANDOM_DENSE = {"random-siglip2": "siglip", "random-tipsv2": "tipsv2"}
"""Given in place of a checkpoint: use random weights of the published size. `RANDOM` is CLIPSeg."""
CLIPSEG_SIZE = 352


def export_bundle(
    checkpoint: str,
    out: Path,
    *,
    size: int | None = None,
    precisions: Sequence[str] = ("fp32",),
    scene: str | None = None,
    clip: str | None = None,
    templates: Sequence[str] = (),
    absent: Sequence[str] = (),
    name: str | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Manifest:
    """Make the bundle `out` from a checkpoint of CLIPSeg, SigLIP 2 or TIPSv2.

    checkpoint: a folder, an id of the Hugging Face hub, `RANDOM` or one of `RANDOM_DENSE`.
    size: pixels of the square input; None: 352 for CLIPSeg, the checkpoint's own for the others.
    scene, for CLIPSeg: "shared", from its own image tower (default), or "clip-b32", the paper's, from the
    checkpoint `clip`. templates, absent, for the others: see `dense_making`; empty for its defaults.
    say: receives a line for each step. Raises BundleError.
    """
    from anytraverse.errors import BundleError
    from anytraverse.perception.dense.details import FAMILIES

    try:
        from anytraverse.bundle.writing import check_place
        from anytraverse.export.making import check_precisions

        if checkpoint != RANDOM and checkpoint not in RANDOM_DENSE:
            import torch  # noqa: F401
            import transformers  # noqa: F401

            from anytraverse.export.checkpoint import model_type
            from anytraverse.export.dense_checkpoint import MODELS
    except ImportError as error:
        raise BundleError(
            f"making a bundle needs {error.name}: on a workstation, {to_install('export')}"
        ) from error
    if scene not in (None, "shared", "clip-b32"):
        raise BundleError(f'no scene embedding is called "{scene}": choose shared or clip-b32')
    if clip is not None and scene != "clip-b32":
        raise BundleError("--clip is the encoder of --scene clip-b32: give both, or neither")
    check_precisions(precisions)
    check_place(out)
    kind = {RANDOM: "clipseg", **RANDOM_DENSE}.get(checkpoint) or model_type(checkpoint)
    if kind not in ("clipseg", *FAMILIES):
        like = ", ".join(model[-1] for model in MODELS.values())
        raise BundleError(
            f'{checkpoint} is a checkpoint of "{kind}", which cannot be exported: '
            f"give one like CIDAS/clipseg-rd64-refined, {like}"
        )
    called = name or Path(checkpoint).name or "bundle"
    check_place(out, "clipseg" if kind == "clipseg" else "dense")
    if kind != "clipseg":
        if scene is not None:
            raise BundleError("--scene is for CLIPSeg: this model has a scene embedding of its own")
        return _export_dense(checkpoint, kind, out, size, precisions, templates, absent, called, say)
    if templates or absent:
        raise BundleError("--templates and --absent are not for CLIPSeg: leave them out")
    side = CLIPSEG_SIZE if size is None else size
    return _export_clipseg(checkpoint, out, side, precisions, scene, clip, called, say)


def _export_clipseg(
    checkpoint: str,
    out: Path,
    size: int,
    precisions: Sequence[str],
    scene: str | None,
    clip: str | None,
    name: str,
    say: Callable[[str], None],
) -> Manifest:
    from anytraverse.export.making import make_bundle

    own = None
    if checkpoint == RANDOM:
        from anytraverse.export.random_weights import random_clipseg, random_scene

        say("drawing random weights: the maps will mean nothing")
        loaded = random_clipseg()
        own = random_scene() if scene == "clip-b32" else None
    else:
        from anytraverse.export.checkpoint import load_clipseg, load_scene

        say(f"reading {checkpoint}")
        loaded = load_clipseg(checkpoint)
        if scene == "clip-b32":
            say(f"reading {clip or DEFAULT_CLIP}")
            own = load_scene(clip or DEFAULT_CLIP)
    return make_bundle(out, loaded, size=size, precisions=precisions, scene=own, name=name, say=say)


def _export_dense(
    checkpoint: str,
    family: str,
    out: Path,
    size: int | None,
    precisions: Sequence[str],
    templates: Sequence[str],
    absent: Sequence[str],
    name: str,
    say: Callable[[str], None],
) -> Manifest:
    from anytraverse.export.dense_making import ABSENT, TEMPLATES, WORDS, make_dense_bundle
    from anytraverse.perception.dense.details import check_templates, filled

    templates, absent = tuple(templates or TEMPLATES), tuple(absent or ABSENT)
    check_templates(templates)
    if checkpoint in RANDOM_DENSE:
        from anytraverse.export.random_weights import random_dense

        say("drawing random weights, and 261 tokens in place of all: the maps will mean nothing")
        loaded = random_dense(family)
    else:
        from anytraverse.export.dense_checkpoint import load_dense

        say(f"reading {checkpoint}")
        words = (*absent, *WORDS, *FURTHER_TEXTS)
        texts = [filled(template, word) for template in templates for word in words]
        loaded = load_dense(checkpoint, family, texts)
    return make_dense_bundle(
        out,
        loaded,
        size=size,
        precisions=precisions,
        templates=templates,
        absent=absent,
        name=name,
        say=say,
    )


FURTHER_TEXTS = (
    "rock-strewn, 50 m",
    "it's a long way",
    "a fallen tree trunk across the trail",
    "Mud & puddles (deep!)",
)
"""Texts for which an exported tokenizer is compared with the checkpoint's own, beside the bundle's words."""
