"""Runs `anytraverse roi-exchange`: each of several vehicles with the region of interest of each.

A region that is too short calls too late: nearer than the vehicle still needs to stop when the call opens,
`ExchangeVehicle.still_needs`. One that is too long or too wide calls for what stands beside the way.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2

from anytraverse.drawing import write_png
from anytraverse.evaluation.progress import Progress
from anytraverse.perception import make_perceiver
from anytraverse.perception.runtime import Runtime
from companion.desk.exchange.drawn import plot, views
from companion.desk.exchange.drive import RegionTally, drive
from companion.desk.exchange.results import Pair, table, vehicle_told
from companion.desk.exchange.truth import TruePerceiver
from companion.desk.exchange.vehicles import ExchangeVehicle, VehicleError, read_vehicle, shipped_vehicles
from companion.sim.field.lens import FIELD_OF_VIEW
from companion.vision.warm_up import judging_settings

_TRUTH = "truth"
_JPEG = 80


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.description = (
        "Drive each vehicle past a drum, a rock and a log on a simulated trail, with the region of interest "
        "of each: where its call opens, how often that is too late to stop, and how often it calls for what "
        "stands beside its way. A region is in metres and follows from what stopping needs. The last line is "
        "JSON."
    )
    parser.add_argument(
        "--vehicle",
        action="append",
        type=Path,
        metavar="FILE",
        help="a vehicle's file with [mount] and [stopping], once for each; by default the quadruped, the "
        "small rover and the ATV that ship",
    )
    parser.add_argument(
        "--perceiver",
        default=_TRUTH,
        metavar="NAME",
        help="truth: the simulation's own labels, or a perceiver, such as builtin; by default %(default)s",
    )
    parser.add_argument(
        "--seeds", type=int, nargs="+", default=[0, 1, 2], metavar="N", help="trails, by default 0 1 2"
    )
    parser.add_argument(
        "--metres", type=float, default=math.inf, metavar="M", help="of each trail, by default a whole lap"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="write table.json, plot.png and views.jpg")
    parser.add_argument("--json", action="store_true", help="print nothing but the last line, the JSON")


def run(options: argparse.Namespace) -> int:
    """Drive, write the files, print the table and the JSON. Returns 0."""
    vehicles = _vehicles(options.vehicle)
    if not options.metres >= 1.0 or min(options.seeds) < 0:
        raise VehicleError("give --metres of 1 or more, and --seeds of 0 or more")
    cv2.setNumThreads(1)
    pairs = exchange(vehicles, options.perceiver, options.seeds, options.metres)
    figures: dict[str, Any] = {
        "perceiver": options.perceiver,
        "seeds": options.seeds,
        "view": round(math.degrees(FIELD_OF_VIEW), 1),
        "vehicles": [vehicle_told(one) for one in vehicles],
        "pairs": [one.told() for one in pairs],
    }
    if options.out is not None:
        _write(options.out, figures, pairs)
    if not options.json:
        print(table(vehicles, pairs))
        if options.out is not None:
            print(f"  written to {options.out}: table.json, plot.png, views.jpg")
    print(json.dumps(figures, allow_nan=False))
    return 0


def exchange(
    vehicles: Sequence[ExchangeVehicle], perceiver: str, seeds: Sequence[int], metres: float = math.inf
) -> list[Pair]:
    """Drive each vehicle with the region of each over the trails. Shows the progress on stderr.

    Raises SettingsError where a region has no ground in a vehicle's camera, PerceiverError.
    """
    made = TruePerceiver() if perceiver == _TRUTH else make_perceiver(perceiver, Runtime(threads=1))
    pairs = list[Pair]()
    with Progress(len(vehicles) * len(seeds), "drives") as progress:
        for vehicle in vehicles:
            regions = [vehicle.looking_at(other.region) for other in vehicles]
            judging = judging_settings(vehicle.config, made)
            settings = [
                replace(judging, ground=one, region=one.in_picture(None).region.bounds) for one in regions
            ]
            tallies = [RegionTally() for _ in regions]
            for seed in seeds:
                for tally, found in zip(tallies, drive(vehicle, settings, made, seed, metres), strict=True):
                    tally.add(found)
                progress.step()
            pairs += [
                Pair(vehicle, other.name, one.near, one.far, tally)
                for other, one, tally in zip(vehicles, regions, tallies, strict=True)
            ]
    return pairs


def _vehicles(paths: Sequence[Path] | None) -> list[ExchangeVehicle]:
    found = [read_vehicle(path) for path in paths] if paths else shipped_vehicles()
    names = [one.name for one in found]
    if len(set(names)) < max(2, len(names)):
        raise VehicleError("give the files of two vehicles or more, each with another name")
    return found


def _write(folder: Path, figures: dict[str, Any], pairs: Sequence[Pair]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "table.json").write_text(
        json.dumps(figures, indent=1, allow_nan=False) + "\n", encoding="utf-8"
    )
    write_png(str(folder / "plot.png"), plot(pairs))
    shown = cv2.cvtColor(views(pairs), cv2.COLOR_RGB2BGR)
    done, data = cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, _JPEG])
    if not done:
        raise OSError("the picture cannot be encoded as JPEG")
    (folder / "views.jpg").write_bytes(data.tobytes())
