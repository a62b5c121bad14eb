"""Small data sets in the layout of the published ones, with what `conftest.Grey` sees of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.evaluation.datasets.rugd import SPLITS

GRASS, BUSH = 90, 140
"""Brightness that Grey takes for grass and bush."""
SCENES: Mapping[str, tuple[Sequence[int], Sequence[str]]] = {
    "right": ((GRASS, GRASS, BUSH, BUSH), ("grass", "grass", "bush", "bush")),
    "wrong": ((GRASS, GRASS, BUSH, GRASS), ("grass", "bush", "bush", "void")),
}
"""Brightness and label of four blocks of 32x32 pixels.

The IoU is 1 and 1/2, and 1/3 where the block without a label counts.
"""


def blocks(values: Sequence[object]) -> NDArray[np.uint8]:
    """A row of blocks, each of one grey or one colour (red, green, blue)."""
    return np.array([values], dtype=np.uint8).repeat(32, axis=0).repeat(32, axis=1)


def write(file: Path, picture: NDArray[np.uint8]) -> None:
    """Write a picture, grey or RGB; JPEG at its best."""
    file.parent.mkdir(parents=True, exist_ok=True)
    stored = picture if picture.ndim == 2 else picture[..., ::-1]
    best = [cv2.IMWRITE_JPEG_QUALITY, 100] if file.suffix == ".jpg" else []
    assert cv2.imwrite(str(file), stored, best)


def write_frame(picture: Path, label: Path, scene: str, code: Mapping[str, object]) -> None:
    """Write the picture and the label image of a scene. code: label -> id or colour."""
    light, labels = SCENES[scene]
    write(picture, blocks(light))
    write(label, blocks([code[name] for name in labels]))


def rellis(root: Path) -> Path:
    """Two drives; the lists name all but one frame."""
    code = {"void": 0, "grass": 3, "bush": 19}
    lines = []
    for name, scene in (("00000/frame000001-15", "right"), ("00004/frame000000-16", "wrong")):
        drive, _, stem = name.partition("/")
        picture = f"{drive}/pylon_camera_node/{stem}.jpg"
        label = f"{drive}/pylon_camera_node_label_id/{stem}.png"
        write_frame(root / "Rellis-3D" / picture, root / "Rellis-3D" / label, scene, code)
        lines.append(f"{picture} {label}\n")
    (root / "train.lst").write_text(lines[0])
    (root / "test.lst").write_text(lines[1].split()[0] + "\n")
    return root


def rugd(root: Path) -> Path:
    """A drive for training, and one for the test."""
    code = {"void": (0, 0, 0), "grass": (0, 102, 0), "bush": (255, 153, 204)}
    for drive, scene in (("trail-3", "right"), ("creek", "wrong")):
        name = f"{drive}/{drive}_00001.png"
        frames, labels = root / "RUGD_frames-with-annotations", root / "RUGD_annotations"
        write_frame(frames / name, labels / name, scene, code)
    for drive in (drive for split in SPLITS.values() for drive in split):
        (root / "RUGD_annotations" / drive).mkdir(exist_ok=True)
    return root


def deepscene(root: Path) -> Path:
    """A frame for training, and one for the test, whose label image is half as large."""
    code = {"void": (255, 255, 255), "grass": (0, 255, 0), "bush": (102, 102, 51)}
    for part, scene in (("train", "right"), ("test", "wrong")):
        folder = root / "freiburg_forest_annotated" / part
        write_frame(folder / "rgb" / "b1-1_Clipped.jpg", folder / "GT_color" / "b1-1_mask.png", scene, code)
        whole = blocks([code[name] for name in SCENES[scene][1]])
        write(folder / "GT_color" / "b1-1_mask.png", whole[::2, ::2])
    return root


def ycor(root: Path) -> Path:
    """A frame for training, and one for validation."""
    code = {"void": (255, 255, 255), "grass": (128, 255, 0), "bush": (0, 160, 0)}
    for part, name, scene in (("train", "iid000000", "right"), ("valid", "iid000839", "wrong")):
        folder = root / "yamaha_v0" / part / name
        write_frame(folder / "rgb.jpg", folder / "labels.png", scene, code)
    return root


TREES = {"rellis": rellis, "rugd": rugd, "deepscene": deepscene, "ycor": ycor}
