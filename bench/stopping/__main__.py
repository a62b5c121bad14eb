"""Faults on purpose, `--runs` of each kind by seed."""

from __future__ import annotations

import argparse
import tempfile
import threading
from pathlib import Path
from random import Random

from bench.stopping.stage import Plan, Stage


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=50)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="ats-") as folder:
        for seed in range(given.runs):
            random = Random(seed)
            plan = Plan(seed, random.uniform(0, 124), random.uniform(1.0, 2.5))
            with Stage(Path(folder) / str(seed), plan, threading.Event()) as stage:
                stage.wait_until_well()
                stage.drive(random.uniform(0, 1.5))
                print(stage.measure(stage.daemon.process.kill), flush=True)


if __name__ == "__main__":
    main()
