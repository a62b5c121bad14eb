"""Opens RELLIS-3D: drives of a Warthog on the Rellis campus, with ids in grey label images.

Layout, split files and licence are those of its repository, github.com/unmannedlab/RELLIS-3D (README.md).
The ids are those of its benchmarks (HRNet, lib/datasets/rellis.py), which count 29 and 30 as grass, 32 as
water. Not verified, for want of the archives: in which folder the split archive puts the lists. They are
looked for in the data set's folder and in the folders directly below it.
"""

from __future__ import annotations

from pathlib import Path, PurePosixPath

from anytraverse.evaluation.datasets.codes import IdCode
from anytraverse.evaluation.datasets.dataset import Dataset, Selection
from anytraverse.evaluation.datasets.splits import ALL, Origin, numbered, unpacked
from anytraverse.evaluation.labels import DatasetError, LabelClasses
from anytraverse.regular_file import read_regular

ORIGIN = Origin("RELLIS-3D", "https://github.com/unmannedlab/RELLIS-3D", "CC BY-NC-SA 3.0")
SPLITS = ("train", "val", "test")
_IDS = {
    0: "void", 1: "dirt", 3: "grass", 4: "tree", 5: "pole", 6: "water", 7: "sky", 8: "vehicle", 9: "object",
    10: "asphalt", 12: "building", 15: "log", 17: "person", 18: "fence", 19: "bush", 23: "concrete",
    27: "barrier", 29: "grass", 30: "grass", 31: "puddle", 32: "water", 33: "mud", 34: "rubble",
}  # fmt: skip
CLASSES = LabelClasses(tuple(_IDS.get(number, "") for number in range(max(_IDS) + 1)), ignore=0)
_PICTURES, _LABELS = "pylon_camera_node", "pylon_camera_node_label_id"
_MOST_BYTES = 10_000_000
_ARCHIVES = '"Full Images" and "Full Image Annotations ID Format"'


def open_rellis(path: Path, split: str, selection: Selection) -> Dataset:
    """Find the frames of a split as its list names them, or every labelled frame. DatasetError, OSError."""
    ORIGIN.check_split(split, SPLITS)
    root = unpacked(ORIGIN.folder(path, _ARCHIVES), "Rellis-3D")
    if split == ALL:
        labels = sorted(root.glob(f"*/{_LABELS}/*.png"))
        pairs = [(label.parents[1] / _PICTURES / f"{label.stem}.jpg", label) for label in labels]
    else:
        pairs = [_pair(root, line) for line in _lines(_list(path, root, split))]
    remedy = f"unpack {_ARCHIVES} into {root}; {ORIGIN.remedy}"
    files = numbered(pairs, root, remedy)
    code = IdCode(CLASSES, ORIGIN.title, "take the label images in ID format")
    return Dataset(ORIGIN.title, root, CLASSES, files, code, selection, remedy=remedy)


def _list(path: Path, root: Path, split: str) -> Path:
    name = f"{split}.lst"
    found = [*sorted(path.glob(name)), *sorted(root.glob(name)), *sorted(path.glob(f"*/{name}"))]
    if not found:
        raise DatasetError(f'{path / name} is missing: unpack "Image Split File" there; {ORIGIN.remedy}')
    return found[0]


def _lines(file: Path) -> list[str]:
    data = read_regular(file, _MOST_BYTES + 1)
    try:
        lines = data.decode().split("\n") if len(data) <= _MOST_BYTES else []
    except UnicodeDecodeError:
        lines = []
    found = [line for line in lines if line.strip()]
    if not found:
        raise DatasetError(f"{file} lists no pictures: {ORIGIN.remedy}")
    return found


def _pair(root: Path, line: str) -> tuple[Path, Path]:
    """Return picture and label image of a line; one that names no label image means that of its picture."""
    names = [PurePosixPath(name) for name in line.split()]
    wrong = any(name.is_absolute() or ".." in name.parts for name in names)
    if wrong or len(names) > 2 or len(names[0].parts) < 3:
        raise DatasetError(
            f'"{line.strip()[:200]}" is no line of a split: each names SEQUENCE/{_PICTURES}/NAME.jpg '
            "and its label image"
        )
    picture = names[0]
    label = names[1] if len(names) == 2 else picture.parents[1] / _LABELS / f"{picture.stem}.png"
    return root / picture, root / label
