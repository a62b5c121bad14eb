"""Drives random simulated trails under each policy, in virtual time and one process for each trail.

A trail is 60 to 80 m of random bends, its path 3.0 to 4.8 m wide. What stands on it and beside it: trails.py.
The rover is 0.6 m wide and drives at 1.2 m/s; its camera swings by 2 to 4 degrees, and frames are judged up
to 0.3 s late. Engine, vision worker and rules of calls and holds are those of the companion; the wire is
assumed. Who answers: operator_model.py. Prints a line for each drive; the last line is one JSON object.
Run: make bench-field, or python -m bench.field_drive [--runs 50] [--truth] [--policies hold] [--jobs 2]
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from functools import partial

from anytraverse.evaluation.spreading import spread
from bench.field_drive.drive import POLICIES, drive_all
from bench.field_drive.scoring import DriveResult, figures


def main(arguments: list[str] | None = None) -> int:
    """Drive all trails, print the figures; returns 0."""
    given, begun = _arguments(arguments), time.monotonic()
    seeds = range(given.first, given.first + given.runs)
    work = partial(drive_all, policies=tuple(given.policies), truth=given.truth)
    done = spread(work, seeds, processes=given.jobs, done=_say)
    found = [one for trail in done for one in trail]
    told = {name: figures([one for one in found if one.policy == name]) for name in given.policies}
    seconds = round(time.monotonic() - begun)
    print(json.dumps({**told, "perceiver": "truth" if given.truth else "builtin", "took_s": seconds}))
    return 0


def _say(_number: int, found: list[DriveResult]) -> None:
    for one in found:
        print(one, flush=True)


def _arguments(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m bench.field_drive",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--runs", type=int, default=50, help="trails (default %(default)s)")
    parser.add_argument("--first", type=int, default=1, help="the first one's seed (default %(default)s)")
    parser.add_argument("--truth", action="store_true", help="perceive by the true labels")
    parser.add_argument("--policies", nargs="+", choices=POLICIES, default=list(POLICIES), help="default all")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default %(default)s)")
    given = parser.parse_args(arguments)
    if given.runs < 1 or given.jobs < 1:
        parser.error("give at least one run and one process")
    return given


if __name__ == "__main__":
    sys.exit(main())
