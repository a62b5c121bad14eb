"""Measures how well the ground is known in metres: by a frame, and by the grid that remembers for seconds.

Run: python -m bench.ground [--seeds 0 1 2 3 4] [--seconds 120] [--metres 90] [--quick]. The last line is one
JSON object: range_error_90 of a frame (see rides.py), obstacle_recall and false_blocks of the grid with true
labels, a swing of 2 degrees and odometry that errs (see grid.py), ms of its update with the reads after it,
and stop_ratio (see stops.py).
"""

from __future__ import annotations

import argparse
import json

import cv2

from bench.ground import rides
from bench.ground.drives import PERCEIVERS
from bench.ground.grid import GOALS, HEADLINE, compare, grid_cost
from bench.ground.stops import STOP_GOAL, stop_ratios


def main() -> None:
    """Print a line for each ride and each drive, then all of it as one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2, 3, 4])
    parser.add_argument("--seconds", type=float, default=120.0, help="of each ride, by default %(default)s")
    parser.add_argument("--metres", type=float, default=90.0, help="of each drive, by default %(default)s")
    parser.add_argument("--quick", action="store_true", help="one seed, little of it, and true labels only")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    quick, seeds = options.quick, options.seeds
    if quick:
        seeds, options.seconds, options.metres = seeds[:1], 40.0, 16.0
    told = rides.errors_by_ride(rides.RIDES, seeds, options.seconds)
    reached = {key: told["swing 2"]["reported"][key] for key in rides.GOALS}
    ratios = stop_ratios()
    met = all(reached[key] <= goal for key, goal in rides.GOALS.items())
    grid = compare(
        seeds, options.metres, (2.0,) if quick else (0.0, 2.0), PERCEIVERS[:1] if quick else PERCEIVERS
    )
    best = {name: grid[HEADLINE]["grid"][name] for name in GOALS}
    print(
        json.dumps(
            {
                "range_error_90": reached,
                "goals_met": met and ratios["stop_ratio"] <= STOP_GOAL,
                **ratios,
                **best,
                "false_blocks_single": grid[HEADLINE]["single"]["false_blocks"],
                "obstacle_recall_single": grid[HEADLINE]["single"]["obstacle_recall"],
                "grid_goals_met": all(low <= best[name] <= high for name, (low, high) in GOALS.items()),
                **grid_cost(40 if quick else 300, beside=False),
                **({} if quick else grid_cost(100, beside=True)),
                "rides": told,
                "grid": grid,
                "seeds": len(seeds),
                **rides.cost(100 if quick else 500),
            }
        )
    )


if __name__ == "__main__":
    main()
