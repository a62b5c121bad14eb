"""Measures how far a perceiver may be trusted, on frames of held-out drives and of other places.

What: drivable IoU; clean frames that are stopped; real things that are noticed; things pasted into clean
frames, driven up to from 10 m, that are never noticed before the stopping distance; tapped ones that call
again, and what else is taken for them; remembered scenes that frames of elsewhere match; time and memory.
Every figure has its count and a 95 % interval.
Run: python -m bench.perception [--perceiver builtin:FILE.onnx] [--sweep]; `make bench-perception`. It needs
the labelled frames beside the checkout, and photographs of things: `python -m bench.cutouts DIR`, which it
runs by itself without --cutouts. The results of the shipped perceiver, all parts as shipped, are written to
bench/results/perception.json and .md; others where --out says. The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2

from anytraverse.perception import make_perceiver
from anytraverse.perception.runtime import Runtime
from bench.perception import cost, report
from bench.perception.approaches import Approach, approaches, first_seen, measure_approaches, missed, sources
from bench.perception.figures import Figure
from bench.perception.frames import DATA, Frames, read_frames
from bench.perception.ground import measure_ground
from bench.perception.judged import Judge, changed
from bench.perception.pasting import Cutout
from bench.perception.scenes import FEW, MANY, measure_scenes
from bench.perception.stops import clean_frames, measure_stops, measure_things
from bench.perception.sweep import sweep, table
from bench.perception.taps import measure_taps
from bench.perception.things import LARGE, SMALL, gather

PARTS = ("ground", "stops", "approaches", "taps", "scenes", "cost")


def main() -> int:
    """Prints the table; the last line is one JSON object."""
    given = _arguments()
    if not (given.data / "trail").is_dir() or not (given.data / "abroad").is_dir():
        print(f"skipped: {given.data} does not hold the labelled frames trail/ and abroad/")
        print(json.dumps({"skipped": f"no labelled frames in {given.data}"}))
        return 0
    cv2.setNumThreads(1)
    begin = time.perf_counter()
    frames = read_frames(given.data, given.blocks)
    perceiver = make_perceiver(given.perceiver, Runtime(threads=1))
    judge = Judge.of(perceiver)
    judge = judge.with_settings(changed(judge.settings, given.tile_share, given.tile))
    figures: dict[str, Figure | str] = {}
    driven: list[Approach] = []
    more: dict[str, Any] = {}
    if "ground" in given.only:
        figures |= _told(measure_ground(perceiver, frames), begin)
    if "stops" in given.only or given.sweep:
        clean = clean_frames(judge, frames)
        figures |= _told(measure_stops(clean) | measure_things(judge, frames), begin)
    if {"approaches", "taps"} & set(given.only) or given.sweep:
        cutouts = _cutouts(frames, given)
    if "approaches" in given.only or given.sweep:
        driven = list(approaches(judge, frames, cutouts, given.approaches, given.seed, whole=given.sweep))
        figures |= _told(measure_approaches(driven), begin)
        more["first_noticed"] = first_seen(driven)
    if "taps" in given.only:
        figures |= _told(measure_taps(judge, frames, cutouts, given.seed), begin)
    if given.sweep:
        points = sweep(judge, clean, driven)
        print(table(points), flush=True)
        more["sweep"] = [point.as_json() for point in points]
    if "scenes" in given.only:
        figures |= _told(measure_scenes(perceiver, frames, given.seed), begin)
    last = _line(figures, driven)
    if "cost" in given.only:
        last |= cost.measure_cost(given.perceiver, given.frames)
        size = cost.size_mb(given.perceiver)
        last |= {"mb": None if size is None else round(size, 2)}
        figures |= {name: f"{last[name]}" for name in _COSTS}
    text = report.markdown(figures, more.get("first_noticed", {}), sources(driven))
    print(f"\n{text}\n\n{time.perf_counter() - begin:.0f} s")
    if given.out:
        settings = {"tile_share": judge.settings.tile_share, "thresholds": asdict(judge.settings.thresholds)}
        told = {"command": "make bench-perception", "model": perceiver.model_id, "settings": settings}
        report.write(given.out, {**told, "line": last}, figures, more)
        given.out.with_suffix(".md").write_text(text + "\n")
    print(json.dumps(last))
    return 0


_COSTS = ("ms_frame", "ms_frame_p95", "ms_wall", "peak_rss_mb", "peak_pss_mb", "mb")


def _cutouts(frames: Frames, given: argparse.Namespace) -> dict[str, list[Cutout]]:
    with _photographs(given.cutouts) as photographs:
        cutouts = gather(photographs, frames.abroad, given.seed)
    for kind, pictures in cutouts.items():
        if not pictures:
            print(f"no cut-out of {kind}: it is left out")
    return cutouts


@contextmanager
def _photographs(folder: Path | None) -> Iterator[Path | None]:
    """Give a folder KIND/NAME.png: the one given, or one that is made now; None where that fails."""
    if folder is not None:
        yield folder / "held_out"
        return
    with tempfile.TemporaryDirectory() as temporary:
        command = [sys.executable, "-m", "bench.cutouts", temporary]
        done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=900)
        if done.returncode:
            print(f"no photographs: {(done.stderr.strip().splitlines() or ['it failed'])[-1]}")
        yield Path(temporary) / "held_out" if done.returncode == 0 else None


def _told(found: dict[str, Figure], begin: float) -> dict[str, Figure]:
    for name, figure in found.items():
        print(f"{time.perf_counter() - begin:5.0f} s  {name:64} {figure}", flush=True)
    return found


def _line(figures: dict[str, Figure | str], driven: list[Approach]) -> dict[str, Any]:
    names = {
        "iou_home": "IoU, rover's words: home",
        "iou_abroad": "IoU, rover's words: abroad",
        "iou_home_all": "IoU, words for all: home",
        "iou_abroad_all": "IoU, words for all: abroad",
        "false_home": "clean frames stopped: home",
        "false_abroad": "clean frames stopped: abroad",
        "noticed_abroad": "real things over 2% of the ROI, abroad: not OK",
        "foreign_match_40": f"foreign match at {FEW}: frames abroad",
        "foreign_match_256": f"foreign match at {MANY}: frames abroad",
        "near_recall_40": f"near recall at {FEW}: other light, moved",
        "near_recall_256": f"near recall at {MANY}: other light, moved",
    }
    line: dict[str, Any] = {}
    for key, name in names.items():
        figure = figures.get(name)
        line[key] = figure.rounded if isinstance(figure, Figure) else None
    line["missed_large"] = missed(driven, LARGE).rounded
    line["missed_small"] = missed(driven, SMALL).rounded
    return line


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--perceiver", default="builtin")
    parser.add_argument(
        "--data", type=Path, default=DATA, help="folder with trail/, abroad/, frames/, sequence/"
    )
    parser.add_argument("--blocks", type=int, nargs="+", default=[2, 4], help="held-out hundreds of trail/")
    parser.add_argument("--cutouts", type=Path, metavar="DIR", help="folder that `bench.cutouts` wrote")
    parser.add_argument("--approaches", type=int, default=40, help="for each kind and place")
    parser.add_argument("--frames", type=int, default=150, help="timed frames")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--tile-share", type=float, help="a tile's side over the ROI's width")
    parser.add_argument("--tile", type=float, help="the tile's threshold")
    parser.add_argument("--sweep", action="store_true", help="tile sizes and thresholds, whole approaches")
    parser.add_argument("--only", nargs="+", choices=PARTS)
    parser.add_argument("--out", type=Path, help="JSON file for the results, with the table beside it")
    given = parser.parse_args()
    other = (given.tile_share, given.tile, given.only, given.sweep or None)
    if given.out is None and given.perceiver == "builtin" and not any(other):
        given.out = report.RESULTS
    given.only = given.only or PARTS
    return given


if __name__ == "__main__":
    sys.exit(main())
