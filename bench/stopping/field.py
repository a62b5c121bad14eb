"""Runs the field as a process, with the rover anywhere on the trail: `python -m bench.stopping.field`."""

from __future__ import annotations

import argparse
import json
import signal
from dataclasses import replace

import cv2

from companion.sim.demo.pace import SPEED
from companion.sim.field.render import PinholeCamera
from companion.sim.field.server import AUTOPILOTS, FieldOptions, FieldServer
from companion.sim.field.things import DEFAULT_SURPRISES, World
from companion.sim.field.trail import LOOP

FPS = 12.0
SIZE = 320, 240


def main() -> None:
    """Prints the addresses as one line of JSON, then serves until SIGTERM or SIGINT."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--at", type=float, default=0.0, help="m along the trail")
    parser.add_argument("--speed", type=float, default=SPEED, help="m/s")
    parser.add_argument("--surprises", action="store_true", help="a drum, a rock and a log on the way")
    parser.add_argument("--half-width", type=float, default=LOOP.half, help="half the path's width, m")
    parser.add_argument("--autopilot", choices=list(AUTOPILOTS), default="ardupilot")
    parser.add_argument("--mission", type=float, help="m of the trail after which it is complete")
    parser.add_argument("--no-script", dest="script", action="store_false")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    course = replace(LOOP, half=given.half_width)
    world = World(given.seed, DEFAULT_SURPRISES if given.surprises else (), course=course)
    world.trail.start = given.at
    camera = PinholeCamera(world, *SIZE, seed=given.seed)
    options = FieldOptions(
        seed=given.seed,
        fps=FPS,
        speed=given.speed,
        script=given.script,
        autopilot=given.autopilot,
        mission=given.mission,
    )
    server = FieldServer(world, camera, options)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: server.stop())
    print(json.dumps(server.addresses()), flush=True)
    server.run()


if __name__ == "__main__":
    main()
