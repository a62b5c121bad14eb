"""Runs the simulated field as a process of its own: `python -m companion.sim.field`."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

from companion.sim.field.server import AUTOPILOTS, FieldOptions, FieldServer
from companion.sim.field.trail import LOOP

Number = TypeVar("Number", int, float)


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the addresses as one line of JSON, then serves until it is stopped.

    The control channel, SIGTERM, SIGINT or --duration end it. Exit code: 0, or 2 without its port.
    """
    args = _parser().parse_args(arguments)
    import cv2

    from companion.sim.field.render import PinholeCamera
    from companion.sim.field.things import World, lying_across

    cv2.setNumThreads(1)
    world = World(args.seed, course=replace(LOOP, half=args.half_width))
    if args.across is not None:
        world.add(lying_across(world.trail, world.trail.start + args.across))
    camera = PinholeCamera(world, width=args.width, height=args.height, seed=args.seed, k1=args.distortion)
    options = FieldOptions(
        args.seed,
        args.fps,
        args.speed,
        args.autostart,
        args.duration,
        args.script,
        args.autopilot,
        args.mission,
        args.swing,
        args.bumps,
        args.slopes,
        args.distortion,
        args.port,
    )
    try:
        server = FieldServer(world, camera, options)
    except OSError as error:  # another field has the port
        print(f"port {args.port} or the two after it: {error.strerror}: give another --port", file=sys.stderr)
        return 2
    if server.no_script:
        print(f"the script on the autopilot is not running: {server.no_script}", file=sys.stderr)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: server.stop())
    _announce(json.dumps(server.addresses()))
    server.run()
    return 0


def _announce(line: str) -> None:
    """Prints the line. A closed stdout does not end the process: later output then goes to /dev/null."""
    try:
        print(line, flush=True)
    except (OSError, ValueError, AttributeError):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m companion.sim.field", description=__doc__)
    parser.add_argument("--seed", type=_between(int, 0, 2**31), default=1, help="which world (default 1)")
    parser.add_argument(
        "--fps", type=_between(float, 0.2, 60), default=12.0, help="frames per second (default 12)"
    )
    parser.add_argument(
        "--speed", type=_between(float, 0, 5), default=2.5, help="cruise speed, m/s (default 2.5)"
    )
    parser.add_argument("--width", type=_between(int, 64, 1920), default=320, help="pixels (default 320)")
    parser.add_argument("--height", type=_between(int, 48, 1080), default=240, help="pixels (default 240)")
    parser.add_argument(
        "--autopilot", choices=list(AUTOPILOTS), default="ardupilot", help="whose rover (default ardupilot)"
    )
    parser.add_argument(
        "--mission",
        type=_between(float, 1, 1e6),
        help="m of the trail after which the mission is complete (default: it goes round)",
    )
    parser.add_argument(
        "--swing",
        type=_between(float, 0, 10),
        default=0.0,
        help="degrees by which the rover swings while it drives: pitch at 0.7 Hz, roll less (default 0)",
    )
    parser.add_argument(
        "--bumps",
        type=_between(float, 0, 10),
        default=0.0,
        help="degrees of a jolt that the trail gives about every 6 m (default 0)",
    )
    parser.add_argument(
        "--slopes",
        type=_between(float, 0, 12),
        default=0.0,
        help="degrees of the trail's steepest climb and fall (default 0)",
    )
    parser.add_argument(
        "--distortion",
        type=_between(float, -0.4, 0.2),
        default=0.0,
        help="k1 of the lens as in OpenCV, below 0 a barrel; below -0.15 corners see nothing (default 0)",
    )
    parser.add_argument(
        "--half-width",
        type=_between(float, 1, 4),
        default=LOOP.half,
        help=f"half the path's width, m; a wider path leaves room beside things (default {LOOP.half:g})",
    )
    parser.add_argument(
        "--across", type=_between(float, 5, 100), help="lay a log across the path so many m from the start"
    )
    parser.add_argument(
        "--port",
        type=_between(int, 1024, 65533),
        default=0,
        help="of the companion's link; the ground's and the frames' are the next two (default: free ones)",
    )
    parser.add_argument("--autostart", action="store_true", help="arm and drive the trail at once")
    parser.add_argument("--duration", type=_between(float, 0.1, 1e6), help="end after so many seconds")
    parser.add_argument(
        "--no-script",
        dest="script",
        action="store_false",
        help="do not run config/ardupilot/anytraverse.lua on the autopilot",
    )
    return parser


def _between(kind: Callable[[str], Number], low: float, high: float) -> Callable[[str], Number]:
    def number(text: str) -> Number:
        value = kind(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text} is not between {low:g} and {high:g}")
        return value

    return number


if __name__ == "__main__":
    sys.exit(main())
