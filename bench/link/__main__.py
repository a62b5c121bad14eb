"""The radio link proven. Prints a line a run; the last line is one JSON object.

lossy: calls over a bad radio in virtual time. The exit code is 1 if one was not answered exactly once.
Run: make bench-link, or python -m bench.link lossy
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

_Report = tuple[dict[str, Any], bool]
"""Figures, and whether all promises were kept."""


def main() -> int:
    given = _arguments()
    logging.disable(logging.CRITICAL)
    figures: dict[str, Any] = {}
    good = True
    for name in given.what or list(RUNS):
        figures[name], kept = RUNS[name](given)
        good &= kept
    print(json.dumps(figures), flush=True)
    return 0 if good else 1


def _lossy(given: argparse.Namespace) -> _Report:
    from bench.link.lossy import WEATHERS, run

    told, good = {}, True
    for name, weather in WEATHERS.items():
        with tempfile.TemporaryDirectory(prefix="atl-") as folder:
            outcome = run(weather, given.calls, Path(folder), given.seed)
        told[name] = outcome.figures()
        good &= outcome.good and outcome.calls == given.calls
        print(f"{name:14} {outcome}", flush=True)
    return told, good


RUNS: dict[str, Callable[[argparse.Namespace], _Report]] = {"lossy": _lossy}


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.link", description=__doc__)
    parser.add_argument(
        "what", nargs="*", choices=[[], *RUNS], metavar="WHAT", help=f"{', '.join(RUNS)}; else all"
    )
    parser.add_argument("--calls", type=int, default=200, help="in each weather (default 200)")
    parser.add_argument("--seed", default="1", help="of the radio (default 1)")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
