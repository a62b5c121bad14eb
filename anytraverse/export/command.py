"""Runs `anytraverse export`: makes a bundle for the rover from a checkpoint."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from anytraverse.export import DEFAULT_CLIP, RANDOM, export_bundle

if TYPE_CHECKING:
    from anytraverse.bundle.manifest import Manifest


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.description = "Make a CLIPSeg checkpoint into a bundle: one folder to copy to the rover."
    parser.add_argument(
        "checkpoint",
        metavar="CHECKPOINT",
        help="a folder, or an id of the Hugging Face hub such as CIDAS/clipseg-rd64-refined; "
        f'"{RANDOM}": random weights of that size, to see how fast a board is without a download',
    )
    parser.add_argument("out", metavar="OUT", type=Path, help="the bundle's folder")
    parser.add_argument("--size", type=int, default=352, help="pixels of the square input, by default 352")
    parser.add_argument(
        "--precision",
        default="fp32",
        metavar="LIST",
        help="variants: fp32 (default), or fp32,int8, of which int8 is used where `bundle check` passed it",
    )
    parser.add_argument(
        "--scene",
        choices=("shared", "clip-b32"),
        default="shared",
        help="the scene embedding: from CLIPSeg's own tower (default), or the paper's, which costs a second "
        "encoder; thresholds differ",
    )
    parser.add_argument(
        "--clip", metavar="CHECKPOINT", help=f"where clip-b32 comes from, by default {DEFAULT_CLIP}"
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
        name=options.name,
        say=_progress(),
    )
    print(_summary_text(manifest, options.out))
    return 0


def _progress() -> Callable[[str], None]:
    begun = time.monotonic()

    def say(line: str) -> None:
        print(f"{time.monotonic() - begun:6.1f} s  {line}", file=sys.stderr, flush=True)

    return say


def _summary_text(manifest: Manifest, out: Path) -> str:
    megabytes = sum(entry.size for entry in manifest.files.values()) / 1e6
    lines = [
        f"{out}: {manifest.model_id}, {', '.join(manifest.variants)}, {megabytes:.0f} MB",
        f"  weights  {manifest.source['weights']}, licence: {manifest.source['licence']}",
        f"  next     copy the folder to the rover, and there: anytraverse bundle check {out.name}",
    ]
    return "\n".join(lines)
