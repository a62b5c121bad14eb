"""Compares this project's CLIPSeg step with the authors' 2.0.0: CPU time, memory, parts, agreement.

It makes checkpoints with random weights and the true architectures, exports bundles, and runs all contestants
in turn, each in a process of its own. It writes clipseg.md and clipseg.png; the last line of the output is
one JSON object. Run: make bench-clipseg, or python -m bench.clipseg [--quick] [--tiny] [--out FOLDER]
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

from bench.clipseg.contestants import Plan
from bench.clipseg.frames import COUNTS, SIZES
from bench.clipseg.measuring import measure
from bench.clipseg.results import OURS, REFERENCE, Results, figures

PREPARING = 900.0
"""Deadline in seconds for making checkpoints, or one bundle."""


def main() -> None:
    given = _arguments()
    if given.threads < 1 or given.rounds < 1:
        sys.exit("give at least one thread and one round")
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = str(given.threads)
    models = given.out / ("tiny" if given.tiny else "models")
    _prepare("bench.clipseg.checkpoints", str(models), *(["--tiny"] if given.tiny else []))
    plans = _plans(models, given.threads)
    cases = [(size, count) for size in SIZES[: 1 if given.quick else 2] for count in COUNTS]
    samples, failed = measure(plans, cases, 3 if given.quick else given.rounds, _say)
    _publish(Results(samples, failed), models, given.out, given.threads)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="bench.clipseg", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("bench-out"), help="folder; default bench-out")
    parser.add_argument("--rounds", type=int, default=9, help="measured steps of each case; default 9")
    parser.add_argument("--threads", type=int, default=1, help="of each contestant; default 1")
    parser.add_argument("--quick", action="store_true", help="640x480 alone, 3 rounds")
    parser.add_argument("--tiny", action="store_true", help="tiny networks: tries the benchmark itself")
    return parser.parse_args()


def _plans(models: Path, threads: int) -> list[Plan]:
    """Makes new bundles and returns the plans of the contestants, the reference first."""
    clipseg, clip = str(models / "clipseg"), str(models / "clip")
    options = {"checkpoint": clipseg, "clip": clip, "threads": threads}
    plans = [Plan(REFERENCE, "bench.clipseg.reference:make", options)]
    for scene in ("shared", "clip-b32"):
        bundle = models / f"bundle-{scene}"
        shutil.rmtree(bundle, ignore_errors=True)
        _prepare("bench.clipseg.ours", clipseg, clip, str(bundle), scene, "fp32", "int8")
        for name in OURS:
            if name.endswith("clip_b32") == (scene == "clip-b32"):
                precision = name.partition("_")[0]
                made = {"bundle": str(bundle), "precision": precision, "threads": threads}
                plans.append(Plan(name, "bench.clipseg.ours:Ours", made))
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


def _publish(results: Results, models: Path, out: Path, threads: int) -> None:
    from bench.clipseg.machine import describe_machine
    from bench.clipseg.plot import draw
    from bench.clipseg.report import SHOWN, count_work, write_report

    machine = {**describe_machine(), "threads": threads}
    text = write_report(results, machine, count_work(models / "clipseg", models / "clip", SHOWN[1]))
    (out / "clipseg.md").write_text(text + "\n\n![CPU time and memory](clipseg.png)\n")
    draw(results, out / "clipseg.png")
    print(text)
    print(f"\nin {out}: clipseg.md, clipseg.png\n")
    print(json.dumps(figures(results) | machine))


if __name__ == "__main__":
    main()
