"""Writes a grid of the ground: a picture, its layers, and the pair of files that Nav2's map_server reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from anytraverse.drawing import write_png
from anytraverse.frame import Image, Pose
from anytraverse.grid import CELL, SIDE, LocalGrid

_UNKNOWN, _FREE, _OCCUPIED = 205, 254, 0
"""Grey values of map_server."""
_YAML = """image: costmap.pgm
mode: trinary
resolution: {resolution:g}
origin: [{x:.3f}, {y:.3f}, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""


def write_costmap(folder: Path, grid: LocalGrid, pose: Pose, drawn: Image) -> list[Path]:
    """Write all files of a grid into a folder; return which. drawn: of it. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    picture, layers, pgm, yaml = (folder / f"costmap.{end}" for end in ("png", "npz", "pgm", "yaml"))
    write_png(str(picture), drawn)
    x, y = (one * CELL for one in grid.corner)
    np.savez_compressed(
        layers,
        drivable=grid.drivable,
        known=grid.known,
        share=grid.share,
        uncertainty=grid.uncertainty,
        age=grid.age,
        resolution=CELL,
        origin=np.array([x, y]),
        pose=np.array(pose),
    )
    grey = np.where(grid.known, np.where(grid.drivable, _FREE, _OCCUPIED), _UNKNOWN).astype(np.uint8)
    # a map's first row is the one of the largest y
    pgm.write_bytes(b"P5\n%d %d\n255\n" % (SIDE, SIDE) + np.ascontiguousarray(grey[::-1]).tobytes())
    yaml.write_text(_YAML.format(resolution=CELL, x=x, y=y), encoding="utf-8")
    return [picture, layers, yaml, pgm]
