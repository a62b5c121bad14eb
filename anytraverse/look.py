"""Judges one picture for the command `anytraverse look`."""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from anytraverse.assessment import Assessment
from anytraverse.decoding import MAX_BYTES, PictureTooLargeError, decode
from anytraverse.engine import AnyTraverse
from anytraverse.errors import AnyTraverseError, PerceiverError
from anytraverse.frame import Frame, Image
from anytraverse.judging import Settings
from anytraverse.memory import first_memory
from anytraverse.perception import Perceiver, make_perceiver, weak_words
from anytraverse.preferences import Preferences
from anytraverse.regular_file import read_regular
from anytraverse.release import to_install

DEFAULT_PROMPTS = "trail: 1; grass: 1; bush: -1; tree: -1; sky: -0.5"


class PictureError(AnyTraverseError, ValueError):
    """Reports a file that is not a picture."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.description = "Judge one picture: what is drivable, what is unknown."
    parser.add_argument("image", metavar="IMAGE", help="a picture file, e.g. JPEG or PNG")
    parser.add_argument(
        "--prompts",
        default=DEFAULT_PROMPTS,
        metavar="WORDS",
        help='words and weights from -1 (never drive) to 1 (drive), by default "%(default)s"',
    )
    parser.add_argument("--perceiver", default="builtin", help="which perceiver, by default %(default)s")
    parser.add_argument("--out", metavar="PNG", help="write the panel of all maps to this file")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON on the last line")


def run(options: argparse.Namespace) -> int:
    """Judge `options.image`, print the figures, write the panel to `options.out`. Returns 0."""
    words = Preferences.parse(options.prompts)
    image = read_picture(options.image)
    perceiver = make_perceiver(options.perceiver)
    assessment, settings, milliseconds = judge(image, words, perceiver)
    if options.out:
        from anytraverse.drawing import write_png
        from anytraverse.panel import draw_panel

        title = f"{Path(options.image).name}   {milliseconds:.0f} ms"
        write_png(options.out, draw_panel(image, assessment, settings.region, title))
    if not options.json or options.out:
        print(_text(options.image, assessment, settings, milliseconds, options.out))
        if weak := weak_words(perceiver, words):
            print(f"  weak words   {', '.join(weak)}: guesses of this perceiver, tap such things instead")
    if options.json:
        print(json.dumps(_figures(assessment, milliseconds), allow_nan=False))
    return 0


def read_picture(path: str) -> Image:
    """Read a picture as RGB, (height, width, 3) uint8.

    Raises OSError, PictureError, and PerceiverError without OpenCV.
    """
    try:
        import cv2
    except ImportError:
        raise PerceiverError(f"reading pictures needs OpenCV: {to_install('rover')}") from None
    try:
        picture = decode(read_regular(path, MAX_BYTES + 1))
    except PictureTooLargeError as error:
        raise PictureError(f"{path}: {error}") from error
    if picture is None:
        raise PictureError(f"{path}: not a picture that can be read, give a JPEG or PNG file")
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def judge(image: Image, words: Preferences, perceiver: Perceiver) -> tuple[Assessment, Settings, float]:
    """Judge one picture without a reference scene; return assessment, settings and milliseconds taken."""
    settings = Settings.of(perceiver.defaults)
    engine = AnyTraverse(perceiver, settings, first_memory(perceiver.model_id, words))
    begin = time.perf_counter()
    assessment = engine.judge(engine.observe(Frame(1, 0.0, image)), 0.0)
    return assessment, settings, (time.perf_counter() - begin) * 1e3


def _reasons(assessment: Assessment) -> list[str]:
    return sorted(reason.value for reason in assessment.reasons)


def _figures(assessment: Assessment, milliseconds: float) -> dict[str, Any]:
    roi = assessment.roi
    box = roi.worst_tile.box if roi else None
    return {
        "reasons": _reasons(assessment),
        "roi_traversability": round(roi.traversability, 4) if roi else None,
        "roi_uncertainty": round(roi.uncertainty, 4) if roi else None,
        "worst_tile": {
            "box": [round(side, 4) for side in (box.left, box.top, box.right, box.bottom)],
            "uncertainty": round(roi.worst_tile.uncertainty, 4),
        }
        if roi and box
        else None,
        "similarity": assessment.similarity,
        "prompts": dict(assessment.words),
        "milliseconds": round(milliseconds, 1),
    }


def _text(
    name: str, assessment: Assessment, settings: Settings, milliseconds: float, panel: str | None
) -> str:
    lines = [f"{name}: {', '.join(_reasons(assessment)).replace('_', ' ') or 'OK'}"]
    roi, limits = assessment.roi, settings.thresholds
    if roi is not None:
        box = roi.worst_tile.box
        where = f"at x {box.left:.2f}-{box.right:.2f}, y {box.top:.2f}-{box.bottom:.2f}"
        tile_limit = "" if limits.tile is None else f"limit {limits.tile:.2f}, "
        lines += [
            f"  drivable     {roi.traversability:.2f}",
            f"  uncertainty  {roi.uncertainty:.2f}  (limit {limits.roi:.2f})",
            f"  worst tile   {roi.worst_tile.uncertainty:.2f}  ({tile_limit}{where})",
        ]
    lines.append(f"  words        {assessment.words.format()}")
    lines.append(f"  took         {milliseconds:.1f} ms")
    if panel:
        lines.append(f"  panel        {panel}")
    return "\n".join(lines)
