"""Compares this project's step with the authors' 2.0.0: CPU time, memory, parts, agreement.

It makes checkpoints with random weights and the true architectures, exports bundles (CLIPSeg in three sizes,
SigLIP 2, TIPSv2), and runs all contestants in turn, each in a process of its own; together they take some
7 GB of memory, and the models 6 GB of disk. A full run writes bench/results/clipseg.md and .json; any run
writes them into the folder --out. The last line of the output is one JSON object.
Run: make bench-clipseg, or python -m bench.clipseg [--quick] [--tiny] [--out FOLDER]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from bench.clipseg.contestants import ContestantPlan
from bench.clipseg.frames import COUNTS, SIZES
from bench.clipseg.lineup import CONTESTANTS, OURS, REFERENCE, bundle_of
from bench.clipseg.measuring import measure
from bench.clipseg.results import Results, figures
from bench.machine import describe_run

PREPARING = 1800.0
"""Deadline in seconds for making the checkpoints, or the bundles."""
RESULTS = Path(__file__).resolve().parents[1] / "results"
ROUNDS = 9


def main() -> None:
    given = _arguments()
    if given.threads < 1 or given.rounds < 1:
        sys.exit("give at least one thread and one round")
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = str(given.threads)
    run = describe_run()
    models = given.out / ("tiny" if given.tiny else "models")
    for module in ("bench.clipseg.checkpoints", "bench.clipseg.bundles"):
        _prepare(module, str(models), *(["--tiny"] if given.tiny else []))
    plans = _plans(models, given.threads)
    cases = [(size, count) for size in SIZES[: 1 if given.quick else 2] for count in COUNTS]
    samples, failed = measure(plans, cases, 3 if given.quick else given.rounds, _say)
    _publish(Results(samples, failed), models, given, run)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="bench.clipseg", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("bench-out"), help="folder; default bench-out")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="measured steps of each case; default 9")
    parser.add_argument("--threads", type=int, default=1, help="of each contestant; default 1")
    parser.add_argument("--quick", action="store_true", help="640x480 alone, 3 rounds")
    parser.add_argument("--tiny", action="store_true", help="tiny networks: tries the benchmark itself")
    return parser.parse_args()


def _plans(models: Path, threads: int) -> list[ContestantPlan]:
    """Returns the plans of the contestants, the reference first."""
    options = {"checkpoint": str(models / "clipseg"), "clip": str(models / "clip"), "threads": threads}
    plans = [ContestantPlan(REFERENCE, "bench.clipseg.reference:make", options)]
    for name in OURS:
        entry = CONTESTANTS[name]
        bundle = str(bundle_of(models, entry.bundle))
        made = {"bundle": bundle, "precision": entry.precision, "threads": threads}
        plans.append(ContestantPlan(name, "bench.clipseg.ours:Ours", made))
    return plans


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _prepare(module: str, *arguments: str) -> None:
    """Runs in a process of its own: memory of this one would count as its children's peak memory."""
    _say(f"{module} {' '.join(arguments)}")
    command = [sys.executable, "-m", module, *arguments]
    done = subprocess.run(command, stdout=sys.stderr, timeout=PREPARING, check=False)
    if done.returncode != 0:
        sys.exit(f"{module} failed: what went wrong stands above")


def _publish(results: Results, models: Path, given: argparse.Namespace, run: dict[str, Any]) -> None:
    from bench.clipseg.report import SHOWN, count_work, write_report

    machine = {**run, "threads": given.threads}
    text = write_report(results, machine, count_work(models, SHOWN[1], given.tiny))
    line = figures(results) | machine
    places = [given.out]
    if not (given.quick or given.tiny) and (given.rounds, given.threads) == (ROUNDS, 1):
        places.append(RESULTS)
    for place in places:
        (place / "clipseg.md").write_text(f"{text}\n")
        (place / "clipseg.json").write_text(json.dumps(line, indent=1) + "\n")
    print(text)
    print(f"\nclipseg.md, clipseg.json in {' and '.join(map(str, places))}\n")
    print(json.dumps(line))


if __name__ == "__main__":
    main()
