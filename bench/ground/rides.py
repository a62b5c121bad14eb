"""Measures how well a frame's ground is known in metres, while the simulated rover swings, jolts and climbs.

A point of the ground ahead appears in a row of the built-in perceiver's map, 64 x 48. From the middle of
that row its distance is calculated back: without ATTITUDE, with ATTITUDE four times a second as the companion
uses it, and with the true lean. The error is that of the distance.
Last, what the region in metres costs.
"""

from __future__ import annotations

import json
import math
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.assessment import Maps
from anytraverse.findings import roi_figures
from anytraverse.ground import GroundCamera, GroundRegion
from anytraverse.judging import Settings
from companion.cameras.calibration import LensCalibration, read_calibration
from companion.sim.field.lens import FIELD_OF_VIEW, HEIGHT, PITCH, focal_length
from companion.sim.field.motion import RoverMotion
from companion.sim.field.things import World
from companion.sim.field.trail import TrailPose
from companion.sim.field.view import View
from companion.vehicle.motion import LeanFilter, MotionReport, lean_at

Floats = NDArray[np.float64]

RANGES = (3.0, 4.0, 5.0, 6.0)
"""m ahead of the lens."""
ASIDE = (-0.5, 0.0, 0.5)
SPEED, FPS, ATTITUDES = 1.5, 10.0, 4.0
"""m/s; frames/s; reports of ATTITUDE a second."""
JUDGED = 0.05
"""s from a frame's capture until it is judged: later reports are not known then."""
WIRE = 0.02
"""s, at most, from a report to its receipt."""
MAP = 48
"""Rows of the perceiver's map."""
WIDTH, PIXELS = 640, 480
GOALS = {"4": 0.3, "5": 0.5}
"""m: 90 % of the errors with a swing of 2 degrees."""


@dataclass(frozen=True)
class Ride:
    """How the rover moves: degrees. distortion: k1 of the lens. rectified: whether it is calibrated away."""

    name: str
    swing: float = 0.0
    bumps: float = 0.0
    slopes: float = 0.0
    distortion: float = 0.0
    rectified: bool = True


RIDES = (
    Ride("level"),
    Ride("swing 2", swing=2.0),
    Ride("swing 4", swing=4.0),
    Ride("bumps 3", bumps=3.0),
    Ride("slopes 6", slopes=6.0),
    Ride("swing 2, bumps 3, slopes 6", swing=2.0, bumps=3.0, slopes=6.0),
    Ride("distortion -0.1, not calibrated", distortion=-0.1, rectified=False),
    Ride("swing 2, distortion -0.1, calibrated", swing=2.0, distortion=-0.1),
)


def errors_of(ride: Ride, seed: int, seconds: float) -> dict[str, dict[float, list[float]]]:
    """Return the errors in m of a ride: of no, of the reported and of the true lean, by range."""
    world, rng = World(seed, []), np.random.default_rng([seed, 7])
    motion = RoverMotion(
        world.trail,
        seed,
        swing=math.radians(ride.swing),
        bumps=math.radians(ride.bumps),
        slopes=math.radians(ride.slopes),
    )
    calibration = _calibration(ride.distortion)
    found: dict[str, dict[float, list[float]]] = {
        name: {distance: [] for distance in RANGES} for name in ("none", "reported", "true")
    }
    leant = list(reports(motion, seconds, rng))
    points = np.array([(distance, aside) for distance in RANGES for aside in ASIDE])
    for number in range(round((seconds - 10.0) * FPS)):
        at = 10.0 + number / FPS + rng.uniform(0.0, 1.0 / FPS)
        tilt = motion.at(at, SPEED * at, SPEED).tilt
        places, camera = _seen(View(WIDTH, PIXELS, tilt, ride.distortion), points, calibration, ride)
        rows = (np.floor(places[:, 1] * MAP) + 0.5) / MAP
        known = [one for one in leant if one.at <= at + JUDGED]
        leans = {
            "none": (0.0, 0.0),
            "reported": lean_at(known[-8:], at) or (0.0, 0.0),
            "true": (math.degrees(tilt.pitch), math.degrees(tilt.roll)),
        }
        for name, lean in leans.items():
            told = camera.leaning(*lean).to_ground(np.column_stack([places[:, 0], rows]))
            for (distance, _), ahead, (x, y) in zip(points, told[:, 0], places, strict=True):
                if 0.0 <= x < 1.0 and 0.0 <= y < 1.0:
                    found[name][float(distance)].append(abs(float(ahead) - float(distance)))
    return found


def reports(motion: RoverMotion, seconds: float, rng: np.random.Generator) -> Iterator[MotionReport]:
    """Yield what the companion makes of ATTITUDE; the receipt is up to `WIRE` late."""
    filtered = LeanFilter()
    for number in range(round((seconds + 1.0) * ATTITUDES)):
        at = number / ATTITUDES
        one = motion.at(at, SPEED * at, SPEED)
        angles = math.degrees(one.pitch), math.degrees(one.roll)
        rates = math.degrees(one.pitch_rate), math.degrees(one.roll_rate)
        yield filtered.take(at + rng.uniform(0.0, WIRE), angles, rates)


def _calibration(k1: float) -> LensCalibration:
    """Return the calibration of a lens, as the companion reads it from a file."""
    focal = focal_length(WIDTH)
    told = {
        "image_width": WIDTH,
        "image_height": PIXELS,
        "camera_matrix": _matrix_document(
            [focal, 0, WIDTH / 2 - 0.5, 0, focal, PIXELS / 2 - 0.5, 0, 0, 1], 3
        ),
        "distortion_coefficients": _matrix_document([k1, 0, 0, 0], 1),
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "calibration.json")
        path.write_text(json.dumps(told))
        return read_calibration(path)


def _matrix_document(numbers: list[float], rows: int) -> dict[str, Any]:
    form = {"type_id": "opencv-matrix", "rows": rows, "cols": len(numbers) // rows, "dt": "d"}
    return {**form, "data": numbers}


def _seen(
    view: View, points: Floats, calibration: LensCalibration, ride: Ride
) -> tuple[Floats, GroundCamera]:
    """Return where ground points appear, in fractions of the picture, and the camera as it is configured."""
    pixels = np.array([view.project(TrailPose(0.0, 0.0, 0.0), x, y)[:2] for x, y in points])
    places: Floats = pixels / (WIDTH, PIXELS)
    degrees = math.degrees(FIELD_OF_VIEW)
    if ride.distortion and ride.rectified:
        fx, fy, cx, cy = calibration.rectified
        distortion = np.array(calibration.distortion)
        rays = cv2.undistortPoints((pixels - 0.5)[:, np.newaxis], _matrix(calibration), distortion)[:, 0]
        places = np.asarray(rays * (fx, fy) + (cx, cy), np.float64)
        degrees = calibration.view
    return places, GroundCamera.pinhole(HEIGHT, math.degrees(PITCH), degrees, WIDTH / PIXELS)


def _matrix(calibration: LensCalibration) -> Floats:
    fx, fy, cx, cy = calibration.lens
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def cost(frames: int) -> dict[str, float]:
    """Return ms of CPU that the figures of a frame take, in fractions and in metres with a new lean each."""
    camera = GroundCamera.pinhole(HEIGHT, 7.0, 75.0, 4 / 3, 0.3)
    ground = GroundRegion(camera, camera.nearest(1.2), 5.0, 1.2, 0.6)
    rng, words = np.random.default_rng(0), 6
    attention = rng.random((words, MAP, 64)).astype(np.float32)
    uncertainty = 1.0 - attention.max(axis=0)
    drivable = rng.random((MAP, 64)) < 0.9
    signed = (1.0 - uncertainty).astype(np.float32)
    named = np.arange(words) > 2
    maps = Maps(attention, signed, uncertainty, uncertainty, drivable, named, np.ones_like(drivable))
    told: dict[str, float] = {}
    for name, settings in (
        ("fractions", Settings()),
        ("metres", Settings(ground=ground, region=ground.in_picture(None).region.bounds)),
    ):
        spent = []
        for _ in range(frames):
            lean = (float(rng.normal(0.0, 2.0)), float(rng.normal(0.0, 1.0)))
            begun = time.process_time()
            roi_figures(maps, 4 / 3, settings.at(lean))
            spent.append(1e3 * (time.process_time() - begun))
        told |= {f"ms_{name}_{share}": round(float(np.percentile(spent, share)), 2) for share in (50, 95)}
    return told


def errors_by_ride(
    rides: Sequence[Ride], seeds: Sequence[int], seconds: float
) -> dict[str, dict[str, dict[str, float]]]:
    """Return 90 % of the errors in m of the worst seed, by ride, lean and range, and print them."""
    told: dict[str, dict[str, dict[str, float]]] = {}
    print(
        "90 % of the errors in m, without ATTITUDE / as reported / with the true lean, and all seeds' worst"
    )
    for ride in rides:
        by_seed = [errors_of(ride, seed, seconds) for seed in seeds]
        told[ride.name] = {
            name: {
                f"{distance:g}": round(
                    float(np.max([np.percentile(one[name][distance], 90) for one in by_seed])), 3
                )
                for distance in RANGES
            }
            for name in by_seed[0]
        }
        row = [
            f"{distance:g} m "
            + " / ".join(f"{told[ride.name][name][f'{distance:g}']:.2f}" for name in by_seed[0])
            for distance in RANGES
        ]
        print(f"{ride.name:38} {'   '.join(row)}", flush=True)
    return told
