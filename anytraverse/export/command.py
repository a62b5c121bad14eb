"""Runs `anytraverse export`: makes a bundle for the rover from a checkpoint."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from anytraverse.errors import BundleError
from anytraverse.export import CLIPSEG_SIZE, DEFAULT_CLIP, RANDOM, RANDOM_DENSE, export_bundle
from anytraverse.preferences import MAX_WORDS

if TYPE_CHECKING:
    from anytraverse.bundle.manifest import Manifest

_LARGEST = 1 << 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.description = (
        "Make a checkpoint into a bundle, one folder to copy to the rover: of CLIPSeg (clipseg:DIR), or of "
        "SigLIP 2 or TIPSv2 (dense:FOLDER)."
    )
    drawn = ", ".join(f'"{name}"' for name in (RANDOM, *RANDOM_DENSE))
    parser.add_argument(
        "checkpoint",
        metavar="CHECKPOINT",
        help="a folder, or an id of the Hugging Face hub such as CIDAS/clipseg-rd64-refined; "
        f"{drawn}: random weights of the published size, to see how fast a board is without a download",
    )
    parser.add_argument("out", metavar="OUT", type=Path, help="the bundle's folder")
    parser.add_argument(
        "--size",
        type=int,
        help=f"pixels of the square input, by default {CLIPSEG_SIZE} for CLIPSeg, else the checkpoint's own",
    )
    parser.add_argument(
        "--precision",
        default="fp32",
        metavar="LIST",
        help="variants: fp32 (default), or fp32,int8, of which int8 is used where `bundle check` passed it",
    )
    parser.add_argument(
        "--scene",
        choices=("shared", "clip-b32"),
        help="of CLIPSeg, the scene embedding: from its own tower (shared, the default), or the paper's, "
        "which costs a second encoder; thresholds differ",
    )
    parser.add_argument(
        "--clip", metavar="CHECKPOINT", help=f"where clip-b32 comes from, by default {DEFAULT_CLIP}"
    )
    parser.add_argument(
        "--templates",
        metavar="FILE",
        type=Path,
        help="for dense: texts with {} for the word, one a line, whose embeddings are averaged",
    )
    parser.add_argument(
        "--absent",
        metavar="FILE",
        type=Path,
        help=f"for dense: at least {MAX_WORDS} words for things that your terrain never shows, one a line",
    )
    parser.add_argument("--name", help="what the bundle is called, by default as the checkpoint")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Export, and print the next step. Returns 0. Raises BundleError."""
    asked = [part.strip() for part in options.precision.split(",") if part.strip()]
    manifest = export_bundle(
        options.checkpoint,
        options.out,
        size=options.size,
        precisions=asked,
        scene=options.scene,
        clip=options.clip,
        templates=_lines(options.templates),
        absent=_lines(options.absent),
        name=options.name,
        say=_progress(),
    )
    print(_summary_text(manifest, options.out))
    return 0


def _lines(path: Path | None) -> tuple[str, ...]:
    """Return the lines of a text file but for empty ones and those that begin with "#"; () for None."""
    if path is None:
        return ()
    try:
        text = path.read_bytes()[:_LARGEST].decode("utf-8")
    except (OSError, ValueError) as error:
        raise BundleError(f"{path} cannot be read as text ({error}): give a file of lines") from None
    lines = tuple(line.strip() for line in text.splitlines() if line.strip() and line.strip()[0] != "#")
    if not lines:
        raise BundleError(f"{path} holds no line: write one text a line")
    return lines


def _progress() -> Callable[[str], None]:
    begun = time.monotonic()

    def say(line: str) -> None:
        print(f"{time.monotonic() - begun:6.1f} s  {line}", file=sys.stderr, flush=True)

    return say


def _summary_text(manifest: Manifest, out: Path) -> str:
    megabytes = sum(entry.size for entry in manifest.files.values()) / 1e6
    frames = " --frames FOLDER" if manifest.kind == "dense" else ""
    lines = [
        f"{out}: {manifest.model_id}, {', '.join(manifest.variants)}, {megabytes:.0f} MB",
        f"  weights  {manifest.source['weights']}, licence: {manifest.source['licence']}",
        f"  next     copy the folder to the rover, and there: anytraverse bundle check {out.name}{frames}",
    ]
    return "\n".join(lines)
