"""Runs `anytraverse bundle check`: verifies a bundle, times it here, and decides whether int8 may run."""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from anytraverse.bundle import against
from anytraverse.bundle.calibrating import LEAST_RATIO
from anytraverse.bundle.checking import MOST_WORDS, BundleCheckPlan, BundleReport, check
from anytraverse.bundle.timing import Timing
from anytraverse.errors import PreferencesError
from anytraverse.preferences import clean_word

_PARTS = {
    "encode": "a frame",
    "attend_1": "1 word",
    "attend_4": "4 words",
    "embed": "the scene",
    "new_word": "a new word",
    "weights": "other weights",
    "step": "all for a frame",
    "clock": "... by the clock",
    "slowest": "the slowest",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.description = (
        "Verify a bundle, time it on this machine, and compare its int8 variant with fp32 on your frames. "
        "A dense bundle is calibrated on these frames, and refused before that. "
        "Speed is judged by CPU time, not by the clock. "
        "With --against, compare it with a larger bundle instead, and write nothing. "
        "Exit code 0: good; 1: int8 failed its check, fp32 runs; 2: the bundle is refused."
    )
    parser.add_argument("folder", metavar="DIR", type=Path, help="the bundle")
    parser.add_argument("--frames", metavar="PATH", type=Path, help="a folder of pictures, or a video")
    parser.add_argument(
        "--against",
        metavar="DIR",
        type=Path,
        help="another bundle, of a larger size: say what this one loses on your frames, and how fast it is",
    )
    parser.add_argument("--words", type=_words, default=(), help="words to look for, separated by commas")
    parser.add_argument("--threads", type=int, default=0, metavar="N", help="cores to use, by default all")
    parser.add_argument(
        "--precision",
        choices=("fp32", "int8"),
        default="fp32",
        help="the variant to time, whose memory to tell, or to compare, by default %(default)s",
    )
    parser.add_argument(
        "--repeat",
        type=_count,
        default=5,
        metavar="N",
        help="times that parts are timed, by default %(default)s",
    )
    parser.add_argument("--json", action="store_true", help="print the figures as JSON on the last line")


def run(options: argparse.Namespace) -> int:
    """Check the bundle and print the report. Returns 2 for one not calibrated, 1 when int8 failed, else 0."""
    plan = BundleCheckPlan(
        options.folder, options.frames, options.words, options.threads, options.precision, options.repeat
    )
    if options.against is not None:
        found = against.check_against(plan, options.against, _say)
        print(json.dumps(against.figures(found), allow_nan=False) if options.json else against.text(found))
        return 0
    report = check(plan, _say)
    print(json.dumps(figures(report), allow_nan=False) if options.json else text(report))
    if report.refused:
        return 2
    return 1 if report.record is not None and not report.record.passed else 0


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def figures(report: BundleReport) -> dict[str, Any]:
    """Return the whole report for JSON."""
    manifest, timing = report.manifest, report.timing
    return {
        "bundle": manifest.name,
        "kind": manifest.kind,
        "model_id": manifest.model_id,
        "machine": {"id": report.machine.id, **asdict(report.machine)},
        "threads": report.threads,
        "load_s": {name: round(seconds, 3) for name, seconds in report.loads.items()},
        "milliseconds": {name: _rounded(asdict(parts)) for name, parts in report.timings.items()},
        "peak_rss_mb": round(report.memory, 1),
        "variant": report.variant,
        "why": report.why,
        "refused": report.refused or None,
        "frames_per_second": _floor(timing.rate),
        "freshness_s": round(timing.freshness, 2),
        "keeps_freshness": timing.pace.keeps,
        "machine_busy": timing.busy,
        "calibrated": None if report.calibrated is None else asdict(report.calibrated),
        "record": None if report.record is None else asdict(report.record),
    }


def text(report: BundleReport) -> str:
    """Return the whole report as lines for a person."""
    manifest, machine = report.manifest, report.machine
    size, names = manifest.image, list(report.timings)
    lines = [
        f"bundle      {manifest.name}: {manifest.kind}, {size.width}x{size.height}, scene {manifest.scene}",
        f"machine     {machine.cpu}, threads {report.threads}, onnxruntime {machine.onnxruntime}",
        f"files       {len(manifest.files)} verified",
        f"{'':22}" + "".join(f"{name:>12}" for name in names),
        _row("load", [f"{report.loads[name]:.1f} s" for name in names]),
    ]
    for part, label in _PARTS.items():
        taken = [getattr(report.timings[name], part) for name in names]
        lines.append(_row(label, ["-" if ms is None else f"{ms:.1f} ms" for ms in taken]))
    lines += [f"memory      {report.memory:.0f} MB at most, with {names[0]} alone"]
    lines += [*_calibrated(report), *_compared(report)]
    lines += [f"rate        {_pace(report.timing)}", f"            {_judged_by(report.timing)}"]
    if report.refused:
        return "\n".join([*lines, f"refused     {report.refused}"])
    return "\n".join([*lines, f"runs here   {report.variant}: {report.why}"])


def _judged_by(timing: Timing) -> str:
    if not timing.busy:
        return "judged by CPU time"
    return (
        f"judged by CPU time: a frame took {timing.clock:.0f} ms by the clock, as other programs or the disk "
        "kept it waiting; if they always do, expect that"
    )


def _calibrated(report: BundleReport) -> list[str]:
    found = report.calibrated
    if found is None:
        return []
    chance, frames = found.calibration.chance, found.calibration.frames
    lines = [
        f"calibrated  on {frames} frames, written into the manifest: of the places, your words explain "
        f"{found.explained:.0%}, absent words {chance:.0%}"
    ]
    if found.explained < LEAST_RATIO * chance:
        lines.append(
            "            WARNING: these words explain hardly more than words for things that are not there. "
            "Nearly all will be unknown: try other words (--words), or another model"
        )
    return lines


def _compared(report: BundleReport) -> list[str]:
    record = report.record
    if record is None:
        return []
    iou = (
        ""
        if record.iou is None
        else f", worst word's IoU {record.iou:.3f}, worst mask's {record.iou_worst:.3f}"
    )
    return [
        f"compared    {record.masks} masks of {record.frames} frames{iou}, "
        f"cosine {record.cosine:.4f}, {record.fp32_ms:.0f} and {record.int8_ms:.0f} ms"
    ]


def _pace(timing: Timing) -> str:
    pace = f"up to {_floor(timing.rate):g} frames/s, and a freshness limit T of {timing.freshness:.1f} s"
    if timing.pace.keeps:
        return pace
    return (
        f"{pace}; too slow for the hold policy: what is known of the trail may be "
        f"{timing.pace.worst_age:.1f} s old (a smaller size or int8 is faster)"
    )


def _row(label: str, cells: list[str]) -> str:
    return f"  {label:20}" + "".join(f"{cell:>12}" for cell in cells)


def _rounded(parts: dict[str, float | None]) -> dict[str, float | None]:
    return {name: None if ms is None else round(ms, 2) for name, ms in parts.items()}


def _floor(rate: float) -> float:
    """Round down to tenths, so that the reported rate can be reached."""
    return math.floor(round(rate * 10, 6)) / 10 if rate >= 0.1 else round(rate, 3)


def _count(value: str) -> int:
    if not value.isdecimal() or not 1 <= int(value) <= 1000:
        raise argparse.ArgumentTypeError(f"{value} is not a number from 1 to 1000")
    return int(value)


def _words(value: str) -> tuple[str, ...]:
    try:
        words = tuple(dict.fromkeys(clean_word(word) for word in value.split(",") if word.strip()))
    except PreferencesError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    if not 1 <= len(words) <= MOST_WORDS:
        raise argparse.ArgumentTypeError(f"give 1 to {MOST_WORDS} words, separated by commas")
    return words
