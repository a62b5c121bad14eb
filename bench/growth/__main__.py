"""Measures how cost grows: with words, remembered scenes, the size of frames, and hours.

`power`: at the end of a line cost grows as x ** power, 0 flat, 1 linear, 2 quadratic. `rise`, of hours: MB
or ms per 100,000 frames, with its 95 % interval. All on one core; times are of process CPU, the median of
several with its quartiles. CLIPSeg has random weights of the true size, which cost what trained ones do.
Run: python -m bench.growth [words history sizes hours] [--quick] [--bundle CLIPSEG]. Prints a line for each
measured point; the last line is one JSON object.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
from pathlib import Path
from typing import Any

PARTS = ("hours", "words", "history", "sizes")
"""Modules here, each with `measure`. The hours are first: memory is theirs alone then."""


def main() -> int:
    """Prints the points; returns 0."""
    parser = argparse.ArgumentParser(prog="python -m bench.growth", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"{', '.join(PARTS)}; else all")
    parser.add_argument("--quick", action="store_true", help="fewer points, and no CLIPSeg")
    parser.add_argument("--bundle", type=Path, help="CLIPSeg's; by default one of random weights is made")
    given = parser.parse_args()
    unknown = [part for part in given.parts if part not in PARTS]
    if unknown:
        parser.error(f"no part is called {unknown[0]}: give {', '.join(PARTS)}")
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as the vision process runs; read when numpy is imported
    told: dict[str, Any] = {"series": []}
    for part in [part for part in PARTS if part in (given.parts or PARTS)]:
        module = importlib.import_module(f"bench.growth.{part}")
        measured = module.measure(quick=given.quick, bundle=given.bundle)
        told["series"] += [series.as_json() for series in measured]
        if part == "hours":
            rises = {name: module.slope(points) for one in measured for name, points in one.lines.items()}
            told["rise"] = {
                name: {"value": rise.value, "interval": [rise.low, rise.high]} for name, rise in rises.items()
            }
    print(json.dumps(told))
    return 0


if __name__ == "__main__":
    sys.exit(main())
