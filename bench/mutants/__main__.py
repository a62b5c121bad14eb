"""Runs the tests against each mutant of the safety path; the last line is one JSON object.

The mutants are in mutants.json and were chosen once by seed; `--choose 200` chooses new ones, and
`--choose 60 --files companion/storage/writer.py` adds some of these files at the end. The tests must pass
without a fault first: the exit code is 2 if they do not. `--before` compares with an earlier result file: the
exit code is 1 if a mutant that was caught then is not caught now.
Run: python -m bench.mutants [--jobs 2] [--only 3 17] [--out results.json] [--before results.json]
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from bench.mutants.faults import ROOT, SAFETY_PATH, Mutant, chosen

CHOSEN = Path(__file__).with_name("mutants.json")
NO_TESTS = 5
"""pytest's exit code where it found none."""
LIMIT = 420.0
"""Seconds for the tests of one mutant: one that makes them hang is caught, too."""


def main() -> int:
    given = _arguments()
    mutants = [Mutant(**one) for one in json.loads(CHOSEN.read_text())]
    if given.choose:
        kept = mutants if given.files else []
        found = kept + chosen(given.choose, given.seed, given.files or SAFETY_PATH, kept)
        lines = ",\n".join(json.dumps(mutant.figures()) for mutant in found)
        CHOSEN.write_text(f"[\n{lines}\n]\n")
        print(f"{len(found)} mutants written to {CHOSEN}")
        return 0
    numbers = list(given.only or range(len(mutants)))
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        houses = [_house(Path(folder) / str(job)) for job in range(given.jobs)]
        with ThreadPoolExecutor(given.jobs) as pool:
            tests = sorted({SAFETY_PATH[mutants[number].file] for number in numbers})
            whole = [tests[job :: given.jobs] for job in range(given.jobs)]
            failing = [one for some in pool.map(_failing, whole, houses) for one in some]
            if failing:
                print("without a fault these tests fail, so they show nothing:", *failing, sep="\n")
                return 2
            shares = [numbers[job :: given.jobs] for job in range(given.jobs)]
            results = pool.map(lambda work: _try_all(mutants, *work), zip(shares, houses, strict=True))
            outcomes = {number: outcome for share in results for number, outcome in share.items()}
    told = figures(outcomes)
    if given.out:
        given.out.write_text(json.dumps(told, indent=1) + "\n")
    print(json.dumps(told))
    return _lost(outcomes, given.before)


def figures(outcomes: Mapping[int, str]) -> dict[str, Any]:
    """As JSON values. One whose code is gone was not tried, so that nothing caught it."""
    caught = sum(outcome in ("caught", "hung") for outcome in outcomes.values())
    return {"mutants": len(outcomes), "caught": caught, "outcomes": dict(sorted(outcomes.items()))}


def _lost(outcomes: Mapping[int, str], before: Path | None) -> int:
    """1 where a mutant survives that was caught before."""
    known = json.loads(before.read_text())["outcomes"] if before else {}
    lost = [n for n, one in outcomes.items() if one == "survived" and known.get(str(n), one) != "survived"]
    for number in lost:
        print(f"mutant {number} was caught before", file=sys.stderr)
    return 1 if lost else 0


def _house(folder: Path) -> Path:
    """A copy of the project, for one mutant at a time."""
    return shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(".*", "__pycache__"))


def _failing(tests: Sequence[Sequence[str]], house: Path) -> list[Sequence[str]]:
    """Returns those of the tests that do not pass in a house without a fault."""
    return [some for some in tests if _outcome(some, house) != "survived"]


def _try_all(mutants: Sequence[Mutant], numbers: Sequence[int], house: Path) -> dict[int, str]:
    outcomes = {}
    for number in numbers:
        begun = time.monotonic()
        outcomes[number] = _try(mutants[number], house)
        one = mutants[number]
        took = time.monotonic() - begun
        print(
            f"{number:3} {outcomes[number]:9} {took:4.0f} s  {one.file} {one.function}: {one.line}",
            flush=True,
        )
    return outcomes


def _try(mutant: Mutant, house: Path) -> str:
    """caught, hung or survived; "gone" where the code is not there any more."""
    path = house / mutant.file
    whole = path.read_text()
    try:
        path.write_text(mutant.source())
        return _outcome(SAFETY_PATH[mutant.file], house)
    except LookupError as error:
        return f"gone: {error}"
    finally:
        path.write_text(whole)


def _outcome(tests: Sequence[str], house: Path) -> str:
    """The slow tests run where the fast ones notice nothing."""
    options = ["-x", "-q", "-n0", "-p", "no:cacheprovider", "-m"]
    for tier in ("not slow", "slow"):
        try:
            done = subprocess.run(
                [sys.executable, "-m", "pytest", *options, tier, *tests],
                cwd=house,
                env={**os.environ, "PYTHONPATH": str(house), "PYTHONDONTWRITEBYTECODE": "1"},
                capture_output=True,
                timeout=LIMIT,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return "hung"
        if done.returncode not in (0, NO_TESTS):
            return "caught"
    return "survived"


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.mutants", description=__doc__)
    parser.add_argument("--choose", type=int, metavar="COUNT", help="choose so many anew, and end")
    parser.add_argument(
        "--files",
        nargs="+",
        metavar="FILE",
        choices=SAFETY_PATH,
        help="with --choose: add some of these alone",
    )
    parser.add_argument("--seed", type=int, default=1, help="of the choice (default 1)")
    parser.add_argument("--jobs", type=int, default=2, help="side by side (default 2)")
    parser.add_argument("--only", type=int, nargs="+", metavar="NUMBER", help="these alone")
    parser.add_argument("--out", type=Path, metavar="FILE", help="where the result goes, too")
    parser.add_argument("--before", type=Path, metavar="FILE", help="an earlier result to compare with")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
