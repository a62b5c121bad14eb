"""Causes faults on purpose, `--runs` of each kind by seed, with several rovers side by side.

Prints a line a run; the last line is one JSON object, also when it is ended early. The exit code is 1 if a
rover did not stop within its limit, a human was overruled, or a rover in report policy was commanded.
Run: make bench-stopping, or python -m bench.stopping [--runs 50] [--jobs 3] [--only faults human]
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from pathlib import Path

from bench.stopping.figures import figures, good, line
from bench.stopping.jobs import FAST, Job, Run
from bench.stopping.runs import GROUPS, GUIDED


def main() -> int:
    given = _arguments()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _end)
    cancelled = threading.Event()
    runs: list[Run] = []
    with tempfile.TemporaryDirectory(prefix="ats-", ignore_cleanup_errors=True) as folder:
        out = given.out or Path(folder)
        pool = ThreadPoolExecutor(given.jobs)
        try:
            seeds = range(given.first, given.first + given.runs)
            todo = [
                pool.submit(
                    _all_of,
                    {**GROUPS, **GUIDED}[group],
                    Job(seed, out / group, cancelled, given.brakes, given.speed),
                    runs,
                )
                for seed in seeds
                for group in (GUIDED if given.guide else given.only)
            ]
            _wait(todo)
        finally:
            cancelled.set()
            pool.shutdown(cancel_futures=True)
            print(json.dumps({"brakes": given.brakes, "guide": given.guide, **figures(runs)}), flush=True)
    return 0 if good(runs) else 1


def _all_of(group: Callable[[Job], Iterator[Run]], job: Job, runs: list[Run]) -> None:
    for run in group(job):
        runs.append(run)
        print(line(run), flush=True)


def _wait(todo: list[Future[None]]) -> None:
    """Waits until all are done; raises what the first that fails has raised."""
    left = set(todo)
    while left:
        done, left = wait(left, timeout=1.0, return_when=FIRST_COMPLETED)
        for future in done:
            future.result()


def _end(number: int, _frame: object) -> None:
    raise SystemExit(128 + number)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.stopping", description=__doc__)
    parser.add_argument("--runs", type=int, default=50, help="of each kind (default 50)")
    parser.add_argument("--first", type=int, default=1, metavar="SEED", help="the first seed (default 1)")
    parser.add_argument("--jobs", type=int, default=3, help="stages side by side (default 3)")
    parser.add_argument("--only", nargs="+", choices=list(GROUPS), default=list(GROUPS), metavar="GROUP")
    parser.add_argument(
        "--brakes", action="store_true", help="the script brakes before HOLD: hold_by = brake"
    )
    parser.add_argument("--guide", action="store_true", help="faults while it guides, and nothing else")
    parser.add_argument("--speed", type=float, default=FAST, help=f"m/s with --guide (default {FAST})")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="where logs are kept; else thrown away")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
