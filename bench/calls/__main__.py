"""Counts the calls of whole drives in virtual time, and how many of them ask again what was answered.

The chain is the rover's own: the shipped network and thresholds, the rules of calls, answers applied at once.
Three operators: `go` says go, `word` names what is asked by its true word, `tap` taps it; neither of the two
says go about a thing that is not drivable. Parts:
trail: a lap of the simulated trail for each seed. Seeds 8 to 15, on which nothing is tuned, stand beside as
trail_untuned. A repeat is a call about a thing or a patch of ground that was answered less than 25 m before,
or about a kind of ground that was answered less than 100 m before.
real: labelled frames of one vehicle in their order, twice; and foreign_known: the share of frames of other
regions that are taken for a known scene after the first pass.
noticed: the share of things pasted into clean frames that are noticed, fresh and after taps and answers.
beside: a second thing put beside one that was answered.
route: ten simulated kilometres, twice, and once after a rehearsal of the first lap at the desk.
Prints a line for each finished job; the last line is one JSON object.
Run: make bench-calls, or python -m bench.calls [trail real] [--quick] [--seeds 0-7] [--data FOLDER]
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from anytraverse.evaluation.spreading import spread
from bench.calls.jobs import PARTS, JobResult, jobs_of, told, work
from bench.perception.frames import DATA

PROCESSES = 2


def main(arguments: list[str] | None = None) -> int:
    """Do all parts, print the figures; returns 0."""
    given = _arguments(arguments)
    jobs, left_out = jobs_of(given.parts, given.seeds, given.data, quick=given.quick)
    for why in left_out.values():
        print(why, flush=True)
    done = spread(work, jobs, processes=PROCESSES, done=_say)
    line = json.dumps({**told(done, left_out), "quick": given.quick})
    if given.out is not None:
        given.out.write_text(line + "\n", encoding="utf-8")
    print(line)
    return 0


def _say(_number: int, done: JobResult) -> None:
    print(f"{done.job.title}: {done.seconds:g} s", flush=True)


def _arguments(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m bench.calls",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"{', '.join(PARTS)}; else all")
    parser.add_argument("--quick", action="store_true", help="three seeds, every second frame, 2 km")
    parser.add_argument("--seeds", type=_seeds, default=(), metavar="0-7", help="of the trail alone")
    parser.add_argument("--data", type=Path, default=DATA, metavar="FOLDER", help="default %(default)s")
    parser.add_argument("--out", type=Path, metavar="FILE", help="the last line is written there, too")
    given = parser.parse_args(arguments)
    unknown = [part for part in given.parts if part not in PARTS]
    if unknown:
        parser.error(f"no part is called {unknown[0]}: give {', '.join(PARTS)}")
    given.parts = given.parts or PARTS
    return given


def _seeds(text: str) -> tuple[int, ...]:
    found: list[int] = []
    try:
        for part in text.split(","):
            first, _, last = part.partition("-")
            found += range(int(first), int(last or first) + 1)
    except ValueError:
        raise argparse.ArgumentTypeError(f'"{text}" is no list of seeds: give 0-7, or 0,3,5') from None
    return tuple(found)


if __name__ == "__main__":
    sys.exit(main())
