"""Runs the benchmarks, all or those that are named, each in a process of its own, one after the other.

Each leaves NAME.json in the folder of the results, in one form: command, commit, time, machine, figures with
units and spread, and whether it ran, was skipped or failed, and why. Of all results in the folder it makes
one page, index.html. The exit code is 1 if one failed, or became worse than in --against by more than the
spread of both and 15 %. Run: make bench, or python -m bench [growth link] [--quick] [--against FOLDER]
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Mapping
from pathlib import Path

from bench.benches import BENCHES, Bench, chosen
from bench.comparing import WORSE, Change, changes, other_machine
from bench.page import page
from bench.result import FAILED, BenchResult, read_results, write_result
from bench.running import run

OUT = Path("bench-out") / "results"


def main(arguments: list[str] | None = None) -> int:
    """Runs them; returns the exit code."""
    given = _arguments(arguments)
    if given.list:
        _list(given.names)
        return 0
    given.out.mkdir(parents=True, exist_ok=True)
    earlier = read_results(given.against) if given.against is not None else {}
    ran, changed = list[BenchResult](), list[Change]()
    for name, bench in given.names.items():
        _say(f"{name}: about {_minutes(bench.minutes[given.quick] * given.rounds)}")
        result = run(name, bench, given.out, quick=given.quick, rounds=given.rounds)
        write_result(given.out, result)
        ran.append(result)
        _say(f"{name}: {result.state} in {result.seconds:.0f} s{': ' * bool(result.why)}{result.why}")
        changed = _write_page(given.out, str(given.against or ""), earlier)
    worse = [one for one in changed if one.verdict == WORSE and one.name in given.names]
    for one in worse:
        _say(f"worse: {one.name}: {one.what}: {one.before.value:g}, now {one.now.value:g} {one.now.unit}")
    _say(f"the page: {given.out / 'index.html'}")
    return 1 if worse or any(one.state == FAILED for one in ran) else 0


def _write_page(out: Path, against: str, earlier: Mapping[str, BenchResult]) -> list[Change]:
    """Makes the page of all results in the folder, and returns what changed since the earlier ones."""
    found = read_results(out)
    results = {name: found[name] for name in BENCHES if name in found}
    changed = list(changes(results, earlier))
    text = page(results, changed, against, other_machine(results, earlier))
    (out / "index.html").write_text(text, encoding="utf-8")
    return changed


def _list(benches: dict[str, Bench]) -> None:
    print(f"{'name':16} {'all of it':>9} {'--quick':>8}  what it measures")
    for name, bench in benches.items():
        quick = _minutes(bench.minutes[True]) if bench.quick is not None else "-"
        missing = bench.needs()
        print(f"{name:16} {_minutes(bench.minutes[False]):>9} {quick:>8}  {bench.measures}")
        if missing:
            print(f"{'':36} not here: {missing}")


def _minutes(minutes: float) -> str:
    if minutes < 1:
        return f"{60 * minutes:.0f} s"
    return f"{minutes:.0f} min" if minutes < 120 else f"{minutes / 60:.0f} h"


def _say(text: str) -> None:
    print(text, flush=True)


def _arguments(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="growth means all of growth-...; else all")
    parser.add_argument("--quick", action="store_true", help="the quick form of those that have one: minutes")
    parser.add_argument("--list", action="store_true", help="say what each measures and how long it takes")
    parser.add_argument(
        "--rounds", type=int, default=1, help="runs of each, whose spread is told (default 1)"
    )
    parser.add_argument("--out", type=Path, default=OUT, metavar="FOLDER", help="default %(default)s")
    parser.add_argument("--against", type=Path, metavar="FOLDER", help="earlier results to compare with")
    given = parser.parse_args(arguments)
    try:
        given.names = chosen(given.names)
    except ValueError as error:
        parser.error(str(error))
    if given.rounds < 1:
        parser.error("give at least one round")
    if given.against is not None and not read_results(given.against):
        parser.error(f"{given.against} has no results: give the --out folder of an earlier run")
    given.out = given.out.resolve()
    return given


def _end(number: int, _frame: object) -> None:
    raise SystemExit(128 + number)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, _end)  # so that the benchmark that runs is ended, too
    sys.exit(main())
