"""Measures how long the simulated field's camera takes for a frame: `python -m bench.field_frames`.

The last line is one JSON object.
"""

from __future__ import annotations

import json
import time

import cv2
import numpy as np

from companion.sim.field.render import PinholeCamera
from companion.sim.field.things import World
from companion.sim.field.trail import ZONES


def main(seeds: tuple[int, ...] = (1, 2, 3), frames: int = 200) -> None:
    """Prints milliseconds of CPU time for a frame on one core, over laps of several worlds."""
    cv2.setNumThreads(1)
    found = {}
    for width, height in ((320, 240), (640, 480)):
        spent: dict[str, list[float]] = {zone: [] for zone in ZONES}
        for seed in seeds:
            world = World(seed)
            camera, trail = PinholeCamera(world, width, height), world.trail
            camera.render(trail.pose(0.0), 0.0)
            for s in np.linspace(0.0, trail.length, frames):
                begin = time.process_time()
                camera.render(trail.pose(s), float(s))
                spent[trail.zone(s)].append(1e3 * (time.process_time() - begin))
        every = np.concatenate([np.asarray(times) for times in spent.values()])
        zones = ", ".join(f"{zone} {np.mean(times):.1f}" for zone, times in spent.items())
        slow = float(np.percentile(every, 95))
        found[f"{width}x{height}"] = {"ms": round(float(every.mean()), 2), "ms_p95": round(slow, 2)}
        print(
            f"{width}x{height}: {every.mean():.1f} ms a frame ({1e3 / every.mean():.0f}/s), "
            f"95 % below {slow:.1f}, worst {every.max():.1f}; {zones}"
        )
    print(json.dumps(found))


if __name__ == "__main__":
    main()
