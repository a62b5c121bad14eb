"""Runs `anytraverse fit`: fits the built-in perceiver's network to labelled frames of the user's own."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.description = (
        "Fit the built-in network to labelled frames of your own, and score it on drives that were held out. "
        "A drive is a block of a hundred numbers. A fit that is worse there than what it would replace is "
        "refused. The last line is JSON."
    )
    parser.add_argument(
        "folder",
        metavar="DIR",
        type=Path,
        help="pictures NNNN.jpg, label images NNNN.png of class ids, and classes.json",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("ground.onnx"),
        metavar="FILE",
        help="the network, by default %(default)s; its calibration is written beside it, ending in .npz",
    )
    parser.add_argument(
        "--from",
        dest="start",
        default="builtin",
        metavar="WHAT",
        help="where training begins: builtin (default), FILE.onnx of an earlier fit, or scratch, which needs "
        "hundreds of frames",
    )
    parser.add_argument(
        "--validation",
        type=int,
        nargs="+",
        metavar="N",
        help="blocks that are held out and choose the numbers",
    )
    parser.add_argument(
        "--test",
        type=int,
        nargs="+",
        default=[],
        metavar="N",
        help="blocks that are held out and only reported",
    )
    parser.add_argument(
        "--made",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="a labelled folder of rendered frames",
    )
    parser.add_argument(
        "--cutouts",
        type=Path,
        metavar="DIR",
        help="photographs of things without a background (PNG with opacity), to paste as things without a "
        "name",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    parser.add_argument(
        "--steps", type=int, metavar="N", help="0 with a network to begin from: calibrate it only"
    )
    parser.add_argument("--threads", type=int, default=1, metavar="N", help="cores to use, by default one")
    parser.add_argument("--json", action="store_true", help="print nothing but the last line, the JSON")


def run(options: argparse.Namespace) -> int:
    """Fit, compare, write. Returns 1 when the fit was refused. Raises AnyTraverseError, OSError."""
    from anytraverse.training.running import run_fit

    return run_fit(options)
