"""Renders labelled frames of the simulated trail to a folder: NNNN.jpg, NNNN.png, classes.json.

Every zone of every world is a place and has a hundred numbers of its own. There are no surprises unless their
kinds are given. Run: python -m bench.labelled_field OUT --seeds 100 101 [--surprises drum] [--frames 24]
[--light 0.5 1.6]
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import cv2
import numpy as np

from companion.sim.field.render import LABELS, PinholeCamera
from companion.sim.field.things import World


def render(
    folder: Path, seeds: list[int], surprises: list[str], frames: int, light: tuple[float, float]
) -> int:
    """Write `frames` (at most 75) frames a zone along each seed's lap, in changing light; how many in all."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "classes.json").write_text(json.dumps({"ignore": 255, "classes": list(LABELS)}))
    for number, seed in enumerate(seeds):
        rng = np.random.default_rng([seed, 77])
        world = World(seed, surprises)
        cameras = [PinholeCamera(world, 320, 240, seed), PinholeCamera(world, 400, 225, seed)]
        for zone, (begin, end) in enumerate(world.trail.borders.values()):
            for index, s in enumerate(np.linspace(begin, end, frames, endpoint=False)):
                world.light = float(np.exp(rng.uniform(np.log(light[0]), np.log(light[1]))))
                pose = world.trail.pose(float(s + rng.uniform(0, (end - begin) / frames)))
                image, labels = cameras[index % len(cameras)].render(pose, float(rng.uniform(0, 300)))
                stem = folder / f"{100 * (3 * number + zone) + index:05d}"
                cv2.imwrite(f"{stem}.jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])
                cv2.imwrite(f"{stem}.png", labels)
    return 3 * frames * len(seeds)


def main() -> None:
    """Renders the frames and prints how many there are."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", required=True)
    parser.add_argument("--surprises", nargs="*", default=[])
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--light", type=float, nargs=2, default=[0.5, 1.6])
    options = parser.parse_args()
    low, high = options.light
    count = render(options.folder, options.seeds, options.surprises, min(75, options.frames), (low, high))
    print(f"{count} frames in {options.folder}")


if __name__ == "__main__":
    main()
