"""Makes a contact sheet of the frames on which the built-in network is worst: frame, labels, classes, result.

The last column is green where the ground is drivable and red where it is uncertain.
Run: python -m bench.worst_frames FOLDER SHEET.png [--blocks 2] [--count 8] [--network FILE.onnx]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import anytraverse.perception
from anytraverse.perception.builtin.attention import posteriors
from anytraverse.perception.builtin.calibration import Calibration
from anytraverse.training.fit import stored
from anytraverse.training.folders import Folder, Labelled, read_folder
from anytraverse.training.scores import SCALE, Network, maps, score

SHIPPED = Path(anytraverse.perception.__file__).parent / "data" / "builtin.onnx"
WIDTH = 240
_COLOURS = (
    (200, 150, 60), (150, 90, 40), (80, 220, 60), (40, 140, 90),
    (10, 80, 20), (120, 180, 250), (0, 0, 255), (255, 0, 255),
)  # fmt: skip
PALETTE = np.zeros((256, 3), dtype=np.uint8)
PALETTE[: len(_COLOURS)] = _COLOURS
"""RGB of the classes; unlabelled is black."""


def row(network: Network, calibration: Calibration, frame: Labelled) -> tuple[float, NDArray[np.uint8]]:
    """Computes a frame's drivable IoU and its row of the sheet, RGB."""
    outputs, labels = network(frame.image), frame.labels[::SCALE, ::SCALE]
    traversability, uncertainty = maps(outputs, calibration, labels.shape)
    classes = posteriors(outputs, calibration).argmax(axis=0).astype(np.uint8)
    made = np.stack([uncertainty, traversability, np.zeros_like(uncertainty)], axis=-1) * 255
    size = WIDTH, round(WIDTH * frame.image.shape[0] / frame.image.shape[1])
    parts = [frame.image, PALETTE[labels], PALETTE[classes], made.astype(np.uint8)]
    sheet = np.hstack([cv2.resize(part, size, interpolation=cv2.INTER_AREA) for part in parts])
    iou = score([(outputs, labels)], calibration).iou
    cv2.putText(sheet, f"{frame.number:04d} {iou:.2f}", (4, 14), 0, 0.45, (255, 40, 40), 1)
    return iou, np.asarray(sheet, dtype=np.uint8)


def main() -> None:
    """Writes the sheet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("sheet", type=Path)
    parser.add_argument("--blocks", type=int, nargs="+", default=[2])
    parser.add_argument("--count", type=int, default=8)
    parser.add_argument("--network", type=Path, default=SHIPPED)
    options = parser.parse_args()
    network, calibration = stored(options.network)
    held_out: Folder = read_folder(options.folder).of(options.blocks)
    rows = sorted((row(network, calibration, frame) for frame in held_out.frames), key=lambda one: one[0])
    sheet = np.vstack([picture for _, picture in rows[: options.count]])
    cv2.imwrite(str(options.sheet), sheet[..., ::-1])


if __name__ == "__main__":
    main()
