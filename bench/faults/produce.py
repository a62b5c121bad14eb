"""Produces one row in a process of its own: `python -m bench.faults.produce FAULT FOLDER SEED SHORT RUNS`.

Some rows patch the clock or the limits of their process, so no two may share one.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

from bench.faults.row import Row, RowOutcome, Work
from bench.faults.table import ROWS

_RESULT = "outcome.json"
_LOG = "row.log"
_LONGEST, _LONGEST_RUN = 2700.0, 150.0
_LOOK = 0.1


def produce(row: Row, work: Work, cancelled: threading.Event) -> RowOutcome:
    """Runs `main` for a row in a process group of its own. A row that raises or never ends is wrong."""
    work.folder.mkdir(parents=True)
    command = [sys.executable, "-m", "bench.faults.produce", row.fault, str(work.folder), str(work.seed)]
    with (work.folder / _LOG).open("wb") as log:
        process = subprocess.Popen(
            [*command, str(int(work.short)), str(work.runs or 0)],
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
        longest = max(_LONGEST, _LONGEST_RUN * (work.runs or 0))
        until = time.monotonic() + longest
        while process.poll() is None and time.monotonic() < until and not cancelled.is_set():
            time.sleep(_LOOK)
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            return RowOutcome(0, (f"did not end within {longest:g} s",))
    if process.returncode:
        lines = (work.folder / _LOG).read_text(encoding="utf-8", errors="replace").split("\n")
        return RowOutcome(
            0, (next((line for line in reversed(lines) if line), f"ended with {process.returncode}"),)
        )
    runs, wrong, *rest = json.loads((work.folder / _RESULT).read_text(encoding="utf-8"))
    return RowOutcome(runs, tuple(wrong), *rest)


def main(fault: str, folder: str, seed: str, short: str, runs: str) -> None:
    """Produces the row and writes its outcome into the folder."""
    (row,) = (row for row in ROWS if row.fault == fault)
    own = Path(folder) / "run"
    own.mkdir()
    found = row.produce(Work(own, int(seed), bool(int(short)), int(runs) or None))
    (Path(folder) / _RESULT).write_text(json.dumps(found), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
