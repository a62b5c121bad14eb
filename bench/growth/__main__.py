"""Measures how cost grows: with words, remembered scenes, the size of frames, and hours.

`power`: at the end of a line cost grows as x ** power, 0 flat, 1 linear, 2 quadratic. `rise`, with its 95 %
interval: of hours MB or ms per 100,000 frames, of daemon MB an hour. All on one core; times are of process
CPU, the median of several with its quartiles. CLIPSeg has random weights of the true size, which cost what
trained ones do.
Run: python -m bench.growth [words history sizes hours daemon] [--quick] [--bundle CLIPSEG] [--minutes 60].
Prints a line for each measured point; the last line is one JSON object.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
from pathlib import Path
from typing import Any

PARTS = ("hours", "words", "history", "sizes", "daemon")
"""Modules here, each with `measure`. The hours are first: memory is theirs alone then."""
OVER = {"hours": 1e5, "daemon": 1.0}
"""Part -> the frames, or hours, over which its rises are told."""


def main() -> int:
    """Prints the points; returns 0."""
    parser = argparse.ArgumentParser(prog="python -m bench.growth", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"{', '.join(PARTS)}; else all")
    parser.add_argument("--quick", action="store_true", help="fewer points, and no CLIPSeg")
    parser.add_argument("--bundle", type=Path, help="CLIPSeg's; by default one of random weights is made")
    parser.add_argument("--minutes", type=float, help="of daemon, in real time; by default 60, quick 0.2")
    given = parser.parse_args()
    unknown = [part for part in given.parts if part not in PARTS]
    if unknown:
        parser.error(f"no part is called {unknown[0]}: give {', '.join(PARTS)}")
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as the vision process runs; read when numpy is imported
    from bench.series import slope

    told: dict[str, Any] = {"series": []}
    for part in [part for part in PARTS if part in (given.parts or PARTS)]:
        module = importlib.import_module(f"bench.growth.{part}")
        only = {"minutes": given.minutes} if part == "daemon" else {"bundle": given.bundle}
        measured = module.measure(quick=given.quick, **only)
        told["series"] += [series.as_json() for series in measured]
        if part in OVER:
            for name, points in (line for series in measured for line in series.lines.items()):
                rise = slope(points, OVER[part])
                found = {"value": rise.value, "interval": [rise.low, rise.high]}
                told.setdefault("rise", {})[name] = found
    print(json.dumps(told))
    return 0


if __name__ == "__main__":
    sys.exit(main())
