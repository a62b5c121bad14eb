"""Produces every fault of the table for real, and says what followed: `python -m bench.faults`.

Prints a line a row as it ends; the last line is one JSON object, also when it is ended early. The exit code
is 1 if a row did not end in its safe state, or later than its limit. Run: make faults
"""

from __future__ import annotations

import argparse
import json
import shlex
import signal
import sys
import tempfile
import threading
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any

from bench.faults.produce import produce
from bench.faults.report import judged, keep, line, summed
from bench.faults.row import Row, Work
from bench.faults.table import ROWS, chosen


def main() -> int:
    given = _arguments()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _end)
    cancelled = threading.Event()
    done: list[dict[str, Any]] = []

    def one(number: int, row: Row) -> None:
        found = produce(row, Work(folder / str(number), given.seed, given.short, given.runs), cancelled)
        if not cancelled.is_set():
            done.append(judged(row, found, short=given.short))
            print(line(done[-1]), flush=True)

    with tempfile.TemporaryDirectory(prefix="faults-", ignore_cleanup_errors=True) as name:
        folder = given.logs or Path(name)
        pool = ThreadPoolExecutor(given.jobs)
        try:
            left = {pool.submit(one, number, row) for number, row in enumerate(given.only)}
            while left:
                ended, left = wait(left, timeout=1.0, return_when=FIRST_COMPLETED)
                for future in ended:
                    future.result()
        finally:
            cancelled.set()
            pool.shutdown(cancel_futures=True)
            order = [row.fault for row in ROWS]
            rows = sorted(done, key=lambda figures: order.index(figures["fault"]))
            if given.out is not None:
                keep(given.out, rows, shlex.join(["python", "-m", "bench.faults", *sys.argv[1:]]))
            print(json.dumps(summed(rows)), flush=True)
    return 1 if any("wrong" in figures for figures in rows) else 0


def _end(number: int, _frame: object) -> None:
    raise SystemExit(128 + number)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.faults", description=__doc__)
    parser.add_argument("--only", nargs="+", default=[], metavar="ROW", help="rows by a part of their names")
    parser.add_argument("--short", action="store_true", help="each fault once or a few times, without limits")
    parser.add_argument("--runs", type=int, help="of each fault that is repeated while a rover drives")
    parser.add_argument("--jobs", type=int, default=3, help="rows side by side (default 3)")
    parser.add_argument("--seed", type=int, default=1, help="of everything that is random (default 1)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="results; rows of earlier runs in it stay")
    parser.add_argument("--logs", type=Path, metavar="FOLDER", help="where logs are kept; else thrown away")
    given = parser.parse_args()
    if given.runs is not None and given.runs < 1:
        parser.error("--runs is at least 1")
    try:
        given.only = chosen(given.only)
    except ValueError as error:
        parser.error(str(error))
    return given


if __name__ == "__main__":
    sys.exit(main())
