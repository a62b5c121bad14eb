"""Opens RUGD: a small robot's drives in parks, on trails, along a creek and in a village, in 24 colours.

Archives, layout and colours are those of rugd.vision, as public readers of the data set state them (the
colour map is its file RUGD_annotation-colormap.txt). The split by drives is that of its paper (Wigness and
others, IROS 2019), as public readers repeat it. Not verified against the archives themselves.
"""

from __future__ import annotations

from pathlib import Path

from anytraverse.evaluation.datasets.codes import ColourCode
from anytraverse.evaluation.datasets.dataset import Dataset, Selection
from anytraverse.evaluation.datasets.splits import ALL, Origin, numbered

ORIGIN = Origin("RUGD", "http://rugd.vision", "see the terms there")
_PICTURES, _LABELS = "RUGD_frames-with-annotations", "RUGD_annotations"
SPLITS = {
    "train": (
        "park-2", "trail", "trail-3", "trail-4", "trail-6", "trail-9", "trail-10", "trail-11", "trail-12",
        "trail-14", "trail-15", "village",
    ),
    "val": ("park-8", "trail-5"),
    "test": ("creek", "park-1", "trail-7", "trail-13"),
}  # fmt: skip
_COLOURS = {
    "dirt": (108, 64, 20), "sand": (255, 229, 204), "grass": (0, 102, 0), "tree": (0, 255, 0),
    "pole": (0, 153, 153), "water": (0, 128, 255), "sky": (0, 0, 255), "vehicle": (255, 255, 0),
    "container/generic-object": (255, 0, 127), "asphalt": (64, 64, 64), "gravel": (255, 128, 0),
    "building": (255, 0, 0), "mulch": (153, 76, 0), "rock-bed": (102, 102, 0), "log": (102, 0, 0),
    "bicycle": (0, 255, 128), "person": (204, 153, 255), "fence": (102, 0, 204), "bush": (255, 153, 204),
    "sign": (0, 102, 102), "rock": (153, 204, 255), "bridge": (102, 255, 255), "concrete": (101, 101, 11),
    "picnic-table": (114, 85, 47),
}  # fmt: skip
CODE = ColourCode(_COLOURS, ORIGIN.title, void=[(0, 0, 0)])


def open_rugd(path: Path, split: str, selection: Selection) -> Dataset:
    """Find the frames of a split, drive by drive, or every labelled frame. Raises DatasetError, OSError."""
    ORIGIN.check_split(split, SPLITS)
    annotated = ORIGIN.folder(path / _LABELS, f"{_LABELS}.zip")
    pictures = ORIGIN.folder(path / _PICTURES, f"{_PICTURES}.zip")
    there = sorted(drive.name for drive in annotated.iterdir() if drive.is_dir())
    drives = there if split == ALL else SPLITS[split]
    pairs = []
    for drive in drives:
        labels = sorted(ORIGIN.folder(annotated / drive, f"{_LABELS}.zip").glob("*.png"))
        pairs += [(pictures / drive / label.name, label) for label in labels]
    files = numbered(pairs, annotated, ORIGIN.remedy)
    remedy = f"unpack {_PICTURES}.zip into {path}; {ORIGIN.remedy}"
    return Dataset(ORIGIN.title, path, CODE.classes, files, CODE, selection, remedy=remedy)
