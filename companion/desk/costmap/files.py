"""Writes a grid of the ground: a picture, its layers, and the pair of files that Nav2's map_server reads."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from anytraverse.drawing import FAINT, INK, PAPER, SIGNED_STOPS, coloured, write_png
from anytraverse.frame import Image, Pose
from anytraverse.grid import CELL, SIDE, LocalGrid
from anytraverse.ground import GroundCamera

_ZOOM = 4
"""Pixels of the picture for each cell."""
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


def write_costmap(folder: Path, grid: LocalGrid, pose: Pose, camera: GroundCamera) -> list[Path]:
    """Write all files of a grid into a folder; return which. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    picture, layers, pgm, yaml = (folder / f"costmap.{end}" for end in ("png", "npz", "pgm", "yaml"))
    write_png(str(picture), draw(grid, pose, camera))
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


def draw(grid: LocalGrid, pose: Pose, camera: GroundCamera) -> Image:
    """Draw the grid from above, with odometry's x to the right, and an arrow from the lens to the front."""
    share = np.where(grid.known, 2.0 * grid.share - 1.0, np.nan).astype(np.float32)
    cells = coloured(share[::-1], SIGNED_STOPS, -1.0, 1.0)
    side = SIDE * _ZOOM
    canvas = np.asarray(cv2.resize(cells, (side, side), interpolation=cv2.INTER_NEAREST), np.uint8)
    ahead = np.array([[0.0, 0.0], [max(camera.front, 0.5), 0.0]])
    turn = np.radians(pose.heading)
    c, s = np.cos(turn), np.sin(turn)
    places = ahead @ np.array([[c, s], [-s, c]]) + (pose.x, pose.y)
    pixels = (places / CELL - grid.corner) * (_ZOOM, -_ZOOM) + (0, side)
    lens, front = np.rint(pixels).astype(int).tolist()
    for colour, thick in ((PAPER, 6), (INK, 3)):
        cv2.arrowedLine(canvas, lens, front, colour, thick, cv2.LINE_AA, tipLength=0.4)
    cv2.line(canvas, (12, side - 12), (12 + round(1.0 / CELL) * _ZOOM, side - 12), PAPER, 3)  # a metre
    cv2.rectangle(canvas, (0, 0), (side - 1, side - 1), FAINT, 1)
    return canvas
