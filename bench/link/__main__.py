"""Tests the radio link. Prints a line for each run; the last line is one JSON object.

lossy: calls over a bad radio in virtual time; each must be answered exactly once.
udp: a tenth as many over real sockets, in real time, through a bad relay.
fuzz: mutated frames with right checksums; no exception may escape, strangers change nothing, memory stays
flat. flood: noise, answers and heartbeats from one id and from many, over real sockets, with signing and
without; heartbeats go on, the autopilot is heard, the operator is acknowledged, memory stays flat.
saturated: holds on a serial line that is full of our own frames; each must leave within 0.3 s. speed: frames
handled, CPU share at rest, and how soon a summary is on the wire; figures, no promise. Exit code 1: a
promise was broken. Run: make bench-link, or python -m bench.link fuzz --frames 1000000
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

TRACED = 100_000
"""Number of frames for which every allocated byte is counted at most, since that is slow."""
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
    from bench.link.lossy import LINK_CONDITIONS, run

    told, good = {}, True
    for name, weather in LINK_CONDITIONS.items():
        with tempfile.TemporaryDirectory(prefix="atl-") as folder:
            outcome = run(weather, given.calls, Path(folder), str(given.seed))
        told[name] = outcome.figures()
        good &= outcome.good and outcome.calls == given.calls
        print(f"{name:14} {outcome}", flush=True)
    return told, good


def _udp(given: argparse.Namespace) -> _Report:
    from bench.link.udp import WEATHER, run

    calls = max(1, given.calls // 10)
    with tempfile.TemporaryDirectory(prefix="atl-") as folder:
        outcome = run(WEATHER, calls, Path(folder), str(given.seed))
    print(f"{'udp':14} {outcome}", flush=True)
    return outcome.figures(), outcome.good and outcome.calls == calls


def _fuzz(given: argparse.Namespace) -> _Report:
    from bench.link.fuzz import Broken, Fuzz

    try:
        fuzzed = Fuzz(given.seed).run(given.frames)
        traced = Fuzz(given.seed + 1).run(min(given.frames, TRACED), traced=True)
    except Broken as broken:
        print(f"fuzz           {broken}", flush=True)
        return {"broken": str(broken)}, False
    print(
        f"fuzz           {fuzzed.frames} frames: {sum(fuzzed.requests.values())} requests let through",
        flush=True,
    )
    return {**fuzzed.figures(), "growth": traced.growth}, True


def _flood(given: argparse.Namespace) -> _Report:
    from bench.link.flood import figures, floods, good, run

    told, kept = {}, True
    for name in floods():
        for signed in (False, True):
            flooded = run(name, given.seconds, signed=signed)
            kind = f"{name} signed" if signed else name
            told[kind] = figures(flooded)
            kept &= good(flooded)
            print(f"flood {kind:18} {told[kind]}", flush=True)
    return told, kept


def _saturated(given: argparse.Namespace) -> _Report:
    from bench.link.saturated import MOST, run

    told = run(given.seconds, given.seed)
    print(f"saturated      {told}", flush=True)
    return told, bool(told["hold_s"]["max"] <= MOST)


def _speed(given: argparse.Namespace) -> _Report:
    from bench.link.speed import run

    with tempfile.TemporaryDirectory(prefix="atl-") as folder:
        told = run(given.seconds, Path(folder))
    print(f"speed          {told}", flush=True)
    return told, True


RUNS: dict[str, Callable[[argparse.Namespace], _Report]] = {
    "lossy": _lossy,
    "udp": _udp,
    "fuzz": _fuzz,
    "flood": _flood,
    "saturated": _saturated,
    "speed": _speed,
}


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.link", description=__doc__)
    parser.add_argument(
        "what", nargs="*", choices=[[], *RUNS], metavar="WHAT", help=f"{', '.join(RUNS)}; else all"
    )
    parser.add_argument("--calls", type=int, default=200, help="in each weather (default 200)")
    parser.add_argument("--frames", type=int, default=1_000_000, help="of the fuzz (default 1000000)")
    parser.add_argument("--seconds", type=float, default=20.0, help="for each flood or figure (default 20)")
    parser.add_argument("--seed", type=int, default=1, help="of radio and frames (default 1)")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
